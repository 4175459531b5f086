"""Dialects: the joint names and the rest pose of each family of motion files, and files that map names to ours."""

from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from dmae.files.structured import read_yaml
from synth.motion.readers.recording import SkeletonRecording

_PARTS = (
    "pelvis", "spine", "chest", "head", "upper_arm", "forearm", "wrist", "hand", "knuckle", "thigh", "shin", "foot"
)  # fmt: skip
_SPLAYED = {"foot": (0.0, 0.0, -20.0)}
"""Rest pose of Acclaim: each leg, foot included, is splayed by 20 degrees."""


@dataclass(frozen=True)
class Dialect:
    """Joint names and rest pose of one family of files."""

    name: str  # Label for reports
    sides: tuple[str, str]  # Text in the names of left joints, and in the names of right joints
    # For each of `_PARTS`, the joint that drives the segment, or the joint at the wrist or the knuckles. Each joint is
    # at the start of its segment. `{side}` stands for one of `sides`; `|` separates alternative names. Empty for
    # knuckles that files do not have: hands then turn with their joint.
    joints: tuple[str, ...]
    # Orientations of driving joints in the T-pose, file's world from joint, as angles about x, y and z, degrees, in
    # that order; zero if not listed. They are for the left side; the right side is mirrored.
    rest: dict[str, tuple[float, float, float]] = field(default_factory=dict)
    # Number of unusable frames at the start of a file: a synthetic T-pose and the frames that blend out of it
    blend: int = 1
    # Angle above the forward direction at which elbows bend in the T-pose, degrees; None if files differ, and the angle
    # is found from the motion
    elbow: float | None = 30.0

    def names(self) -> dict[str, tuple[str, ...]]:
        """Return the possible names of the joint of each part, sides as `l_*` and `r_*`."""
        names = {}
        for part, pattern in zip(_PARTS, self.joints, strict=True):
            if not pattern:
                continue
            both = {f"{prefix}_{part}": side for prefix, side in zip("lr", self.sides, strict=True)}
            for key, side in both.items() if "{" in pattern else ((part, ""),):
                names[key] = tuple(pattern.format(side=side).split("|"))
        return names

    def rest_of(self, part: str) -> np.ndarray:
        """Return the orientation (3, 3) of the joint that drives a segment in the T-pose, file's world from joint."""
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
        # Its arms hang down in the rest pose.
        rest={**_SPLAYED, "upper_arm": (0, 0, 90), "forearm": (0, 0, 90), "hand": (0, 0, 90)},
    ),
    Dialect(
        "cgspeed for Daz",
        ("l", "r"),
        ("hip", "abdomen", "chest", "head", "{side}Shldr", "{side}ForeArm", "{side}Hand", "{side}Hand", "{side}Mid1",
         "{side}Thigh", "{side}Shin", "{side}Foot"),
        blend=6,
    ),
    # If the root is RL_BoneRoot, which follows the body on the floor, the hips do not move up and down.
    Dialect(
        "iClone Character Creator",
        ("L", "R"),
        ("CC_Base_Hip", "CC_Base_Waist", "CC_Base_Spine02", "CC_Base_Head", "CC_Base_{side}_Upperarm",
         "CC_Base_{side}_Forearm", "CC_Base_{side}_Hand", "CC_Base_{side}_Hand", "CC_Base_{side}_Mid1",
         "CC_Base_{side}_Thigh", "CC_Base_{side}_Calf", "CC_Base_{side}_Foot"),
        # Its bones are along their own y axis.
        rest={
            "spine": (16.2, 0, 0), "chest": (-10.3, 0, 0),
            "upper_arm": (0.5, 0, -92.5), "forearm": (0.7, 0, -91.2), "hand": (-2.4, 0, -95.7),
            "thigh": (4.5, 0, 180), "shin": (-4.4, 0, 180), "foot": (77.1, -6.3, 180),
        },
    ),
    # The end sites of its hands have a length of zero or of 1.6 m. Its other joints belong to a muscle model and are
    # not in the limbs.
    Dialect(
        "MotionBuilder's Character1",
        ("Left", "Right"),
        ("Character1_Hips", "Character1_Spine", "Character1_Spine1", "Character1_Head", "Character1_{side}Arm",
         "Character1_{side}ForeArm", "Character1_{side}Hand", "Character1_{side}Hand", "", "Character1_{side}UpLeg",
         "Character1_{side}Leg", "Character1_{side}Foot"),
        blend=0,
        elbow=None,
    ),
    Dialect(
        "SOMA",
        ("Left", "Right"),
        ("Hips", "Spine1", "Chest", "Head", "{side}Arm", "{side}ForeArm", "{side}Hand", "{side}Hand",
         "{side}HandMiddle1", "{side}Leg", "{side}Shin", "{side}Foot"),
        blend=0,
        elbow=None,
    ),
    # In the rest pose toes point outward. Elbows bend about the vertical.
    Dialect(
        "SMPL",
        ("left", "right"),
        ("pelvis", "spine1", "spine3", "head", "{side}_shoulder", "{side}_elbow", "{side}_wrist", "{side}_wrist",
         "{side}_hand", "{side}_hip", "{side}_knee", "{side}_ankle"),
        rest={"foot": (0, -12.5, 0)},
        blend=0,
        elbow=0,
    ),
)
SMPL = DIALECTS[-1]
# Names that a mapping file may assign to the joints of any other skeleton. Its bones determine its rest pose.
OWN = Dialect(
    "mapped",
    ("l", "r"),
    ("pelvis", "spine|chest", "chest|spine", "head", "{side}_upper_arm", "{side}_forearm", "{side}_wrist|{side}_hand",
     "{side}_hand|{side}_wrist", "{side}_knuckle", "{side}_thigh", "{side}_shin", "{side}_foot"),
    elbow=0,
)
# fmt: on


def recognise(recording: SkeletonRecording) -> tuple[Dialect, dict[str, int]]:
    """Return the dialect of a recording, and the joint index of each part (`pelvis`, `l_knuckle`, ...), in any case.

    Raises ValueError if the joints are of no known dialect; the message lists those found, and those that are missing
    from the most similar dialect and from our own names.
    """
    there = {joint.casefold(): i for i, joint in enumerate(recording.joints)}
    lacking = []
    for dialect in (*DIALECTS, OWN):
        wanted = dialect.names()
        known = {
            part: [there[name.casefold()] for name in names if name.casefold() in there]
            for part, names in wanted.items()
        }
        found = {part: joints[0] for part, joints in known.items() if joints}
        if len(found) == len(wanted):
            return dialect, found
        missing = dict.fromkeys("|".join(wanted[part]) for part in wanted if part not in found)
        lacking.append((len(missing), f"{dialect.name}: {', '.join(missing)}"))
    # That which lacks least, and our own names.
    nearest = dict.fromkeys((min(lacking)[1], lacking[-1][1]))
    raise ValueError(
        f"{recording.path}: expected the joints of a known skeleton, found {', '.join(recording.joints)}. "
        f"What it lacks to be {'; '.join(nearest)}. "
        "If these are names for the same, say so in motion.mapping=<a YAML file of lines `their name: ours`>"
    )


def known_joints() -> set[str]:
    """Return every joint name of every dialect."""
    return {name for dialect in (*DIALECTS, OWN) for names in dialect.names().values() for name in names}


def at_rest(recording: SkeletonRecording, joint: dict[str, int]) -> tuple[SkeletonRecording, Dialect, np.ndarray]:
    """Turn a recording of mapped joints to axes x left, y up, z forward, and find its rest pose.

    The skeleton with all angles zero determines the up and left axes, and the rotation of each limb from the T-pose.
    Its head and feet are assumed to face forward. Returns the turned recording, its dialect, and the rotation (3, 3).

    Raises ValueError if with all angles zero, the skeleton does not stand upright along an axis of the file.
    """
    places = np.zeros((len(recording.joints), 3))
    for i, parent in enumerate(recording.parents[1:], 1):
        places[i] = places[parent] + recording.offsets[i]
    place = {part: places[i] for part, i in joint.items()}
    left = place["l_thigh"] - place["r_thigh"]
    axes = []
    for way in (left, place["head"] - (place["l_thigh"] + place["r_thigh"]) / 2):
        axis = np.zeros(3)
        axis[np.abs(way).argmax()] = np.sign(way[np.abs(way).argmax()])
        axes.append(axis if axis @ way > 0.9 * np.linalg.norm(way) else np.full(3, np.nan))
    turn = np.stack([*axes, np.cross(axes[0], axes[1])])
    drop = [(place[f"{side}_{upper}"] - place[f"{side}_{lower}"]) @ axes[1]
            for side in "lr" for upper, lower in (("thigh", "shin"), ("shin", "foot"))]  # fmt: skip
    if not (abs(np.linalg.det(turn)) > 0.5 and min(drop) > 0):
        raise ValueError(
            f"{recording.path}: expected mapped joints to stand upright along an axis of the file when all angles are "
            f"zero; left thigh lies {np.round(left, 3)} from right, head {np.round(place['head'], 3)} from the root"
        )
    rest = {}
    for part, end, to in (
        ("upper_arm", "forearm", (1, 0, 0)),
        ("forearm", "wrist", (1, 0, 0)),
        ("hand", "knuckle", (1, 0, 0)),
        ("thigh", "shin", (0, -1, 0)),
        ("shin", "foot", (0, -1, 0)),
    ):
        bone = turn @ recording.offsets[joint[f"l_{end}"]]
        if np.linalg.norm(bone) > 0:
            rest[part] = tuple(Rotation.align_vectors([to], [bone])[0].as_euler("xyz", degrees=True))
    turned = replace(
        recording,
        offsets=recording.offsets @ turn.T,
        root=recording.root @ turn.T,
        rotations=turn @ recording.rotations @ turn.T,
    )
    return turned, replace(OWN, rest=rest), turn


def read_mapping(path: Path) -> dict[str, str]:
    """Read a YAML file of lines `their name: our name`.

    Raises:
        FileNotFoundError: there is no such file.
        ValueError: the file has other content, or a value that is no name.
    """
    if not path.is_file():
        raise FileNotFoundError(f"motion.mapping: no such file {path}")
    mapping = read_yaml(path)
    if not isinstance(mapping, dict) or not mapping:
        raise ValueError(f"{path}: expected YAML lines `their name: our name`, found {type(mapping).__name__}")
    wrong = [f"{theirs!r}: {ours!r}" for theirs, ours in mapping.items() if not isinstance(ours, str)]
    if wrong:
        raise ValueError(f"{path}: expected a name after each colon, found {', '.join(wrong)}")
    return {str(theirs): ours for theirs, ours in mapping.items()}


def renamed(names: tuple[str, ...], mapping: dict[str, str], known: set[str], path: Path) -> tuple[str, ...]:
    """Return names, replaced where a mapping contains them.

    Raises ValueError if the mapping has none of the names, or maps two of them to the same name.
    """
    if not mapping:
        return names
    there = [theirs for theirs in names if theirs in mapping]
    if not there:
        raise ValueError(
            f"{path}: expected a name of motion.mapping, which has {', '.join(mapping)}; found {', '.join(names)}"
        )
    meant = [mapping[theirs] for theirs in there if mapping[theirs] in known]
    twice = sorted({ours for ours in meant if meant.count(ours) > 1})
    if not meant or twice:
        raise ValueError(
            f"{path}: expected motion.mapping to map one of {', '.join(names)} to each of our names, found "
            + (f"several for {', '.join(twice)}" if twice else f"none for {', '.join(sorted(known))}")
        )
    return tuple(mapping.get(theirs, theirs) for theirs in names)
