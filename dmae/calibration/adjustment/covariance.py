"""The covariance of adjusted cameras, if errors of detections are correlated over time and joints have offsets."""

from __future__ import annotations

import numpy as np

from dmae.calibration.adjustment.bundle import Adjusted
from dmae.calibration.adjustment.freedom import Freedom
from dmae.calibration.adjustment.observations import Observations
from dmae.calibration.adjustment.parameters import Q

_ALIKE_S = 3.0
"""s; errors of detections at this distance in time are assumed to be independent, except for constant offsets."""


def covariance_of_cameras(observations: Observations, adjusted: Adjusted, freedom: Freedom) -> np.ndarray:
    """Return the covariance (V, Q, Q) of each camera: H^-1 G H^-1.

    G is the covariance of the gradient: the scatter of the contributions of bodies, times the number of bodies with the
    same error, plus the contribution of constant offsets of joints. H is the curvature of the robust cost.
    """
    views, free = len(adjusted.calibration.rig), np.flatnonzero(freedom.free)
    covariance = np.zeros((views * Q, views * Q))
    if len(free):
        scores, index = adjusted.scores[:, free], np.ix_(free, free)
        scatter = scores.T @ scores
        G = (
            _bodies_per_error(observations, scores @ np.linalg.pinv(_root(scatter))) * scatter
            + adjusted.offset_spread[index]
        )
        H = np.linalg.pinv(adjusted.information[index] * adjusted.curvature)
        covariance[index] = H @ G @ H
    blocks = covariance.reshape(views, Q, views, Q)
    return blocks[np.arange(views), :, np.arange(views)]


def _root(matrix: np.ndarray) -> np.ndarray:
    """Return the symmetric square root of a covariance matrix."""
    values, vectors = np.linalg.eigh(matrix)
    return vectors * np.sqrt(np.maximum(values, 0)) @ vectors.T


def _bodies_per_error(observations: Observations, scores: np.ndarray) -> float:
    """Return the number of bodies of a person that have the same error.

    It is the energy of the sums of scores over stretches of time, relative to the sum of the energies of the scores.

    Args:
        observations: M bodies.
        scores: (M, P) contributions of the bodies to a gradient, decorrelated.
    """
    seconds = (observations.frame - observations.frame.min()) / observations.tracks.fps
    duration = float(seconds.max()) + 1 / observations.tracks.fps
    count = max(int(duration / _ALIKE_S), 4)
    stretch = np.minimum((seconds / duration * count).astype(int), count - 1)
    group = np.unique(observations.person * count + stretch, return_inverse=True)[1]
    sums = np.zeros((group.max() + 1, scores.shape[1]))
    np.add.at(sums, group, scores)
    # At the minimum all contributions add up to zero, so that one stretch fewer is independent.
    return max(float((sums**2).sum() / (scores**2).sum()) * len(sums) / max(len(sums) - 1, 1), 1.0)
