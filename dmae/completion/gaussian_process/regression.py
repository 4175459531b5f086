"""Regression: what Gaussian processes predict for a gap, how sure they are, and how well they do without a gap."""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from dmae.completion.gaussian_process.kernels import Kernel, covariance, noise_of
from dmae.completion.gaussian_process.problems import GapProblem

_BLOCKS = 6
"""Stretches of training poses, at most, that are left out to see how well they are predicted."""
_PRIOR = 2.0
"""Frames of such a stretch, with errors as usual, that the belief in the process is worth beforehand."""


@dataclass(frozen=True)
class GapPrediction:
    """What one process predicts for a gap of Q frames, from N training poses.

    Attributes:
        offset: (Q, 3) m / size.
        deviation: (Q,) m / size, along each axis.
        inverse: (N, N) inverse of the covariance of the training poses, noise included.
        centred: (N, 3) m / size, the targets less their mean.
    """

    offset: np.ndarray
    deviation: np.ndarray
    inverse: np.ndarray
    centred: np.ndarray


def predict(problem: GapProblem, kernel: Kernel) -> GapPrediction:
    """Predict the offset of the joint of a gap from its anchor.

    Equations (2.25) and (2.26) of Rasmussen & Williams 2006, twice: residuals of the first time, each pose left out by
    (5.12), say which training poses are wrong. The variance of the process is that under which they are most likely.
    """
    weights = np.array([kernel.weights.get(name, 0.0) for name in problem.names])[:, None]
    known, wanted = ((part * weights).reshape(len(part), -1) for part in (problem.known, problem.wanted))
    among = _covariance(known, known, problem.seconds, problem.seconds, kernel)
    across = _covariance(wanted, known, problem.wanted_seconds, problem.seconds, kernel)
    centred = problem.targets - problem.targets.mean(0)
    inverse = _inverse(among, np.full(len(among), kernel.parameters["noise"]))
    residuals = ((inverse @ centred / np.diag(inverse)[:, None]) ** 2).sum(1)
    variance = noise_of(residuals, np.median(residuals) + 1e-12, kernel.parameters)
    mean = np.average(problem.targets, 0, 1 / variance)
    centred = problem.targets - mean
    inverse = _inverse(among, variance)
    solved = inverse @ centred
    size = (centred * solved).sum() / centred.size
    left = covariance(0.0, 0.0, kernel.parameters) + kernel.parameters["noise"] - ((across @ inverse) * across).sum(1)
    return GapPrediction(mean + across @ solved, np.sqrt(np.maximum(size * left, 0)), inverse, centred)


def blending_weight(problem: GapProblem, prediction: GapPrediction) -> float:
    """Return the weight of a prediction against interpolation, 0 to 1, from errors of left-out poses.

    Stretches of training poses, as long as the gap, are left out and predicted: by the process from all other poses,
    and by straight lines between their neighbours. The weight is that with which the blend of both has the least
    squared error; it is 1 where too little is known.
    """
    product = square = 0.0
    for block in _blocks(problem):
        inverse = prediction.inverse[np.ix_(block, block)]
        process = np.linalg.solve(inverse, prediction.inverse[block] @ prediction.centred)
        ends, centred, seconds = [block[0] - 1, block[-1] + 1], prediction.centred, problem.seconds
        share = ((seconds[block] - seconds[ends[0]]) / (seconds[ends[1]] - seconds[ends[0]]))[:, None]
        line = centred[block] - (1 - share) * centred[ends[0]] - share * centred[ends[1]]
        product += (line * (line - process)).sum() / len(block)
        square += ((line - process) ** 2).sum() / len(block)
    usual = _PRIOR * square / _BLOCKS + 1e-12
    return float(np.clip((product + usual) / (square + usual), 0, 1))


def _blocks(problem: GapProblem) -> list[np.ndarray]:
    """Return the training poses of stretches as long as the gap, evenly spaced over time."""
    seconds = problem.seconds
    half = (problem.wanted_seconds[-1] - problem.wanted_seconds[0]) / 2
    found = []
    for middle in np.linspace(seconds[0] + half, seconds[-1] - half, _BLOCKS + 2)[1:-1]:
        block = np.flatnonzero(np.abs(seconds - middle) <= half + 1e-9)
        if len(block) and block[0] > 0 and block[-1] < len(seconds) - 1:
            found.append(block)
    return found


def _inverse(among: np.ndarray, variance: np.ndarray) -> np.ndarray:
    """Return the inverse of a covariance with noise of those variances."""
    return cho_solve(cho_factor(among + np.diag(variance), check_finite=False), np.eye(len(among)), check_finite=False)


def _covariance(
    one: np.ndarray, other: np.ndarray, one_seconds: np.ndarray, seconds: np.ndarray, kernel: Kernel
) -> np.ndarray:
    squared = (one**2).sum(1)[:, None] + (other**2).sum(1) - 2 * one @ other.T
    return covariance(np.maximum(squared, 0), np.abs(one_seconds[:, None] - seconds), kernel.parameters)
