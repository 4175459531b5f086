"""Whether stated covariances are right: how often the truth lies in the regions that they state."""

import numpy as np

REGION_PROBABILITY = 0.9
"""Probability of the regions by which stated covariances are judged."""

REGION_RADIUS = 2.5003
"""Standard deviations of an isotropic Gaussian in three dimensions within which that probability lies."""


def in_region(error: np.ndarray, cov: np.ndarray) -> np.ndarray:
    """Decide which errors lie in the ellipsoid of `REGION_PROBABILITY` of a Gaussian.

    Args:
        error: (..., 3) m.
        cov: (..., 3, 3) covariances of the Gaussians, m^2.

    Returns:
        (...) 1 inside, 0 outside, NaN where either is unknown.
    """
    within = np.full(error.shape[:-1], np.nan)
    known = ~np.isnan(error).any(-1) & ~np.isnan(cov).any((-1, -2))
    e, c = error[known], cov[known].astype(np.float64)
    within[known] = (e * np.linalg.solve(c, e[..., None])[..., 0]).sum(-1) <= REGION_RADIUS**2
    return within
