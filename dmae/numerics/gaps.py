"""Gaps: where in time a sample was last, and is next, observed, and for how long it is not."""

import numpy as np


def neighbours(observed: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the last observed frame up to each (-1: none) and the first from it on (F: none), of (F, ...) bool."""
    index = np.arange(len(observed)).reshape(-1, *(1,) * (observed.ndim - 1))
    before = np.maximum.accumulate(np.where(observed, index, -1), 0)
    after = np.minimum.accumulate(np.where(observed, index, len(observed))[::-1], 0)[::-1]
    return before, after


def gap_lengths(observed: np.ndarray) -> np.ndarray:
    """Return the length in frames of the gap around each entry of `observed` (F, ...); 0 where it is observed."""
    before, after = neighbours(observed)
    return np.where(observed, 0, after - before - 1)
