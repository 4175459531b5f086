"""Gaps: where in time a sample was last, and is next, observed, and for how long it is not."""

from math import prod

import numpy as np

from dmae.numerics.compiled import compiled


def neighbours(observed: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the last observed frame up to each (-1: none) and the first from it on (F: none), of (F, ...) bool."""
    flat = np.ascontiguousarray(observed).reshape(len(observed), prod(observed.shape[1:]))
    before, after = _neighbours(flat)
    return before.reshape(observed.shape), after.reshape(observed.shape)


@compiled()
def _neighbours(observed):
    """Return the last and the next observed frame of (F, n)."""
    frames, columns = observed.shape
    before, after = np.empty((frames, columns), np.int64), np.empty((frames, columns), np.int64)
    for frame in range(frames):
        for column in range(columns):
            if observed[frame, column]:
                before[frame, column] = frame
            else:
                before[frame, column] = before[frame - 1, column] if frame else -1
    for frame in range(frames - 1, -1, -1):
        for column in range(columns):
            if observed[frame, column]:
                after[frame, column] = frame
            else:
                after[frame, column] = after[frame + 1, column] if frame < frames - 1 else frames
    return before, after


def gap_lengths(observed: np.ndarray) -> np.ndarray:
    """Return the length in frames of the gap around each entry of `observed` (F, ...); 0 where it is observed."""
    before, after = neighbours(observed)
    return np.where(observed, 0, after - before - 1)
