"""Paths over time: find their gaps, fill them by interpolation, and smooth them.

Values are (F, ..., C), one row per frame. A sample is missing if one of its C components is NaN.
"""

from collections.abc import Callable
from math import prod

import numpy as np
from scipy.ndimage import correlate1d

from dmae.numerics.compiled import compiled


def neighbours(observed: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the nearest observed frame, itself included, before (or -1) and after (or F) each, for (F, ...) bool."""
    index, frames = _index(observed), len(observed)
    before = np.maximum.accumulate(np.where(observed, index, -1), 0)
    after = np.minimum.accumulate(np.where(observed, index, frames)[::-1], 0)[::-1]
    return before, np.ascontiguousarray(after)


def _index(observed: np.ndarray) -> np.ndarray:
    """Return the frame of each row of (F, ...), as an array (F, 1, ...)."""
    return np.arange(len(observed)).reshape(-1, *(1,) * (observed.ndim - 1))


NEVER = 1 << 40
"""Frames to a sample that does not exist."""


def frames_away(observed: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the frames since each entry of `observed` (F, ...) was True, and until it is; `NEVER` where it is not."""
    before, after = neighbours(observed)
    index = _index(observed)
    return np.where(before < 0, NEVER, index - before), np.where(after == len(observed), NEVER, after - index)


def gap_lengths(observed: np.ndarray) -> np.ndarray:
    """Return the length of the gap around each entry of `observed` (F, ...), frames; 0 where it is observed."""
    before, after = neighbours(observed)
    return np.where(observed, 0, after - before - 1)


def runs(flags: np.ndarray) -> list[tuple[int, int]]:
    """Return the first frame of each run of True in flags (F,), and the frame after its last."""
    edges = np.flatnonzero(np.diff(np.r_[0, flags, 0]))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))


Interpolation = Callable[[np.ndarray], np.ndarray]
"""Function that fills the gaps of values (F, ..., C): between samples, before the first and after the last sample."""


def hold(values: np.ndarray) -> np.ndarray:
    """Return values with each gap filled by the sample before it, and frames before the first sample by the first."""
    before, after = neighbours(~np.isnan(values).any(-1))
    return take_frames(values, np.where(before >= 0, before, after))


def linear(values: np.ndarray) -> np.ndarray:
    """Return values with each gap filled by a straight line. The first and last sample fill the frames outside them."""
    values = np.asarray(values, np.float64)
    before, after = neighbours(~np.isnan(values).any(-1))
    start, end = np.where(before < 0, after, before), np.where(after == len(values), before, after)
    weight = (_index(start) - start) / np.maximum(end - start, 1)
    first = take_frames(values, start)
    return first + weight[..., None] * (take_frames(values, end) - first)


def connect(values: np.ndarray) -> np.ndarray:
    """Return the same as `linear`, but 0 instead of NaN where there is no sample in any frame."""
    return np.nan_to_num(linear(values))


def pchip(values: np.ndarray) -> np.ndarray:
    """Return values with each gap filled by a monotone cubic (Fritsch & Butland 1984), ends by the outer samples."""
    flat = _columns(values)
    return _pchip(flat, *neighbours(~np.isnan(flat).any(-1))).reshape(values.shape)


@compiled()
def _pchip(values, before, after):
    """Return values (F, n, C) with monotone cubics in gaps; `before` and `after` (F, n) as of `neighbours`."""
    frames, columns, components = values.shape
    filled = np.full(values.shape, np.nan)
    for frame in range(frames):
        for column in range(columns):
            low, high = before[frame, column], after[frame, column]
            if low == high or low < 0 or high == frames:
                edge = low if low >= 0 else high
                if edge < frames:
                    for k in range(components):
                        filled[frame, column, k] = values[edge, column, k]
                continue
            for k in range(components):
                filled[frame, column, k] = cubic_between(values, before, after, low, high, column, k, frame)
    return filled


@compiled()
def cubic_between(values, before, after, low, high, column, k, frame):
    """Return component k of a column of values (F, n, C) at a frame, on the monotone cubic from sample `low` to `high`.

    The slope at a sample is the weighted harmonic mean of the slopes of the straight lines on both sides (Fritsch &
    Butland 1984). If there is no sample before `low` or after `high`, the slope there is the slope of a parabola
    through three samples, limited so that the cubic stays monotone. With only two samples the cubic is a straight line.
    `before` and `after` (F, n) are results of `neighbours`.
    """
    earlier = before[low - 1, column] if low > 0 else -1
    later = after[high + 1, column] if high < len(values) - 1 else len(values)
    start, end = values[low, column, k], values[high, column, k]
    first = values[earlier, column, k] if earlier >= 0 else np.nan
    last = values[later, column, k] if later < len(values) else np.nan
    h0, h1, h2 = float(low - earlier), float(high - low), float(later - high)
    m0, m1, m2 = (start - first) / h0, (end - start) / h1, (last - end) / h2
    at_start = _end_slope(h1, m1, h2, m2) if np.isnan(first) else _slope(h0, m0, h1, m1)
    at_end = _end_slope(h1, m1, h0, m0) if np.isnan(last) else _slope(h1, m1, h2, m2)
    s = (frame - low) / h1
    return start + h1 * (m1 * s + s * (1 - s) * ((1 - s) * (at_start - m1) - s * (at_end - m1)))


@compiled()
def _slope(h0, m0, h1, m1):
    """Return the slope at a sample between two lines, with slopes m0 and m1 and durations h0 and h1."""
    if not m0 * m1 > 0:
        return 0.0
    first, second = 2 * h1 + h0, h1 + 2 * h0
    # This form avoids division by a slope, which can be close to zero.
    return (first + second) * m0 * m1 / (first * m1 + second * m0)


@compiled()
def _end_slope(h0, m0, h1, m1):
    """Return the slope at the outer end of a line with slope m0, duration h0, next to a line m1, h1; m1 may be NaN."""
    if np.isnan(m1):
        return m0
    slope = ((2 * h0 + h1) * m0 - h0 * m1) / (h0 + h1)
    if m0 * m1 <= 0 and abs(slope) > 3 * abs(m0):
        slope = 3 * m0
    return 0.0 if slope * m0 <= 0 else slope


def take_frames(values: np.ndarray, frame: np.ndarray) -> np.ndarray:
    """Return, for each entry of `frame` (F, ...), the value of that frame in values (F, ..., C), or NaN."""
    flat = _columns(values)
    at = frame.reshape(len(frame), flat.shape[1])
    inside = (at >= 0) & (at < len(flat))
    taken = flat[np.where(inside, at, 0), np.arange(flat.shape[1])]
    taken[~inside] = np.nan
    return taken.reshape(*frame.shape, values.shape[-1])


def _columns(values: np.ndarray) -> np.ndarray:
    """Return values (F, ..., C) as a contiguous float64 array (F, n, C)."""
    flat = values.reshape(len(values), prod(values.shape[1:-1]), values.shape[-1])
    return np.ascontiguousarray(flat, np.float64)


def local_parabola(values: np.ndarray, reach: float, frames: slice = slice(None)) -> np.ndarray:
    """Return some frames of values (F, ..., C) smoothed by a parabola around each frame; missing samples stay so.

    `reach` is the standard deviation, frames, of its Gaussian weights.
    """
    observed = ~np.isnan(values).any(-1)
    lag = np.arange(-int(np.ceil(3 * reach)), int(np.ceil(3 * reach)) + 1) / reach
    known = np.where(observed[..., None], values, 0)

    def moment(array: np.ndarray, power: int) -> np.ndarray:
        return correlate1d(array, np.exp(-0.5 * lag**2) * lag**power, axis=0, mode="constant")[frames]

    moments = [moment(observed.astype(float), power) for power in range(5)]
    left = np.stack([np.stack(moments[row : row + 3], -1) for row in range(3)], -2)
    right = np.stack([moment(known, power) for power in range(3)], -2)
    observed = observed[frames]
    # One or two samples do not determine a parabola. The small ridge selects the flattest one.
    left = left + np.diag([0, 1e-6, 1e-6]) + np.where(observed, 0, 1)[..., None, None] * np.eye(3)
    return np.where(observed[..., None], np.linalg.solve(left, right)[..., 0, :], np.nan)
