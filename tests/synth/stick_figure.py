"""A body of fixed proportions, independent of the generator's, to compare motions by where joints go."""

import numpy as np

from synth.motion import PARENTS, SEGMENTS, Motion
from synth.motion.legs import ANKLE, HALF_HIPS, HEEL, HIP_HEIGHT, SHIN, THIGH, TIP

_STARTS = {
    "pelvis": (0, 0, 0), "spine": (0, 0, 0.10), "chest": (0, 0, 0.16), "head": (0, 0, 0.26),
    "upper_arm": (0, 0.17, 0.20), "forearm": (0, 0.29, 0), "hand": (0, 0.25, 0),
    "thigh": (0, HALF_HIPS, 0), "shin": (0, 0, -THIGH), "foot": (0, 0, -SHIN),
}  # fmt: skip


def joints(motion: Motion) -> np.ndarray:
    """(F, 16, 3) where each segment starts, m."""
    places = np.empty((len(motion), len(SEGMENTS), 3))
    places[:, 0] = motion.root * HIP_HEIGHT / motion.hip_height
    for i, segment in enumerate(SEGMENTS[1:], 1):
        start = np.array(_STARTS[segment.removeprefix("l_").removeprefix("r_")])
        start = start * (1, -1, 1) if segment.startswith("r_") else start
        places[:, i] = places[:, PARENTS[i]] + motion.rotations[:, PARENTS[i]] @ start
    return places


def soles(motion: Motion) -> np.ndarray:
    """(F, 2, 2, 3) left and right foot, heel and tip of the sole, m."""
    places = joints(motion)
    feet = _both("foot")
    points = np.array([(HEEL, 0, -ANKLE), (TIP, 0, -ANKLE)])
    return places[:, feet, None] + np.einsum("flij,pj->flpi", motion.rotations[:, feet], points)


def knees(motion: Motion) -> np.ndarray:
    """(F, 2) flexion of left and right knee, rad; negative if it bends forward."""
    shins = -_seen_from(motion, "thigh", "shin")[..., 2]
    return np.arctan2(-shins[..., 0], -shins[..., 2])


def elbows(motion: Motion) -> np.ndarray:
    """(F, 2) flexion of left and right elbow, rad; negative if it bends backward."""
    forearms = _seen_from(motion, "upper_arm", "forearm")[..., 1]
    return np.arctan2(forearms[..., 0] * (1, -1), forearms[..., 1])


def thighs(motion: Motion) -> np.ndarray:
    """(F, 2) angle of left and right thigh forward of the pelvis's vertical, rad."""
    pelvis = motion.rotations[:, None, SEGMENTS.index("pelvis")]
    down = -(pelvis.swapaxes(-1, -2) @ motion.rotations[:, _both("thigh")])[..., 2]
    return np.arctan2(down[..., 0], -down[..., 2])


def _both(part: str) -> list[int]:
    return [SEGMENTS.index(f"{side}_{part}") for side in "lr"]


def _seen_from(motion: Motion, upper: str, lower: str) -> np.ndarray:
    """(F, 2, 3, 3) orientations of left and right lower limb in the frame of the upper."""
    return motion.rotations[:, _both(upper)].swapaxes(-1, -2) @ motion.rotations[:, _both(lower)]
