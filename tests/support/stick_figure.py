"""A body of fixed proportions, independent of the generator's, to compare motions by their joints."""

import numpy as np

from synth.motion.motion import Motion
from synth.motion.procedural.trajectory import ANKLE, HALF_HIPS, HEEL, HIP_HEIGHT, SHIN, THIGH, TIP
from synth.people.body import PARENTS, SEGMENTS

_STARTS = {
    "pelvis": (0, 0, 0), "spine": (0, 0, 0.10), "chest": (0, 0, 0.16), "head": (0, 0, 0.26),
    "upper_arm": (0, 0.17, 0.20), "forearm": (0, 0.29, 0), "hand": (0, 0.25, 0),
    "thigh": (0, HALF_HIPS, 0), "shin": (0, 0, -THIGH), "foot": (0, 0, -SHIN),
}  # fmt: skip


def joints(motion: Motion) -> np.ndarray:
    """Return the origin of each segment, (F, 16, 3) m."""
    places = np.empty((len(motion), len(SEGMENTS), 3))
    places[:, 0] = motion.root * HIP_HEIGHT / motion.hip_height
    for i, segment in enumerate(SEGMENTS[1:], 1):
        start = np.array(_STARTS[segment.removeprefix("l_").removeprefix("r_")])
        start = start * (1, -1, 1) if segment.startswith("r_") else start
        places[:, i] = places[:, PARENTS[i]] + motion.rotations[:, PARENTS[i]] @ start
    return places


def soles(motion: Motion) -> np.ndarray:
    """Return heel and tip of the soles of the left and the right foot, (F, 2, 2, 3) m."""
    places = joints(motion)
    feet = _both("foot")
    points = np.array([(HEEL, 0, -ANKLE), (TIP, 0, -ANKLE)])
    return places[:, feet, None] + np.einsum("flij,pj->flpi", motion.rotations[:, feet], points)


def knees(motion: Motion) -> np.ndarray:
    """Return the flexion of left and right knee, (F, 2) rad; negative if it bends forward."""
    shins = -_relative(motion, "thigh", "shin")[..., 2]
    return np.arctan2(-shins[..., 0], -shins[..., 2])


def elbows(motion: Motion) -> np.ndarray:
    """Return the flexion of left and right elbow, (F, 2) rad; negative if it bends backward."""
    forearms = _relative(motion, "upper_arm", "forearm")[..., 1]
    return np.arctan2(forearms[..., 0] * (1, -1), forearms[..., 1])


def thighs(motion: Motion) -> np.ndarray:
    """Return the angle of left and right thigh forward of the pelvis's vertical, (F, 2) rad."""
    pelvis = motion.rotations[:, None, SEGMENTS.index("pelvis")]
    down = -(pelvis.swapaxes(-1, -2) @ motion.rotations[:, _both("thigh")])[..., 2]
    return np.arctan2(down[..., 0], -down[..., 2])


def _both(part: str) -> list[int]:
    return [SEGMENTS.index(f"{side}_{part}") for side in "lr"]


def _relative(motion: Motion, upper: str, lower: str) -> np.ndarray:
    """Return the orientations of left and right lower limb in the frame of the upper, (F, 2, 3, 3)."""
    return motion.rotations[:, _both(upper)].swapaxes(-1, -2) @ motion.rotations[:, _both(lower)]
