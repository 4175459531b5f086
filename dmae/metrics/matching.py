"""Matching: the assignment of predictions to true persons."""

import numpy as np
from scipy.optimize import linear_sum_assignment

from dmae.numerics.statistics import mean_known

GATE = 0.5
"""m; a prediction with a larger mean distance of its joints is another person. It applies to bodies of human size."""


def match(pred: np.ndarray, truth: np.ndarray, gate: float = GATE) -> np.ndarray:
    """Assign predictions to true persons, frame by frame, each at most once (Hungarian algorithm).

    The cost of a pair is the mean distance over the true joints, with each distance limited to the gate. A joint that
    is not predicted costs the gate, so that a single hand does not replace a whole body. A pair is allowed if the mean
    distance of its common joints is within the gate. The assignment matches as many persons as possible, with the least
    cost.

    Args:
        pred: (F, P, J, 3) m.
        truth: (F, T, J, 3) m.
        gate: m.

    Returns:
        (F, T) index of the prediction, -1 if a true person is missed or absent.
    """
    matches = np.full(truth.shape[:2], -1)
    distance = distances(pred, truth)
    allowed = mean_known(distance, -1) <= gate
    cost = np.where(np.isnan(distance), gate, np.minimum(distance, gate))
    cost = mean_known(np.where(np.isnan(truth).any(-1)[:, :, None], np.nan, cost), -1)
    # A forbidden pair costs more than any number of allowed pairs.
    cost = np.where(allowed, cost, 1 + gate * (1 + min(cost.shape[1:])))
    for frame in np.flatnonzero(allowed.any((1, 2))):
        rows, columns = linear_sum_assignment(cost[frame])
        kept = allowed[frame, rows, columns]
        matches[frame, rows[kept]] = columns[kept]
    return matches


def match_nearest(pred: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Assign to every true person the prediction at the least mean distance, without a gate. Persons may share one.

    Arguments and result are as in `match`.
    """
    if not pred.shape[1]:
        return np.full(truth.shape[:2], -1)
    mean = mean_known(distances(pred, truth), -1)
    return np.where(np.isnan(mean).all(-1), -1, np.nan_to_num(mean, nan=np.inf).argmin(-1))


def match_claimed(pred: np.ndarray, truth: np.ndarray, gate: float = GATE) -> np.ndarray:
    """Assign every prediction to its nearest true person within the gate. The first prediction of a person counts.

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
