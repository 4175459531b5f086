"""PCP by the protocols of published tables, for comparison with them only."""

from collections.abc import Sequence

import numpy as np

from dmae.data.skeleton import Skeleton
from dmae.metrics.comparison import Comparison
from dmae.metrics.matching import GATE, match, match_nearest, take_matched
from dmae.metrics.pcp import correct_limbs
from dmae.metrics.percentage import percent
from dmae.metrics.registry import metric
from dmae.numerics.robust import mean_known

_UNGATED = 100.0
"""m; a gate that no pair of persons exceeds."""


def published_pcp(pred: np.ndarray, truth: np.ndarray, skeleton: Skeleton, actors: Sequence[int]) -> dict[str, float]:
    """Return the average PCP, %, of some true persons by each published protocol.

    `mvpose`: the nearest prediction, however far; two persons may share it. `4da`: Hungarian assignment, missed
    persons are not counted. `hkbu`: the nearest prediction within 0.5 m.

    Args:
        pred: (F, P, J, 3) m.
        truth: (F, T, J, 3) m.
        skeleton: Of both.
        actors: Indices of true persons.
    """
    found = {
        "mvpose": match_nearest(pred, truth),
        "4da": match(pred, truth, _UNGATED),
        "hkbu": match_nearest(pred, truth, GATE),
    }
    scores = {}
    for protocol, matches in found.items():
        correct, known = correct_limbs(take_matched(pred, matches), truth, skeleton)
        if protocol == "4da":
            known &= (matches >= 0)[..., None]
        scores[protocol] = float(mean_known(percent(correct, known, (0, 2))[list(actors)]))
    return scores


@metric("pcp_published", order=4)
def _pcp_published(comparison: Comparison) -> dict[str, float]:
    """PCP by the protocols of published tables, mean of the actors, %."""
    return published_pcp(comparison.pred.xyz, comparison.truth.xyz, comparison.skeleton, comparison.actors)
