"""From a recorded skeleton to the canonical segments on a level floor."""

import numpy as np

from synth.motion import SEGMENTS, Motion
from synth.motion.dialects import Dialect, recognise
from synth.motion.floor import lay_soles, level_floor
from synth.motion.recording import Recording
from synth.motion.rotations import aligned

# Files have x to the left, y up, z forward; we have x forward, y left, z up.
_CANONICAL_FROM_FILE = np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])
_UNITS = {"m": 1.0, "cm": 0.01, "mm": 0.001, "CMU units": 0.0254 / 0.45}
"""Metres a unit. CMU's Acclaim files count inches times 0.45, as their `:units` say."""
_LEGS = (0.55, 1.15)
"""Thigh and shin together, m, from a ten-year-old's to the tallest adult's; so wide that only one unit can fit."""
_ANKLE_OF_LEG = 0.039 / (0.245 + 0.246)
"""Height of the ankle over thigh and shin: Drillis and Contini (1966), in Winter (2009), figure 4.1."""
_FORWARD = np.array((1.0, 0, 0))
_ELBOW_BENDS_TO = np.array((np.cos(np.pi / 6), 0, np.sin(np.pi / 6)))
"""To where elbows bend in the T-pose of all that stems from CMU's Acclaim files: 30 degrees above forward."""


def retarget(recording: Recording) -> Motion:
    """A recorded skeleton's motion on the canonical segments, on a level floor.

    A segment turns with the joint that drives it, R(t) = W G(t) G_rest^-1 A: G is the joint's orientation, G_rest that
    in the T-pose, A takes the canonical axes to the recorded limb as it is in the T-pose (along the bone, which may be
    splayed or bent), W takes the file's axes to ours. The canonical pose is the identity whatever pose a file calls its
    rest. An upper arm's x axis is the side to which its elbow bends, so that an elbow is a hinge about z as a knee is
    one about y; a forearm turns about itself with its hand. Soles near the floor lie on it.

    The synthetic T-pose with which some files begin is left out, along with the frames that blend out of it. Floor and
    `hip_height` are such that ankles stand as high as an adult of these legs has them, whatever the file's feet.

    Raises:
        ValueError: joints of no known dialect, legs whose length fits no unit, or nothing after the T-pose.
    """
    dialect, joint = recognise(recording)
    unit, leg = _unit(recording, joint)
    positions, orientations = recording.forward()
    rotations = _segments(recording, dialect, joint, orientations)
    start = dialect.blend if _is_t_pose(rotations[0]) else 0
    if len(recording) <= start:
        raise ValueError(f"{recording.path}: expected frames after the T-pose it begins with, found none")
    positions = positions[start:] @ _CANONICAL_FROM_FILE.T * _UNITS[unit]
    hips, ankles = (positions[:, [joint[f"l_{part}"], joint[f"r_{part}"]]] for part in ("thigh", "foot"))
    level, height = level_floor(ankles, recording.fps, _ANKLE_OF_LEG * leg)
    rotations = level @ rotations[start:]
    for foot, ankle in zip(("l_foot", "r_foot"), (ankles @ level.T).swapaxes(0, 1), strict=True):
        segment = SEGMENTS.index(foot)
        rotations[:, segment] = lay_soles(rotations[:, segment], ankle[:, 2] - height, _ANKLE_OF_LEG * leg)
    return Motion(
        name=f"{recording.path.stem} ({dialect.name}, {unit}, {recording.fps:.4g} fps)",
        fps=recording.fps,
        root=hips.mean(1) @ level.T - (0, 0, height),
        rotations=rotations,
        hip_height=(1 + _ANKLE_OF_LEG) * leg,
    )


def _unit(recording: Recording, joint: dict[str, int]) -> tuple[str, float]:
    """The file's unit, and the length of thigh and shin together, m, mean of both legs."""
    limbs = [joint[f"{side}_{part}"] for side in "lr" for part in ("shin", "foot")]
    length = float(np.linalg.norm(recording.offsets[limbs], axis=1).sum()) / 2
    for unit, metres in _UNITS.items():
        if _LEGS[0] < length * metres < _LEGS[1]:
            return unit, length * metres
    raise ValueError(
        f"{recording.path}: expected thigh and shin of {_LEGS[0]} to {_LEGS[1]} m together, found {length:.4g} units, "
        f"which is no human leg in any of {', '.join(_UNITS)}"
    )


def _segments(recording: Recording, dialect: Dialect, joint: dict[str, int], orientations: np.ndarray) -> np.ndarray:
    """(F, 16, 3, 3) orientations of the canonical segments, on the file's floor."""
    # W G(t) G_rest^-1 W^-1: in our axes, and the identity in the T-pose.
    since_rest = {
        part: _CANONICAL_FROM_FILE @ orientations[:, joint[part]] @ dialect.rest_of(part).T @ _CANONICAL_FROM_FILE.T
        for part in SEGMENTS
    }
    rotations = np.stack(list(since_rest.values()), axis=1)
    for side, outward in (("l", 1.0), ("r", -1.0)):
        for part, end, axis in (
            ("upper_arm", "forearm", (0, outward, 0)),
            ("forearm", "wrist", (0, outward, 0)),
            ("hand", "knuckle", (0, outward, 0)),
            ("thigh", "shin", (0, 0, -1)),
            ("shin", "foot", (0, 0, -1)),
        ):
            segment = f"{side}_{part}"
            bone = dialect.rest_of(segment) @ recording.offsets[joint[f"{side}_{end}"]]
            along = since_rest[segment] @ (_CANONICAL_FROM_FILE @ bone)
            turns_with = f"{side}_hand" if part == "forearm" else segment
            forward = since_rest[turns_with] @ (_ELBOW_BENDS_TO if part == "upper_arm" else _FORWARD)
            rotations[:, SEGMENTS.index(segment)] = aligned(along, forward, axis)
    return rotations


def _is_t_pose(rotations: np.ndarray) -> bool:
    """Whether arms stretch sideways and legs down, seen from the pelvis, to within 25 degrees; (16, 3, 3)."""
    turned = rotations[0].T @ rotations
    arms = turned[[SEGMENTS.index(f"{side}_{part}") for side in "lr" for part in ("upper_arm", "forearm")], 1, 1]
    legs = turned[[SEGMENTS.index(f"{side}_{part}") for side in "lr" for part in ("thigh", "shin")], 2, 2]
    return bool(min(*arms, *legs) > np.cos(np.radians(25)))
