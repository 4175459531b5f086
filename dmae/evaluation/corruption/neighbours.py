"""The nearest other detection of each detection in the image."""

import numpy as np


def nearest_other(xy: np.ndarray) -> np.ndarray:
    """Return the index (F, V, D) of the nearest other detection in the image; its own index if there is no other.

    Args:
        xy: (F, V, D, J, 2) px.
    """
    middle = _middle(xy)
    distance = np.linalg.norm(middle[:, :, :, None] - middle[:, :, None], axis=-1)
    here = np.arange(xy.shape[2])
    distance[:, :, here, here] = np.inf
    distance = np.where(np.isnan(distance), np.inf, distance)
    if not xy.shape[2]:
        return np.zeros(xy.shape[:3], int)
    return np.where(np.isfinite(distance.min(-1)), distance.argmin(-1), here)


def _middle(xy: np.ndarray) -> np.ndarray:
    """Return the middle (F, V, D, 2) of the box around each detection, px; NaN where there is none."""
    known = ~np.isnan(xy)
    low, high = np.where(known, xy, np.inf).min(-2), np.where(known, xy, -np.inf).max(-2)
    any_known = known.any(-2)
    return np.where(any_known, (np.where(any_known, low, 0) + np.where(any_known, high, 0)) / 2, np.nan)
