"""Whether stated uncertainty ranks joints by their errors: what is gained by leaving out those least sure."""

import numpy as np
from scipy.stats import rankdata

from dmae.metrics.comparison import Comparison
from dmae.metrics.registry import metric
from dmae.numerics.likely_error import likely_error

COVERAGES = (10, 25, 50, 75, 90, 100)
"""% of the joints that are kept, the surest first."""
LARGE = 50.0
"""mm; an error to be warned of."""


def rank_scores(error: np.ndarray, stated: np.ndarray) -> dict[str, float]:
    """Return how well stated errors rank true ones, of n joints.

    Args:
        error: (n,) mm.
        stated: (n,) in any unit.

    Returns:
        `spearman`, the rank correlation; `auc`, the probability that a joint with an error over `LARGE` has the greater
        stated error than one without (area under the curve of the receiver); `risk_10` and so on for `COVERAGES`, mm,
        the mean error of that share of the joints with the smallest stated errors. NaN where undefined.
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
