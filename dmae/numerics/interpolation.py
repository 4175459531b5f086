"""Interpolation and smoothing of samples over time.

Values are (F, ..., C), one row a frame; a sample of which any component is NaN is missing.
"""

from collections.abc import Callable
from math import prod

import numpy as np
from scipy.ndimage import correlate1d

from dmae.numerics.compiled import compiled
from dmae.numerics.gaps import neighbours

Interpolation = Callable[[np.ndarray], np.ndarray]
"""Fills the gaps of (F, ..., C) between samples; before the first and after the last sample it extrapolates."""


def hold(values: np.ndarray) -> np.ndarray:
    """Fill each gap with the sample before it; before the first sample, with the first."""
    before, after = neighbours(~np.isnan(values).any(-1))
    return take_frames(values, np.where(before >= 0, before, after))


def linear(values: np.ndarray) -> np.ndarray:
    """Fill each gap with a straight line; hold the first and the last sample beyond them."""
    flat = _columns(values)
    return _linear(flat, *neighbours(~np.isnan(flat).any(-1)), np.nan).reshape(values.shape)


def connect(values: np.ndarray) -> np.ndarray:
    """Return what `linear` does, and 0 where there is no sample at all."""
    flat = _columns(values)
    return _linear(flat, *neighbours(~np.isnan(flat).any(-1)), 0.0).reshape(values.shape)


@compiled()
def _linear(values, before, after, unknown):
    """Return (F, n, C) with straight lines in gaps; `before` and `after` (F, n) are the samples on both sides."""
    frames, columns, components = values.shape
    filled = np.full(values.shape, unknown)
    for frame in range(frames):
        for column in range(columns):
            start, end = before[frame, column], after[frame, column]
            if start < 0:
                start = end
            elif end == frames:
                end = start
            if start == frames:
                continue
            weight = (frame - start) / (end - start) if end > start else 0.0
            for k in range(components):
                first = values[start, column, k]
                filled[frame, column, k] = first + weight * (values[end, column, k] - first)
    return filled


def pchip(values: np.ndarray) -> np.ndarray:
    """Fill each gap with a monotone cubic (Fritsch & Butland 1984); hold the first and the last sample beyond them."""
    flat = _columns(values)
    return _pchip(flat, *neighbours(~np.isnan(flat).any(-1))).reshape(values.shape)


@compiled()
def _pchip(values, before, after):
    """Return (F, n, C) with monotone cubics in gaps; `before` and `after` (F, n) are the samples on both sides."""
    frames, columns, components = values.shape
    filled = np.full(values.shape, np.nan)
    times = np.empty(4, np.int64)
    for frame in range(frames):
        for column in range(columns):
            low, high = before[frame, column], after[frame, column]
            if low == high or low < 0 or high == frames:
                edge = low if low >= 0 else high
                if edge < frames:
                    filled[frame, column] = values[edge, column]
                continue
            times[1], times[2] = low, high
            times[0] = before[low - 1, column] if low > 0 else -1
            times[3] = after[high + 1, column] if high < frames - 1 else frames
            for k in range(components):
                first = values[times[0], column, k] if times[0] >= 0 else np.nan
                last = values[times[3], column, k] if times[3] < frames else np.nan
                filled[frame, column, k] = _cubic(
                    times, first, values[low, column, k], values[high, column, k], last, frame
                )
    return filled


def surrounding_frames(
    before: np.ndarray, after: np.ndarray, frame: np.ndarray, column: np.ndarray, reach: int = 0
) -> np.ndarray:
    """Return the frames of the two samples before and the two after each of n frames, (4, n).

    Args:
        before: (F, C), and `after`, (F, C): `dmae.numerics.gaps.neighbours` of C columns of samples.
        frame: (n,), and `column`, (n,): the frames to look around.
        reach: Samples nearer than this many frames are skipped.

    Returns:
        Negative, or F or more, where there is no such sample.
    """
    frames = len(before)

    def last(f: np.ndarray) -> np.ndarray:
        return np.where(f >= 0, before[np.maximum(f, 0), column], -1)

    def first(f: np.ndarray) -> np.ndarray:
        return np.where(f < frames, after[np.minimum(f, frames - 1), column], frames)

    low, high = last(frame - reach), first(frame + reach)
    return np.stack([last(low - 1), low, high, first(high + 1)])


def take_samples(values: np.ndarray, times: np.ndarray, column: np.ndarray) -> np.ndarray:
    """Return the samples (k, n, C) of values (F, columns, C) at frames (k, n); NaN where there is no such frame."""
    inside = (times >= 0) & (times < len(values))
    taken = values[np.where(inside, times, 0), column]
    return np.where(inside[..., None], taken, np.nan)


def pchip_between(times: np.ndarray, values: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Return the monotone cubic through four samples each, between the second and the third, (n, C).

    Slopes are harmonic means of those of the straight lines on both sides (Fritsch & Butland 1984). Where the first
    or the fourth sample is missing the slope is that of a parabola through three, limited to stay monotone; with two
    samples the cubic is a line.

    Args:
        times: (4, n) increasing; values: (4, n, C), the first and the fourth NaN where there is none.
        at: (n,)
    """
    return _pchip_between(np.ascontiguousarray(times), np.ascontiguousarray(values, np.float64), at)


@compiled()
def _pchip_between(times, values, at):
    """Return the cubics at times (n,), (n, C)."""
    found = np.empty(values.shape[1:])
    for i in range(found.shape[0]):
        for k in range(found.shape[1]):
            found[i, k] = _cubic(times[:, i], values[0, i, k], values[1, i, k], values[2, i, k], values[3, i, k], at[i])
    return found


@compiled()
def _cubic(times, before, start, end, after, at):
    """Return the cubic of `pchip_between` for one component."""
    h0, h1, h2 = float(times[1] - times[0]), float(times[2] - times[1]), float(times[3] - times[2])
    m0, m1, m2 = (start - before) / h0, (end - start) / h1, (after - end) / h2
    first = _end_slope(h1, m1, h2, m2) if np.isnan(before) else _slope(h0, m0, h1, m1)
    last = _end_slope(h1, m1, h0, m0) if np.isnan(after) else _slope(h1, m1, h2, m2)
    s = (at - times[1]) / h1
    return start + h1 * (m1 * s + s * (1 - s) * ((1 - s) * (first - m1) - s * (last - m1)))


@compiled()
def _slope(h0, m0, h1, m1):
    """Return the slope at a sample between lines of slopes m0 and m1 over times h0 and h1."""
    if not m0 * m1 > 0:
        return 0.0
    first, second = 2 * h1 + h0, h1 + 2 * h0
    # Written without quotients of slopes, which may be close to zero.
    return (first + second) * m0 * m1 / (first * m1 + second * m0)


@compiled()
def _end_slope(h0, m0, h1, m1):
    """Return the slope at the outer end of a line of slope m0 with a neighbour of slope m1, or NaN."""
    if np.isnan(m1):
        return m0
    slope = ((2 * h0 + h1) * m0 - h0 * m1) / (h0 + h1)
    if m0 * m1 <= 0 and abs(slope) > 3 * abs(m0):
        slope = 3 * m0
    return 0.0 if slope * m0 <= 0 else slope


def take_frames(values: np.ndarray, frame: np.ndarray) -> np.ndarray:
    """Return values (F, ..., C) of other frames (F, ...); NaN where there is no such frame."""
    flat = _columns(values)
    at = np.ascontiguousarray(frame).reshape(len(frame), flat.shape[1])
    return _take_frames(flat, at).reshape(*frame.shape, values.shape[-1])


@compiled()
def _take_frames(values, frame):
    """Return values (F, n, C) of frames (m, n)."""
    taken = np.full((len(frame), values.shape[1], values.shape[2]), np.nan)
    for i in range(len(frame)):
        for column in range(values.shape[1]):
            if 0 <= frame[i, column] < len(values):
                taken[i, column] = values[frame[i, column], column]
    return taken


def _columns(values: np.ndarray) -> np.ndarray:
    """Return (F, ..., C) as (F, n, C), float64 in rows."""
    flat = values.reshape(len(values), prod(values.shape[1:-1]), values.shape[-1])
    return np.ascontiguousarray(flat, np.float64)


def local_parabola(values: np.ndarray, reach: float, frames: slice = slice(None)) -> np.ndarray:
    """Smooth by weighted least squares; missing samples stay missing.

    Args:
        reach: Standard deviation of the weights, frames.
        frames: Those that are smoothed and returned.
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
    # One or two samples do not determine a parabola; the ridge selects the flattest.
    left = left + np.diag([0, 1e-6, 1e-6]) + np.where(observed, 0, 1)[..., None, None] * np.eye(3)
    return np.where(observed[..., None], np.linalg.solve(left, right)[..., 0, :], np.nan)
