"""Where in time something was last, and is next, observed."""

import numpy as np


def neighbours(observed: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Of (F, ...) bool: the last observed frame up to each (-1: none) and the first from it on (F: none)."""
    index = np.arange(len(observed)).reshape(-1, *(1,) * (observed.ndim - 1))
    before = np.maximum.accumulate(np.where(observed, index, -1), 0)
    after = np.minimum.accumulate(np.where(observed, index, len(observed))[::-1], 0)[::-1]
    return before, after
