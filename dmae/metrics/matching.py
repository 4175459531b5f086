"""Matching: which prediction is which true person."""

import numpy as np
from scipy.optimize import linear_sum_assignment

from dmae.numerics.robust import mean_known

GATE = 0.5
"""m; a prediction with joints farther off than this on average is another person. Of bodies of a person's size."""


def match(pred: np.ndarray, truth: np.ndarray, gate: float = GATE) -> np.ndarray:
    """Assign predictions to true persons, frame by frame, each at most once (Hungarian algorithm).

    The cost of a pair is the mean, over the joints that are true, of the distance cut at the gate; a joint that is not
    predicted costs the gate, so that a stray hand never takes the place of a whole body. A pair is allowed when the
    joints that it has in common are within the gate on average. As many persons as possible are matched, at the least
    cost.

    Args:
        pred: (F, P, J, 3) m.
        truth: (F, T, J, 3) m.
        gate: m.

    Returns:
        (F, T) index of the prediction, -1 where a true person is missed or absent.
    """
    matches = np.full(truth.shape[:2], -1)
    distance = distances(pred, truth)
    allowed = mean_known(distance, -1) <= gate
    cost = np.where(np.isnan(distance), gate, np.minimum(distance, gate))
    cost = mean_known(np.where(np.isnan(truth).any(-1)[:, :, None], np.nan, cost), -1)
    # Dearer than any number of allowed pairs.
    cost = np.where(allowed, cost, 1 + gate * (1 + min(cost.shape[1:])))
    for frame in np.flatnonzero(allowed.any((1, 2))):
        rows, columns = linear_sum_assignment(cost[frame])
        kept = allowed[frame, rows, columns]
        matches[frame, rows[kept]] = columns[kept]
    return matches


def match_nearest(pred: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Assign to every true person the prediction at the least mean distance, however far; persons may share one.

    Arguments and result are as in `match`.
    """
    if not pred.shape[1]:
        return np.full(truth.shape[:2], -1)
    mean = mean_known(distances(pred, truth), -1)
    return np.where(np.isnan(mean).all(-1), -1, np.nan_to_num(mean, nan=np.inf).argmin(-1))


def match_claimed(pred: np.ndarray, truth: np.ndarray, gate: float = GATE) -> np.ndarray:
    """Let every prediction claim the true person nearest to it, nearer than the gate; the first claim on one counts.

    Arguments and result are as in `match`.
    """
    if 0 in (pred.shape[1], truth.shape[1]):
        return np.full(truth.shape[:2], -1)
    mean = np.nan_to_num(mean_known(distances(pred, truth), -1), nan=np.inf)
    claims = (mean == mean.min(1, keepdims=True)) & (mean < gate)
    return np.where(claims.any(-1), claims.argmax(-1), -1)


def distances(pred: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Return (F, T, P, J) distances, m, between every true person and every prediction; NaN where one is absent."""
    return np.linalg.norm(pred[:, None] - truth[:, :, None].astype(np.float64), axis=-1)


def take_matched(array: np.ndarray, matches: np.ndarray, missing=np.nan) -> np.ndarray:
    """Reorder (F, P, ...) by predictions to (F, T, ...) by true persons; `missing` where a person has no prediction."""
    taken = np.full((*matches.shape, *array.shape[2:]), missing, array.dtype)
    frame, person = np.nonzero(matches >= 0)
    taken[frame, person] = array[frame, matches[frame, person]]
    return taken
