"""Calibration of uncertainty: how often the truth is in regions of a stated probability."""

import numpy as np
from scipy.stats import chi2

from dmae.data.clip import Source
from dmae.evaluation.report.joints import Joints

PROBABILITIES = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.99)
"""Of the regions; that of 0.9 is the one that scores name."""


def counts_in_regions(joints: Joints) -> dict[str, np.ndarray]:
    """Return the number of joints in each region, for measured and for completed joints with covariance and truth.

    Returns:
        Counts (1 + number of `PROBABILITIES`,) by name; the first is the number of joints. Empty without truth.
    """
    if joints.comparison is None:
        return {}
    error = (joints.comparison.matched - joints.comparison.truth.xyz).astype(np.float64)
    cov = joints.comparison.cov
    known = np.isfinite(error).all(-1) & np.isfinite(cov).all((-1, -2)) & joints.counted
    known[known] = np.linalg.det(cov[known].astype(np.float64)) > 0
    e = error[known]
    squared = (e * np.linalg.solve(cov[known].astype(np.float64), e[..., None])[..., 0]).sum(-1)
    limits = chi2.ppf(PROBABILITIES, 3)
    completed = joints.source[known] == Source.COMPLETED
    return {
        name: np.array([len(part), *(int((part <= limit).sum()) for limit in limits)])
        for name, part in (("measured joints", squared[~completed]), ("completed joints", squared[completed]))
        if len(part)
    }
