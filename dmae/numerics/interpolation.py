"""Interpolation and smoothing of samples over time.

Values are (F, ..., C), one row a frame; a sample of which any component is NaN is missing.
"""

from collections.abc import Callable
from math import prod

import numpy as np
from scipy.ndimage import correlate1d

from dmae.numerics.gaps import neighbours

Interpolation = Callable[[np.ndarray], np.ndarray]
"""Fills the gaps of (F, ..., C) between samples; before the first and after the last sample it extrapolates."""


def hold(values: np.ndarray) -> np.ndarray:
    """Fill each gap with the sample before it; before the first sample, with the first."""
    before, after = neighbours(~np.isnan(values).any(-1))
    return take_frames(values, np.where(before >= 0, before, after))


def linear(values: np.ndarray) -> np.ndarray:
    """Fill each gap with a straight line; hold the first and the last sample beyond them."""
    frames = len(values)
    before, after = neighbours(~np.isnan(values).any(-1))
    start = np.where(before >= 0, before, after)
    end = np.where(after < frames, after, before)
    index = np.arange(frames).reshape(-1, *(1,) * (before.ndim - 1))
    weight = np.where(end > start, (index - start) / np.maximum(end - start, 1), 0)[..., None]
    first = take_frames(values, start)
    return first + weight * (take_frames(values, end) - first)


def pchip(values: np.ndarray) -> np.ndarray:
    """Fill each gap with a monotone cubic (Fritsch & Butland 1984); hold the first and the last sample beyond them."""
    frames = len(values)
    flat = values.reshape(frames, prod(values.shape[1:-1]), values.shape[-1])
    filled = hold(flat)
    before, after = neighbours(~np.isnan(flat).any(-1))
    frame, column = np.nonzero(np.isnan(flat).any(-1) & (before >= 0) & (after < frames))
    times = surrounding_frames(before, after, frame, column)
    filled[frame, column] = pchip_between(times, take_samples(flat, times, column), frame)
    return filled.reshape(values.shape)


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
    """Return the slope at a sample between lines of slopes m0 and m1 over times h0 and h1; NaN where either is NaN."""
    first, second = 2 * h1 + h0, h1 + 2 * h0
    same = m0 * m1 > 0
    # Written without quotients of slopes, which may be close to zero.
    mean = np.divide((first + second) * m0 * m1, first * m1 + second * m0, out=np.zeros_like(m0), where=same)
    return np.where(np.isnan(m0 * m1), np.nan, mean)


def _end_slope(h0: np.ndarray, m0: np.ndarray, h1: np.ndarray, m1: np.ndarray) -> np.ndarray:
    """Return the slope at the outer end of a line of slope m0 whose neighbour has slope m1, or NaN."""
    slope = ((2 * h0 + h1) * m0 - h0 * m1) / (h0 + h1)
    slope = np.where((m0 * m1 <= 0) & (np.abs(slope) > 3 * np.abs(m0)), 3 * m0, slope)
    return np.where(np.isnan(m1), m0, np.where(slope * m0 <= 0, 0, slope))


def take_frames(values: np.ndarray, frame: np.ndarray) -> np.ndarray:
    """Return values (F, ..., C) of other frames (F, ...); NaN where there is no such frame."""
    inside = (frame >= 0) & (frame < len(values))
    taken = np.take_along_axis(values, np.where(inside, frame, 0)[..., None], 0)
    return np.where(inside[..., None], taken, np.nan)


def local_parabola(values: np.ndarray, reach: float) -> np.ndarray:
    """Smooth by weighted least squares; missing samples stay missing.

    Args:
        reach: Standard deviation of the weights, frames.
    """
    observed = ~np.isnan(values).any(-1)
    lag = np.arange(-int(np.ceil(3 * reach)), int(np.ceil(3 * reach)) + 1) / reach
    known = np.where(observed[..., None], values, 0)

    def moment(array: np.ndarray, power: int) -> np.ndarray:
        return correlate1d(array, np.exp(-0.5 * lag**2) * lag**power, axis=0, mode="constant")

    moments = [moment(observed.astype(float), power) for power in range(5)]
    left = np.stack([np.stack(moments[row : row + 3], -1) for row in range(3)], -2)
    right = np.stack([moment(known, power) for power in range(3)], -2)
    # One or two samples do not determine a parabola; the ridge selects the flattest.
    left = left + np.diag([0, 1e-6, 1e-6]) + np.where(observed, 0, 1)[..., None, None] * np.eye(3)
    return np.where(observed[..., None], np.linalg.solve(left, right)[..., 0, :], np.nan)
