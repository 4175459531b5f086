"""How the families of motion files name their joints, and in which pose those rest."""

from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import Rotation

from synth.motion.recording import Recording

_PARTS = (
    "pelvis",
    "spine",
    "chest",
    "head",
    "upper_arm",
    "forearm",
    "wrist",
    "hand",
    "knuckle",
    "thigh",
    "shin",
    "foot",
)
_SPLAYED = {"foot": (0.0, 0.0, -20.0)}
"""Acclaim's rest pose splays each leg, foot and all, by 20 degrees."""


@dataclass(frozen=True)
class Dialect:
    """How one family of files names and rests its joints.

    Attributes:
        name: For people to read.
        sides: What the names of left and of right joints hold.
        joints: For each of `_PARTS` the joint that drives the segment, or lies at the wrist or at the knuckles; joints
            lie where their segment starts. `{side}` stands for one of `sides`; `|` parts names of which a file has one.
        rest: Orientations of driving joints in the T-pose, file's world from joint, as angles about x, y and z in
            degrees, turned in that order; zero where left out. Those of the right are the mirror image.
        blend: How many frames a synthetic T-pose at the start of a file spoils, itself among them.
    """

    name: str
    sides: tuple[str, str]
    joints: tuple[str, ...]
    rest: dict[str, tuple[float, float, float]] = field(default_factory=dict)
    blend: int = 1

    def names(self) -> dict[str, tuple[str, ...]]:
        """The names that each part's joint may have, those of two sides as `l_*` and `r_*`."""
        names = {}
        for part, pattern in zip(_PARTS, self.joints, strict=True):
            both = {f"{prefix}_{part}": side for prefix, side in zip("lr", self.sides, strict=True)}
            for key, side in both.items() if "{" in pattern else ((part, ""),):
                names[key] = tuple(pattern.format(side=side).split("|"))
        return names

    def rest_of(self, part: str) -> np.ndarray:
        """(3, 3) orientation of the joint that drives a segment in the T-pose, file's world from joint."""
        angles = np.array(self.rest.get(part.removeprefix("l_").removeprefix("r_"), (0, 0, 0)))
        mirrored = angles * (1, -1, -1) if part.startswith("r_") else angles
        return Rotation.from_euler("xyz", mirrored, degrees=True).as_matrix()


# fmt: off
DIALECTS = (
    Dialect(
        "Acclaim",
        ("l", "r"),
        ("root", "lowerback", "thorax", "head", "{side}humerus", "{side}radius", "{side}wrist", "{side}hand",
         "{side}fingers", "{side}femur", "{side}tibia", "{side}foot"),
        rest=_SPLAYED,
    ),
    Dialect(
        "cgspeed for MotionBuilder",
        ("Left", "Right"),
        ("Hips", "LowerBack", "Spine1", "Head", "{side}Arm", "{side}ForeArm", "{side}Hand", "{side}FingerBase",
         "{side[0]}Fingers|{side}HandIndex1", "{side}UpLeg", "{side}Leg", "{side}Foot"),
        rest=_SPLAYED,
    ),
    Dialect(
        "cgspeed for 3ds Max",
        ("Left", "Right"),
        ("Hips", "lowerback", "Chest2", "Head", "{side}Shoulder", "{side}Elbow", "{side}Wrist", "{side[0]}hand",
         "{side[0]}Fingers", "{side}Hip", "{side}Knee", "{side}Ankle"),
        # Its arms hang at rest.
        rest={**_SPLAYED, "upper_arm": (0, 0, 90), "forearm": (0, 0, 90), "hand": (0, 0, 90)},
    ),
    Dialect(
        "cgspeed for Daz",
        ("l", "r"),
        ("hip", "abdomen", "chest", "head", "{side}Shldr", "{side}ForeArm", "{side}Hand", "{side}Hand", "{side}Mid1",
         "{side}Thigh", "{side}Shin", "{side}Foot"),
        blend=6,
    ),
    # Where its root is RL_BoneRoot, which follows on the floor, the hips have lost their ups and downs.
    Dialect(
        "iClone Character Creator",
        ("L", "R"),
        ("CC_Base_Hip", "CC_Base_Waist", "CC_Base_Spine02", "CC_Base_Head", "CC_Base_{side}_Upperarm",
         "CC_Base_{side}_Forearm", "CC_Base_{side}_Hand", "CC_Base_{side}_Hand", "CC_Base_{side}_Mid1",
         "CC_Base_{side}_Thigh", "CC_Base_{side}_Calf", "CC_Base_{side}_Foot"),
        # Its bones lie along their own y.
        rest={
            "spine": (16.2, 0, 0), "chest": (-10.3, 0, 0),
            "upper_arm": (0.5, 0, -92.5), "forearm": (0.7, 0, -91.2), "hand": (-2.4, 0, -95.7),
            "thigh": (4.5, 0, 180), "shin": (-4.4, 0, 180), "foot": (77.1, -6.3, 180),
        },
    ),
)
# fmt: on


def recognise(recording: Recording) -> tuple[Dialect, dict[str, int]]:
    """The dialect of a recording, and the index of the joint for each part (`pelvis`, `l_upper_arm`, `l_knuckle`, ...).

    Case does not matter.

    Raises:
        ValueError: joints of no known dialect; says which were found and which wanted.
    """
    there = {joint.casefold(): i for i, joint in enumerate(recording.joints)}
    lacking = []
    for dialect in DIALECTS:
        wanted = dialect.names()
        found = {
            part: there[name.casefold()] for part, names in wanted.items() for name in names if name.casefold() in there
        }
        if len(found) == len(wanted):
            return dialect, found
        lacking.append(f"{dialect.name}: {', '.join('|'.join(wanted[part]) for part in wanted if part not in found)}")
    raise ValueError(
        f"{recording.path}: expected the joints of a known skeleton, found {', '.join(recording.joints)}. "
        f"What it lacks to be {'; '.join(lacking)}"
    )
