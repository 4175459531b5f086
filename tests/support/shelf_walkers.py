"""Walkers on the joints of Shelf, to score predictions of."""

import numpy as np

from dmae.data.skeleton import SHELF14
from tests.support.clips import walkers


def people(frames: int = 6, persons: int = 2) -> np.ndarray:
    """(F, P, 14, 3) m."""
    return walkers(frames, persons, SHELF14).xyz.astype(float)


def aside(xyz: np.ndarray, metres: float) -> np.ndarray:
    """Move points along x."""
    return xyz + np.array([metres, 0, 0])
