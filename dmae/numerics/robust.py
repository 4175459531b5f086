"""Means and medians of known values."""

from math import prod

import numpy as np

from dmae.numerics.compiled import compiled


def mean_known(values: np.ndarray, axis=0):
    """Return the mean of the values that are not NaN; NaN, without a warning, where no value is known."""
    known = ~np.isnan(values)
    total, count = np.where(known, values, 0).sum(axis), known.sum(axis)
    return np.divide(total, count, out=np.full(np.shape(total), np.nan), where=count > 0)[()]


def median_known(values: np.ndarray) -> np.ndarray:
    """Return the median (..., C) over the rows of values (..., N, C) that are not NaN; NaN if no row is known.

    A row must be known completely or not at all.
    """
    *shape, rows, columns = values.shape
    flat = np.ascontiguousarray(values, np.float64).reshape(prod(shape), rows, columns)
    return _medians(flat.swapaxes(0, 1)).reshape(*shape, columns)


def median_over_frames(values: np.ndarray) -> np.ndarray:
    """Return the median (...) over frames of the values (F, ...) that are not NaN; NaN, without a warning, if none."""
    flat = np.ascontiguousarray(values, np.float64).reshape(len(values), prod(values.shape[1:]), 1)
    return _medians(flat).reshape(values.shape[1:])


@compiled()
def _medians(values):
    """Return the medians (n, C) of the values (N, n, C) that are not NaN; NaN where no value is known."""
    rows, count, columns = values.shape
    medians, known = np.full((count, columns), np.nan), np.empty(rows)
    for i in range(count):
        for column in range(columns):
            number = 0
            for row in range(rows):
                if not np.isnan(values[row, i, column]):
                    known[number] = values[row, i, column]
                    number += 1
            if number:
                medians[i, column] = np.median(known[:number])
    return medians
