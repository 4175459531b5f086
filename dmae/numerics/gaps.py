"""Gaps: the last and the next observed frame of samples, and the lengths of gaps."""

from math import prod

import numpy as np

from dmae.numerics.compiled import compiled


def neighbours(observed: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the nearest observed frames before and after each frame, (F, ...) each, for `observed` (F, ...) bool.

    A frame that is observed is returned itself. The frame before is -1 if there is none; the frame after is F.
    """
    flat = np.ascontiguousarray(observed).reshape(len(observed), prod(observed.shape[1:]))
    before, after = _neighbours(flat)
    return before.reshape(observed.shape), after.reshape(observed.shape)


@compiled()
def _neighbours(observed):
    """Return the result of `neighbours` for `observed` (F, n)."""
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
    """Return the length of the gap around each entry of `observed` (F, ...), frames; 0 where it is observed."""
    before, after = neighbours(observed)
    return np.where(observed, 0, after - before - 1)
