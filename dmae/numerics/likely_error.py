"""Likely errors: how far a joint is from the truth more often than not, by its stated covariance."""

import numpy as np

from dmae.data.clip import Poses3D, Source

MEDIAN_RADIUS = 1.5382
"""Standard deviations of an isotropic Gaussian in three dimensions within which half of it lies."""


def likely_error(cov: np.ndarray) -> np.ndarray:
    """Return the distance from the truth that covariances (..., 3, 3) m^2 state, (...) m; NaN where unknown.

    It is the median for an isotropic covariance, and that of the isotropic one of equal trace for any other.
    """
    variance = np.trace(cov.astype(np.float64), axis1=-2, axis2=-1) / 3
    return MEDIAN_RADIUS * np.sqrt(np.maximum(variance, 0))


def without_unlikely(poses: Poses3D, keep_mm: float | None) -> Poses3D:
    """Return poses without the joints that are likely farther than `keep_mm` mm from the truth.

    Joints of unknown covariance are left out where they were completed, as nothing says how good they are, and stay
    where they were measured. None keeps all.

    Raises:
        ValueError: the limit is not a positive number.
    """
    if keep_mm is None:
        return poses
    if not (np.isfinite(keep_mm) and keep_mm > 0):
        raise ValueError(f"keep_mm={keep_mm}: expected the greatest likely error in mm, above 0, or none")
    error = likely_error(poses.cov)
    unknown = np.isnan(error) & (poses.source == Source.COMPLETED)
    return poses.without(unknown | (np.nan_to_num(error) * 1000 > keep_mm))
