"""Agreement between views: how well detections of pairs of views fit their cameras, without known identities.

S sampled frames; D detections per view; J joints; n pairs of views; m matched detections.
"""

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from dmae.calibration.epipolar import ViewSample, epipolar_distances, intersect
from dmae.calibration.hypothesis import Hypothesis
from dmae.numerics.statistics import mean_known

Pairs = list[tuple[int, int]]
"""Pairs of views."""
TOLERANCE = 0.025
"""Distance of a joint from its epipolar line that counts as half a fit, as a share of the person's size in the image.

Real detectors leave distances of about 0.015 of a person's height.
"""
SOUND = 0.3
"""Agreement of views without a gross fault, with the usual share of people that are hidden or cut off."""
MATCH = 0.35
"""Smallest agreement of two detections of one person."""


@dataclass(frozen=True)
class Agreement:
    """Agreement of n pairs of views.

    Attributes:
        total: (n, S) sum of the best fits, from 0 to 1, of the detections of either view with those of the other, in
            frames in which both views have detections.
        detections: (n, S) number of these detections.
        pair, frame, a, b: (m,) the matches: detections that are each other's best fit, and fit well. Indices of the
            pair, of the frame, and of the two detections.
        residual: (m, J) px from joints to epipolar lines, mean of both views; NaN where a joint is not shared.
    """

    total: np.ndarray
    detections: np.ndarray
    pair: np.ndarray
    frame: np.ndarray
    a: np.ndarray
    b: np.ndarray
    residual: np.ndarray


def measure_agreement(sample: ViewSample, pairs: Pairs, other: ViewSample | None = None) -> Agreement:
    """Measure the agreement of pairs of views. The second view of each pair is taken from `other` if it is given."""
    other = other or sample
    a, b = np.asarray(pairs).T
    distance_a, distance_b = epipolar_distances(sample, other, a, b)
    size_a, size_b = sample.size[a].astype(np.float32), other.size[b].astype(np.float32)
    relative = distance_a / (2 * size_a)[:, :, :, None, None] + distance_b / (2 * size_b)[:, :, None, :, None]
    near = np.nan_to_num(1 / (1 + (relative / TOLERANCE) ** 2))
    joints_a, joints_b = sample.joints[a], other.joints[b]
    shared = joints_a.astype(np.float32) @ joints_b.astype(np.float32).swapaxes(-1, -2)
    # The 1 keeps the fit low for pairs that share few joints.
    fit = near.sum(-1) / (shared + 1)
    some_a, some_b = joints_a.any(-1), joints_b.any(-1)
    counted_a, counted_b = some_a & some_b.any(-1, keepdims=True), some_b & some_a.any(-1, keepdims=True)
    best_b, best_a = fit.argmax(-1), fit.argmax(-2)
    mutual = np.take_along_axis(best_a, best_b, -1) == np.arange(fit.shape[2])
    pair, frame, i = np.nonzero(counted_a & mutual & (fit.max(-1) >= MATCH))
    j = best_b[pair, frame, i]
    # Epipolar lines do not distinguish front from back, so matches behind a camera are excluded.
    _, _, depth_a, depth_b, _ = intersect(sample, other, a[pair], b[pair], frame, i, j)
    in_front = np.where(np.isnan(depth_a), np.nan, (depth_a > 0) & (depth_b > 0))
    fit[pair, frame, i, j] *= np.nan_to_num(mean_known(in_front, -1))
    total = np.where(counted_a, fit.max(-1), 0).sum(-1) + np.where(counted_b, fit.max(-2), 0).sum(-1)
    kept = fit[pair, frame, i, j] >= MATCH
    pair, frame, i, j = pair[kept], frame[kept], i[kept], j[kept]
    residual = (distance_a[pair, frame, i, j] + distance_b[pair, frame, i, j]) / 2
    return Agreement(total, counted_a.sum(-1) + counted_b.sum(-1), pair, frame, i, j, residual)


def triangulate_matches(sample: ViewSample, pairs: Pairs, found: Agreement) -> np.ndarray:
    """Return matched detections as points (m, J, 3), in the unit of the rig; NaN where two rays are almost parallel."""
    a, b = np.asarray(pairs)[found.pair].reshape(-1, 2).T
    rays_a, rays_b, depth_a, depth_b, sine2 = intersect(sample, sample, a, b, found.frame, found.a, found.b)
    centers = sample.rig.centers[:, None]
    middle = (centers[a] + depth_a[..., None] * rays_a + centers[b] + depth_b[..., None] * rays_b) / 2
    return np.where(((sine2 > 0.03) & (depth_a > 0) & (depth_b > 0))[..., None], middle, np.nan)


def pairs_to_compare(views: int) -> Pairs:
    """Return all pairs of views, or in a large rig the pairs of each view with its next two and the opposite view."""
    steps = {1, 2, views // 2}
    return [
        (a, b) for a, b in combinations(range(views), 2) if views <= 8 or (b - a) in steps or views - (b - a) in steps
    ]


PairScores = dict[tuple[int, int], np.ndarray]
"""By pair of views: (2, S) total agreement and number of detections in each frame, as in `Agreement`."""


def score_pairs(hypothesis: Hypothesis, frames: np.ndarray, pairs: Pairs) -> PairScores:
    """Score pairs of views in frames (S,) under a hypothesis."""
    views = sorted({view for pair in pairs for view in pair})
    sample = ViewSample.of(hypothesis, frames, views)
    found = measure_agreement(sample, [(views.index(a), views.index(b)) for a, b in pairs])
    return dict(zip(pairs, np.stack([found.total, found.detections], 1), strict=True))


def mean_agreement(scores: PairScores) -> float:
    """Return the mean agreement, from 0 to 1, of the detections of pairs of views; 0 without detections."""
    total, detections = sum(scores.values()).sum(-1)
    return float(total / max(detections, 1))
