"""Regression: what a Gaussian process with a learned kernel predicts for a gap, and how sure it is."""

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from dmae.completion.gaussian_process.episodes import Problem
from dmae.completion.gaussian_process.kernels import Kernel, covariance, noise


def predict(problem: Problem, kernel: Kernel) -> tuple[np.ndarray, np.ndarray]:
    """Predict the offset of the joint of a gap from its anchor.

    Equations (2.25) and (2.26) of Rasmussen & Williams 2006; the variance of the process is that under which the
    training poses are most likely, their (5.8).

    Returns:
        (Q, 3) m, in the frame of the body; and the standard deviation along each axis, (Q,) m.
    """
    weights = np.array([kernel.weights.get(name, 0.0) for name in problem.names])[:, None]
    known, wanted = ((part * weights).reshape(len(part), -1) for part in (problem.known, problem.wanted))
    among = _covariance(known, known, problem.seconds, problem.seconds, kernel, problem.noisy)
    across = _covariance(wanted, known, problem.wanted_seconds, problem.seconds, kernel, problem.noisy)
    variance = noise(kernel.parameters, problem.noisy)
    factor = cho_factor(among + variance * np.eye(len(among)), check_finite=False)
    mean = problem.targets.mean(0)
    centred = problem.targets - mean
    solved = cho_solve(factor, np.column_stack([centred, across.T]), check_finite=False)
    size = (centred * solved[:, :3]).sum() / centred.size
    at_zero = covariance(0.0, 0.0, kernel.parameters, problem.noisy)
    left = at_zero + variance - (across * solved[:, 3:].T).sum(1)
    return (mean + across @ solved[:, :3]) * problem.size, np.sqrt(np.maximum(size * left, 0)) * problem.size


def _covariance(
    one: np.ndarray, other: np.ndarray, one_seconds: np.ndarray, seconds: np.ndarray, kernel: Kernel, noisy: float
) -> np.ndarray:
    squared = (one**2).sum(1)[:, None] + (other**2).sum(1) - 2 * one @ other.T
    apart = np.abs(one_seconds[:, None] - seconds)
    return covariance(np.maximum(squared, 0), apart, kernel.parameters, noisy)
