"""Likely errors: the median distance of a joint from the truth according to its covariance."""

import numpy as np

from dmae.data.clip import Poses3D, Source

MEDIAN_RADIUS = 1.5382
"""Radius that contains half of an isotropic Gaussian in three dimensions, in standard deviations along an axis."""


def likely_error(cov: np.ndarray) -> np.ndarray:
    """Return the median distance from the truth for covariances (..., 3, 3) m^2, (...) m; NaN where unknown.

    A covariance that is not isotropic is replaced by the isotropic covariance with the same trace.
    """
    variance = np.trace(cov.astype(np.float64), axis1=-2, axis2=-1) / 3
    return MEDIAN_RADIUS * np.sqrt(np.maximum(variance, 0))


def without_unlikely(poses: Poses3D, keep_mm: float | None) -> Poses3D:
    """Return the poses with joints made absent if their likely error is above `keep_mm`, mm; None keeps all joints.

    Completed joints with unknown covariance are also made absent, because their accuracy is unknown. Measured joints
    with unknown covariance are kept.

    Raises:
        ValueError: `keep_mm` is not a positive number.
    """
    if keep_mm is None:
        return poses
    if not (np.isfinite(keep_mm) and keep_mm > 0):
        raise ValueError(f"keep_mm={keep_mm}: expected the greatest likely error in mm, above 0, or none")
    error = likely_error(poses.cov)
    unknown = np.isnan(error) & (poses.source == Source.COMPLETED)
    return poses.without(unknown | (np.nan_to_num(error) * 1000 > keep_mm))
