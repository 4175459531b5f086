"""Samples over time with holes: what lies between them, and what they are less their noise.

Values are (F, ..., C), one frame after the other; a sample of which any component is NaN is a hole.
"""

from collections.abc import Callable
from math import prod

import numpy as np
from scipy.ndimage import correlate1d

from dmae.gaps import neighbours

Interpolation = Callable[[np.ndarray], np.ndarray]
"""Fills the holes of (F, ..., C) between samples, and somehow those before the first and after the last."""


def hold(values: np.ndarray) -> np.ndarray:
    """Each hole as it last was; before the first sample, as it first is."""
    before, after = neighbours(~np.isnan(values).any(-1))
    return take(values, np.where(before >= 0, before, after))


def linear(values: np.ndarray) -> np.ndarray:
    """A straight line through each hole; held before the first and after the last sample."""
    frames = len(values)
    before, after = neighbours(~np.isnan(values).any(-1))
    start = np.where(before >= 0, before, after)
    end = np.where(after < frames, after, before)
    index = np.arange(frames).reshape(-1, *(1,) * (before.ndim - 1))
    share = np.where(end > start, (index - start) / np.maximum(end - start, 1), 0)[..., None]
    first = take(values, start)
    return first + share * (take(values, end) - first)


def pchip(values: np.ndarray) -> np.ndarray:
    """A monotone cubic (Fritsch & Butland 1984) through each hole; held before the first and after the last sample."""
    frames = len(values)
    flat = values.reshape(frames, prod(values.shape[1:-1]), values.shape[-1])
    filled = hold(flat)
    before, after = neighbours(~np.isnan(flat).any(-1))
    frame, column = np.nonzero(np.isnan(flat).any(-1) & (before >= 0) & (after < frames))
    times = around(before, after, frame, column)
    filled[frame, column] = pchip_between(times, take_at(flat, times, column), frame)
    return filled.reshape(values.shape)


def around(before: np.ndarray, after: np.ndarray, frame: np.ndarray, column: np.ndarray, reach: int = 0) -> np.ndarray:
    """(4, n) frames of the two samples before and the two after each of n frames, none of them within `reach` frames.

    Args:
        before: (F, C), and `after`: what `dmae.gaps.neighbours` says of C columns.
        frame: (n,) and `column` (n,): where.

    Returns:
        Negative, or F or more, where there is none.
    """
    frames = len(before)

    def last(f: np.ndarray) -> np.ndarray:
        return np.where(f >= 0, before[np.maximum(f, 0), column], -1)

    def first(f: np.ndarray) -> np.ndarray:
        return np.where(f < frames, after[np.minimum(f, frames - 1), column], frames)

    low, high = last(frame - reach), first(frame + reach)
    return np.stack([last(low - 1), low, high, first(high + 1)])


def take_at(values: np.ndarray, times: np.ndarray, column: np.ndarray) -> np.ndarray:
    """(k, n, C) the samples of (F, columns, C) at frames (k, n); NaN where there is no such frame."""
    inside = (times >= 0) & (times < len(values))
    taken = values[np.where(inside, times, 0), column]
    return np.where(inside[..., None], taken, np.nan)


def pchip_between(times: np.ndarray, values: np.ndarray, at: np.ndarray) -> np.ndarray:
    """(n, C) the monotone cubic through four samples each, between the second and the third.

    Slopes are harmonic means of those of the straight lines on both sides (Fritsch & Butland 1984), where the first or
    the fourth sample is missing those of a parabola through three, cut to stay monotone; with two samples it is a line.

    Args:
        times: (4, n) increasing; values: (4, n, C), the first and the fourth NaN where there is none.
        at: (n,)
    """
    step = np.diff(times, axis=0)[..., None].astype(float)
    rise = np.diff(values, axis=0) / step
    whole = step[1]
    start = _slope(step[0], rise[0], whole, rise[1])
    start = np.where(np.isnan(start), _end_slope(whole, rise[1], step[2], rise[2]), start)
    end = _slope(whole, rise[1], step[2], rise[2])
    end = np.where(np.isnan(end), _end_slope(whole, rise[1], step[0], rise[0]), end)
    s = (at - times[1])[:, None] / whole
    bend = s * (1 - s) * ((1 - s) * (start - rise[1]) - s * (end - rise[1]))
    return values[1] + whole * (rise[1] * s + bend)


def _slope(h0: np.ndarray, m0: np.ndarray, h1: np.ndarray, m1: np.ndarray) -> np.ndarray:
    """At a sample between lines of slopes m0 and m1 over times h0 and h1; NaN where one is."""
    first, second = 2 * h1 + h0, h1 + 2 * h0
    same = m0 * m1 > 0
    # Written without quotients of slopes, which may be next to nothing.
    mean = np.divide((first + second) * m0 * m1, first * m1 + second * m0, out=np.zeros_like(m0), where=same)
    return np.where(np.isnan(m0 * m1), np.nan, mean)


def _end_slope(h0: np.ndarray, m0: np.ndarray, h1: np.ndarray, m1: np.ndarray) -> np.ndarray:
    """At the outer end of a line of slope m0, next to which is one of slope m1, or NaN."""
    slope = ((2 * h0 + h1) * m0 - h0 * m1) / (h0 + h1)
    slope = np.where((m0 * m1 <= 0) & (np.abs(slope) > 3 * np.abs(m0)), 3 * m0, slope)
    return np.where(np.isnan(m1), m0, np.where(slope * m0 <= 0, 0, slope))


def take(values: np.ndarray, frame: np.ndarray) -> np.ndarray:
    """(F, ..., C) of other frames (F, ...); NaN where there is no such frame."""
    inside = (frame >= 0) & (frame < len(values))
    taken = np.take_along_axis(values, np.where(inside, frame, 0)[..., None], 0)
    return np.where(inside[..., None], taken, np.nan)


def local_parabola(values: np.ndarray, reach: float) -> np.ndarray:
    """Smoothed by weighted least squares, holes staying holes; `reach` is the weights' deviation in frames."""
    observed = ~np.isnan(values).any(-1)
    lag = np.arange(-int(np.ceil(3 * reach)), int(np.ceil(3 * reach)) + 1) / reach
    known = np.where(observed[..., None], values, 0)

    def moment(array: np.ndarray, power: int) -> np.ndarray:
        return correlate1d(array, np.exp(-0.5 * lag**2) * lag**power, axis=0, mode="constant")

    moments = [moment(observed.astype(float), power) for power in range(5)]
    left = np.stack([np.stack(moments[row : row + 3], -1) for row in range(3)], -2)
    right = np.stack([moment(known, power) for power in range(3)], -2)
    # One or two samples do not make a parabola; the ridge then takes the flattest.
    left = left + np.diag([0, 1e-6, 1e-6]) + np.where(observed, 0, 1)[..., None, None] * np.eye(3)
    return np.where(observed[..., None], np.linalg.solve(left, right)[..., 0, :], np.nan)
