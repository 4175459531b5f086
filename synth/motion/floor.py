"""The floor under recorded feet: where it is, and how soles lie on it."""

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from synth.motion.rotations import about


def level_floor(ankles: np.ndarray, fps: float, ankle_height: float) -> tuple[np.ndarray, float]:
    """What makes the floor level and puts it at z = 0: a rotation (3, 3), then a height to subtract, m.

    Recorded floors lie up to 7 cm beside zero and tilt by up to 2 cm a metre, which is calibration error, not a slope.
    The floor is the plane `ankle_height` below the ankles wherever one has stood for 0.1 s as the lower of the two,
    fitted robustly. A prior of one degree holds down the tilt, of which those who stay on the spot tell nothing.

    Args:
        ankles: (F, 2, 3) m, z roughly up.
        fps: Frames per second.
        ankle_height: Of an ankle over its flat foot, m.
    """
    speed = np.linalg.norm(np.gradient(ankles, 1 / fps, axis=0), axis=2) if len(ankles) > 1 else np.zeros((1, 2))
    standing = (speed < 0.15) & (ankles[..., 2] < ankles[..., 2].min(1, keepdims=True) + 0.05)
    spots = []
    for foot in range(2):
        edges = np.flatnonzero(np.diff(standing[:, foot], prepend=False, append=False))
        for first, last in zip(edges[::2], edges[1::2], strict=True):
            if last - first >= 0.1 * fps:
                spots.append(np.median(ankles[first:last, foot], axis=0))
    if not spots:
        return np.eye(3), float(np.percentile(ankles[..., 2].min(1), 5)) - ankle_height
    spots = np.array(spots)
    centre = spots.mean(0)

    def residuals(plane: np.ndarray) -> np.ndarray:
        misses = spots[:, 2] - plane[0] - (spots - centre)[:, :2] @ plane[1:]
        # Each in units of its expected size: 1 cm, 1 degree.
        return np.concatenate([misses / 0.01, plane[1:] / np.radians(1)])

    height, *slope = least_squares(residuals, (np.median(spots[:, 2]), 0, 0), loss="soft_l1").x
    level = Rotation.align_vectors([(0, 0, 1)], [(-slope[0], -slope[1], 1)])[0].as_matrix()
    return level, float((level @ (*centre[:2], height))[2]) - ankle_height


def lay_soles(feet: np.ndarray, heights: np.ndarray, ankle_height: float) -> np.ndarray:
    """Feet turned about their length so that soles near the floor lie on it.

    The skeletons of CMU's recordings have ankles that cannot tilt sideways, so that their soles lean with the shins,
    by 35 degrees in a wide stance. Within 2 cm of where a standing ankle is the sole is made level, from 12 cm on left
    as it is.

    Args:
        feet: (F, 3, 3) orientations.
        heights: (F,) of the ankles over the floor, m.
        ankle_height: Of an ankle over its flat foot, m.
    """
    lean = np.arctan2(feet[:, 2, 1], feet[:, 2, 2])
    # A foot that stands on its toes has no sideways lean to speak of.
    share = np.hypot(feet[:, 2, 1], feet[:, 2, 2]) * np.clip((ankle_height + 0.12 - heights) / 0.10, 0, 1)
    return feet @ about("x", -share * np.clip(lean, -np.radians(35), np.radians(35)))
