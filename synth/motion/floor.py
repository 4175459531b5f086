"""Find the floor of a recording, level it, and lay the soles flat on it."""

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from synth.motion.rotations import about

_STANDING_SPEED = 0.15
"""Greatest speed of the ankle of a standing foot, m/s."""
_STANDING_TIME = 0.1
"""Least time for which a foot stands to show where the floor is, s."""
_LEVEL = 0.12
"""Greatest height of standing feet over the lowest standing feet that the tilt and noise of a floor explain, m; feet
above this height stand on something else."""
_LOWEST = 0.05
"""Least share of the standing feet that form the lowest level, and at least two feet; fewer are recording errors."""


def level_floor(ankles: np.ndarray, fps: float, ankle_height: float) -> tuple[np.ndarray, float]:
    """Fit the floor of a recording.

    Recorded floors are up to 7 cm away from zero height and tilt by up to 2 cm per metre. This is a calibration error,
    not a slope. The floor is fitted robustly as the plane at `ankle_height` below the standing ankles. An ankle stands
    if it stays in place for at least 0.1 s and is at most 5 cm above the lower ankle. Only the lowest level counts,
    because feet that stand higher are on steps, platforms or bars. A prior of one degree limits the tilt: the data do
    not determine it if a person stays on one spot.

    Args:
        ankles: (F, 2, 3) m, z roughly up.
        fps: Frames per second.
        ankle_height: Height of an ankle above its flat foot, m.

    Returns:
        (3, 3) rotation that levels the floor, and the height to subtract after the rotation, m.
    """
    speed = np.linalg.norm(np.gradient(ankles, 1 / fps, axis=0), axis=2) if len(ankles) > 1 else np.zeros((1, 2))
    standing = (speed < _STANDING_SPEED) & (ankles[..., 2] < ankles[..., 2].min(1, keepdims=True) + 0.05)
    spots = []
    for foot in range(2):
        edges = np.flatnonzero(np.diff(standing[:, foot], prepend=False, append=False))
        for first, last in zip(edges[::2], edges[1::2], strict=True):
            if last - first >= _STANDING_TIME * fps:
                spots.append(np.median(ankles[first:last, foot], axis=0))
    if not spots:
        return np.eye(3), float(np.percentile(ankles[..., 2].min(1), 5)) - ankle_height
    spots = np.array(spots)
    spots = spots[_on_lowest_level(spots[:, 2])]
    centre = spots.mean(0)

    def residuals(plane: np.ndarray) -> np.ndarray:
        misses = spots[:, 2] - plane[0] - (spots - centre)[:, :2] @ plane[1:]
        # Each residual is in units of its expected size: 1 cm or 1 degree.
        return np.concatenate([misses / 0.01, plane[1:] / np.radians(1)])

    height, *slope = least_squares(residuals, (np.median(spots[:, 2]), 0, 0), loss="soft_l1").x
    level = Rotation.align_vectors([(0, 0, 1)], [(-slope[0], -slope[1], 1)])[0].as_matrix()
    return level, float((level @ (*centre[:2], height))[2]) - ankle_height


def _on_lowest_level(heights: np.ndarray) -> np.ndarray:
    """Return which heights (K,) of standing ankles are on the lowest level that enough ankles share, (K,) bool."""
    ordered = np.sort(heights)
    enough = min(max(2, _LOWEST * len(ordered)), len(ordered))
    shared = np.searchsorted(ordered, ordered + _LEVEL, side="right") - np.arange(len(ordered)) >= enough
    # If no two heights share a level, the lowest height alone is the level.
    lowest = ordered[shared.argmax()] if shared.any() else ordered[0]
    return (heights >= lowest) & (heights <= lowest + _LEVEL)


def flatten_soles(feet: np.ndarray, heights: np.ndarray, ankle_height: float) -> np.ndarray:
    """Return feet turned about their length so that soles near the floor are flat on it.

    The ankles of CMU's skeletons cannot tilt sideways, so soles lean with the shins, by 35 degrees in a wide stance.
    A sole is fully levelled if its ankle is at most 2 cm above the height of a standing ankle. The correction fades out
    up to 12 cm.

    Args:
        feet: (F, 3, 3) orientations, world.
        heights: (F,) of the ankles above the floor, m.
        ankle_height: Height of an ankle above its flat foot, m.

    Returns:
        (F, 3, 3) orientations.
    """
    lean = np.arctan2(feet[:, 2, 1], feet[:, 2, 2])
    # The sideways lean is undefined for a foot that stands on its toes.
    share = np.hypot(feet[:, 2, 1], feet[:, 2, 2]) * np.clip((ankle_height + 0.12 - heights) / 0.10, 0, 1)
    return feet @ about("x", -share * np.clip(lean, -np.radians(35), np.radians(35)))
