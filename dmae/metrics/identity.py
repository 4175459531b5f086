"""Metrics of identity: whether persons keep their identity through a clip."""

import numpy as np
from scipy.optimize import linear_sum_assignment

from dmae.metrics.comparison import GATE, Comparison, distances
from dmae.metrics.registry import Column, metric
from dmae.numerics.filling import are_stills
from dmae.numerics.statistics import mean_known


def identity_switches(matches: np.ndarray) -> int:
    """Count how often a true person is matched, in (F, T) of `match`, to another prediction than at the previous match.

    If two predictions of one person are the nearest one in turn, each change counts.
    """
    switches = 0
    for person in matches.T:
        matched = person[person >= 0]
        switches += int((matched[1:] != matched[:-1]).sum())
    return switches


def idf1(pred: np.ndarray, truth: np.ndarray, gate: float = GATE) -> float:
    """Return the identity F1 score (Ristani et al. 2016), %, of predictions (F, P, J, 3) m and truth (F, T, J, 3) m.

    Each true person is assigned at most one prediction for the whole clip, and each prediction at most one person. The
    assignment maximises the number of frames in which the two match: their mean distance, over the joints that both
    have, is within the gate, m. The score is twice the number of these frames, divided by the person-frames of truth
    and prediction together; NaN where there are none. It is too low if some persons are not annotated.
    """
    here, predicted = (~np.isnan(xyz).any(-1) for xyz in (truth, pred))
    total = here.any(-1).sum() + (predicted.any(-1) & here.any((1, 2))[:, None]).sum()
    together = (mean_known(distances(pred, truth), -1) <= gate).sum(0)
    found = together[linear_sum_assignment(together, maximize=True)].sum()
    return float(200 * found / total) if total else float("nan")


@metric("identity_switches", order=10, columns=(Column("switches", "", order=8, table="identities"),))
def _identity_switches(comparison: Comparison) -> float:
    """Number of times that a true person is matched to another prediction than before; NaN in stills."""
    return float("nan") if are_stills(comparison.fps) else identity_switches(comparison.matches)


@metric("idf1", order=11, columns=(Column("IDF1", "%", order=9, table="identities"),))
def _idf1(comparison: Comparison) -> float:
    """Identity F1 score, %; NaN in stills, in which nobody is followed."""
    return (
        float("nan")
        if are_stills(comparison.fps)
        else idf1(comparison.pred.xyz, comparison.truth.xyz, comparison.scale * GATE)
    )
