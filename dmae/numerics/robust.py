"""Means and medians of what is known."""

import numpy as np


def mean_known(values: np.ndarray, axis=0):
    """Return the mean over what is not NaN; NaN, without a warning, where nothing is known."""
    known = ~np.isnan(values)
    total, count = np.where(known, values, 0).sum(axis), known.sum(axis)
    return np.divide(total, count, out=np.full(np.shape(total), np.nan), where=count > 0)[()]


def median_known(values: np.ndarray) -> np.ndarray:
    """Return the median (..., C) of the known rows of (..., N, C); a row is known whole or not at all. NaN of none."""
    ordered, count = np.sort(values, -2), (~np.isnan(values[..., :1])).sum(-2, keepdims=True)
    low, high = (np.take_along_axis(ordered, np.maximum(count - k, 0) // 2, -2) for k in (1, 0))
    return ((low + high) / 2)[..., 0, :]


def median_over_frames(values: np.ndarray) -> np.ndarray:
    """Return the median (...) over frames of what is not NaN in (F, ...); NaN, without a warning, where nothing is."""
    medians = np.full(values.shape[1:], np.nan)
    known = ~np.isnan(values).all(0)
    medians[known] = np.nanmedian(values[:, known], 0)
    return medians
