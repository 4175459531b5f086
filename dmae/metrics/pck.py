"""PCK, the percentage of correct keypoints (joints)."""

import numpy as np

from dmae.metrics.comparison import Comparison
from dmae.metrics.matching import take_matched
from dmae.metrics.percentage import percent
from dmae.metrics.registry import Column, metric

PCK_THRESHOLD = 0.2
"""m. The 0.2 of PCK@0.2 is metres in multi-person capture, not torso sizes as in single images. Of bodies
of a person's size; of others as much larger or smaller as they are."""


def joints_within_threshold(comparison: Comparison) -> np.ndarray:
    """Return (F, T, J) True where a joint is within 0.2 m of the true one, or as much as is of bodies of its size."""
    return correct_joints(comparison.matched, comparison.truth.xyz, comparison.scale * PCK_THRESHOLD)


def correct_joints(matched: np.ndarray, truth: np.ndarray, threshold: float = PCK_THRESHOLD) -> np.ndarray:
    """Return (F, T, J) True where a predicted joint is within the threshold, m, of the true one."""
    error = np.linalg.norm(matched - truth.astype(np.float64), axis=-1)
    return np.where(np.isnan(error), np.inf, error) <= threshold


def pck(pred: np.ndarray, truth: np.ndarray, matches: np.ndarray, threshold: float = PCK_THRESHOLD) -> dict[str, float]:
    """Return how many joints are within the threshold, %: `recall` of the true ones, `precision` of the predicted.

    In annotated frames every joint of a prediction that matches no person is a false positive, as is a joint too far
    off; joints of a matched person that have no truth count neither way.

    Args:
        pred: (F, P, J, 3) m.
        truth: (F, T, J, 3) m.
        matches: (F, T) from `match`.
        threshold: m.
    """
    matched = take_matched(pred, matches)
    correct = correct_joints(matched, truth, threshold)
    known, predicted = ~np.isnan(truth).any(-1), ~np.isnan(pred).any(-1)
    spare = predicted & known.any((1, 2))[:, None, None]
    frame, person = np.nonzero(matches >= 0)
    spare[frame, matches[frame, person]] = False
    claimed = (known & ~np.isnan(matched).any(-1)).sum() + spare.sum()
    return {
        "recall": float(percent(correct, known)),
        "precision": float(100 * correct.sum() / claimed) if claimed else float("nan"),
    }


@metric(
    "pck",
    order=5,
    columns=(
        Column("recall", "%", lambda score: score["recall"], order=1),
        Column("precision", "%", lambda score: score["precision"], order=2),
    ),
)
def _pck(comparison: Comparison) -> dict[str, float]:
    """PCK@0.2: recall and precision of joints within 0.2 m, %; precision is too low where persons lack annotation."""
    threshold = comparison.scale * PCK_THRESHOLD
    return pck(comparison.pred.xyz, comparison.truth.xyz, comparison.matches, threshold)
