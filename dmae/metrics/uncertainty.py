"""Metrics of stated covariances: how often their regions contain the truth, and how well they rank errors."""

import numpy as np
from scipy.stats import rankdata

from dmae.metrics.comparison import Comparison
from dmae.metrics.registry import metric
from dmae.numerics.statistics import likely_error

REGION_PROBABILITY = 0.9
"""Probability of the regions by which stated covariances are judged."""

REGION_RADIUS = 2.5003
"""Standard deviations of an isotropic Gaussian in three dimensions within which that probability lies."""

COVERAGES = (10, 25, 50, 75, 90, 100)
"""Percentages of the joints over which errors are averaged, the most certain joints first."""
LARGE = 50.0
"""mm; errors above this are large."""


def in_region(error: np.ndarray, cov: np.ndarray) -> np.ndarray:
    """Return which errors are inside the ellipsoid that contains `REGION_PROBABILITY` of a Gaussian.

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


def rank_scores(error: np.ndarray, stated: np.ndarray) -> dict[str, float]:
    """Return how well stated errors rank the true errors of n joints.

    Args:
        error: (n,) mm.
        stated: (n,) in any unit.

        Returns:
        `spearman`, the rank correlation; `auc`, the probability that a joint with an error over `LARGE` has a larger
        stated error than a joint without (area under the ROC curve); `risk_10` and so on for `COVERAGES`, the mean
        error, mm, of that percentage of the joints with the smallest stated errors. NaN where undefined.
    """
    scores = dict.fromkeys(("spearman", "auc", *(f"risk_{share}" for share in COVERAGES)), float("nan"))
    if len(error) < 2:
        return scores
    ranks = rankdata(stated)
    if np.ptp(error) > 0 and np.ptp(ranks) > 0:
        scores["spearman"] = float(np.corrcoef(ranks, rankdata(error))[0, 1])
    large = error > LARGE
    above, below = int(large.sum()), int((~large).sum())
    if above and below:
        # Mann and Whitney's statistic: ties count half.
        scores["auc"] = float((ranks[large].sum() - above * (above + 1) / 2) / (above * below))
    risk = np.cumsum(error[np.argsort(stated, kind="stable")]) / np.arange(1, len(error) + 1)
    for share in COVERAGES:
        scores[f"risk_{share}"] = float(risk[max(round(share / 100 * len(error)), 1) - 1])
    return scores


@metric("ranking", order=10)
def _ranking(comparison: Comparison) -> dict[str, float]:
    """Of hidden joints with a stated uncertainty: Spearman, AUC over 50 mm, and mm at each coverage."""
    error = 1000 * np.linalg.norm(comparison.matched - comparison.truth.xyz.astype(np.float64), axis=-1)
    stated = likely_error(comparison.cov)
    counted = comparison.hidden & ~np.isnan(error) & ~np.isnan(stated)
    return rank_scores(error[counted], stated[counted])
