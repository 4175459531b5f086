"""Statistics: means and medians of known values, and the likely errors of joints."""

import numpy as np

from dmae.data.clip import Poses3D, Source


def evenly_spaced(count: int, most: int) -> np.ndarray:
    """Return up to `most` indices from 0 to `count` - 1, ascending, with even steps and both ends."""
    return np.linspace(0, count - 1, min(most, count)).astype(int)


def mean_known(values: np.ndarray, axis=0):
    """Return the mean of the values that are not NaN; NaN, without a warning, where no value is known."""
    known = ~np.isnan(values)
    total, count = np.where(known, values, 0).sum(axis), known.sum(axis)
    return np.divide(total, count, out=np.full(np.shape(total), np.nan), where=count > 0)[()]


def median_known(values: np.ndarray) -> np.ndarray:
    """Return the median (..., C) over the known rows of values (..., N, C), known whole or not at all; NaN for none."""
    return median_over_frames(np.moveaxis(values, -2, 0))


def median_over_frames(values: np.ndarray) -> np.ndarray:
    """Return the median (...) over frames of the values (F, ...) that are not NaN; NaN, without a warning, if none."""
    if not len(values):
        return np.full(values.shape[1:], np.nan)
    # NaN is sorted to the end.
    ordered = np.sort(np.asarray(values, np.float64), axis=0).reshape(len(values), -1)
    number, column = (~np.isnan(values)).sum(0).reshape(-1), np.arange(ordered.shape[1])
    middle = ordered[np.maximum(number - 1, 0) // 2, column] + ordered[number // 2, column]
    return (middle / 2).reshape(values.shape[1:])[()]


MEDIAN_RADIUS = 1.5382
"""Radius that contains half of an isotropic Gaussian in three dimensions, in standard deviations along an axis."""


def likely_error(cov: np.ndarray) -> np.ndarray:
    """Return the median distance (...) m from the truth for covariances (..., 3, 3) m^2, taken as isotropic."""
    variance = np.trace(cov.astype(np.float64), axis1=-2, axis2=-1) / 3
    return MEDIAN_RADIUS * np.sqrt(np.maximum(variance, 0))


def without_unlikely(poses: Poses3D, keep_mm: float | None) -> Poses3D:
    """Return the poses with joints made absent if their likely error is above `keep_mm`, mm; None keeps all joints.

    Completed joints with unknown covariance are also made absent, because their accuracy is unknown. Measured joints
    with unknown covariance are kept. Raises ValueError if `keep_mm` is not positive.
    """
    if keep_mm is None:
        return poses
    if not (np.isfinite(keep_mm) and keep_mm > 0):
        raise ValueError(f"keep_mm={keep_mm}: expected the greatest likely error in mm, above 0, or none")
    error = likely_error(poses.cov)
    unknown = np.isnan(error) & (poses.source == Source.COMPLETED)
    return poses.without(unknown | (np.nan_to_num(error) * 1000 > keep_mm))
