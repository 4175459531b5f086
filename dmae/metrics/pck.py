"""PCK, the percentage of correct keypoints (joints)."""

import numpy as np

from dmae.metrics.comparison import Comparison
from dmae.metrics.matching import take_matched
from dmae.metrics.percentage import percent
from dmae.metrics.registry import Column, metric

PCK_THRESHOLD = 0.2
"""m. The 0.2 of PCK@0.2 is in metres in multi-person capture, not in torso sizes as in single images. It applies to
bodies of human size, and is scaled with the size of other bodies."""


def joints_within_threshold(comparison: Comparison) -> np.ndarray:
    """Return (F, T, J) True where a joint is within 0.2 m, scaled with the size of the body, of the true joint."""
    return correct_joints(comparison.matched, comparison.truth.xyz, comparison.scale * PCK_THRESHOLD)


def correct_joints(matched: np.ndarray, truth: np.ndarray, threshold: float = PCK_THRESHOLD) -> np.ndarray:
    """Return (F, T, J) True where a predicted joint is within the threshold, m, of the true joint."""
    error = np.linalg.norm(matched - truth.astype(np.float64), axis=-1)
    return np.where(np.isnan(error), np.inf, error) <= threshold


def pck(pred: np.ndarray, truth: np.ndarray, matches: np.ndarray, threshold: float = PCK_THRESHOLD) -> dict[str, float]:
    """Return the share of joints within the threshold, %: `recall` of true joints, `precision` of predicted joints.

    In annotated frames, joints that are too far off, and all joints of a prediction without a match, are false
    positives. Joints of a matched person without a true position do not count.

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
