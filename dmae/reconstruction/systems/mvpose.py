"""mvpose: cycle-consistent matching of 2D poses between views, then a body from triangulated candidates.

Dong, Jiang, Huang, Bao and Zhou, Fast and Robust Multi-Person 3D Pose Estimation from Multiple Views, CVPR 2019; Dong,
Fang, Jiang, Yang, Huang, Bao and Zhou, the same with tracking, TPAMI 2021. Constants are of the released code
(github.com/zju3dv/mvpose). Published on Shelf: 96.9 % PCP (98.8, 94.1, 97.8 by actor).

What differs:
- There is no appearance (a network for the identity of people in crops of images). The affinity is geometric alone, as
  with the option `Geometry only` of the code.
- There are no heatmaps. A heatmap is a Gaussian around the detected joint, as high as its confidence.
- Lengths of bones are measured in the clip, not learned from annotations.
- OpenPose leaves joints out, where their detector states all. A distance is over the joints that both views show.
"""

from itertools import combinations

import numpy as np
from scipy.special import erfc

from dmae.data.cameras import CameraRig
from dmae.data.clip import Clip, Poses3D
from dmae.reconstruction.config import CaptureConfig, capture_method
from dmae.reconstruction.systems.common import Frame, as_tracks, bone_lengths, frames_of, max_product, meet, project

_UNKNOWN_PX = 25.0  # px; distance of two detections of one view, or without a common joint
_STEEPNESS, _LEAST_SPREAD_PX = 5.0, 5.0
"""Of the sigmoid that turns standardised distances into affinities; and the spread of distances, px, below which all
are alike, so that the diagonal is set to their mean."""
_ALPHA, _LAMBDA, _MU = 0.5, 50.0, 64.0
"""Equation 8: reward of sparsity, weight of the nuclear norm, and first step of the optimisation."""
_ITERATIONS, _TOLERANCE = 500, 5e-4
_MATCHED = 0.5  # Entries of the solution above it are matches
_HEATMAP_M, _FLOOR = 0.05, 1e-5
"""m at the person, standard deviation of the Gaussian that stands for a heatmap; and the least value of a heatmap."""


@capture_method("mvpose", paper="Dong et al. 2021")
def capture_mvpose(clip: Clip, config: CaptureConfig) -> Poses3D:
    """Match 2D poses between all views at once, cycle-consistently, and choose joints among triangulated ones."""
    rig, skeleton, found, views = clip.rig.undistorted, clip.detections.skeleton, [], []
    mean, spread = bone_lengths(clip, config)

    def prior(lengths: np.ndarray, joint: int) -> np.ndarray:
        # Twice the upper tail of a normal distribution. A bone that was never measured does not decide.
        return np.nan_to_num(erfc(np.abs(lengths - mean[joint]) / spread[joint] / np.sqrt(2)))

    for frame in frames_of(clip, config):
        people = [
            body
            for group in matched_groups(affinity(frame, rig), frame.view)
            if np.isfinite(body := _body(frame, rig, group, skeleton, prior)).any()
        ]
        found.append(np.array(people).reshape(-1, len(skeleton), 3))
        views.append(np.full(found[-1].shape[:2], 2))
    return as_tracks(clip, found, views)


def affinity(frame: Frame, rig: CameraRig) -> np.ndarray:
    """Return the geometric affinity (n, n) of detections, equation 2: from distances of joints to epipolar lines, px.

    Distances are standardised over all pairs of the frame, so that an affinity says which pair is better than others,
    not which is good.
    """
    count = len(frame.view)
    distance = np.full((count, count), _UNKNOWN_PX)
    homogeneous = np.concatenate([frame.xy, np.ones((*frame.xy.shape[:2], 1))], -1)
    for a, b in combinations(np.unique(frame.view), 2):
        one, other = np.flatnonzero(frame.view == a), np.flatnonzero(frame.view == b)
        fundamental = _fundamental(rig.projections[a], rig.projections[b], rig.centers[a])
        both = homogeneous[one][:, None], homogeneous[other][None]
        lines = both[0] @ fundamental.T, both[1] @ fundamental
        off = sum(
            np.abs((line * point).sum(-1)) / np.linalg.norm(line[..., :2], axis=-1)
            for line, point in zip(lines, both[::-1], strict=True)
        )
        shared = np.isfinite(off)
        mean = np.where(shared, off / 2, 0).sum(-1) / np.maximum(shared.sum(-1), 1)
        distance[np.ix_(one, other)] = np.where(shared.any(-1), mean, _UNKNOWN_PX)
        distance[np.ix_(other, one)] = distance[np.ix_(one, other)].T
    np.fill_diagonal(distance, 0)
    if not count or distance.std() == 0:
        return np.zeros_like(distance)
    if distance.std() < _LEAST_SPREAD_PX:
        np.fill_diagonal(distance, distance.mean())
    return 1 / (1 + np.exp(_STEEPNESS * (distance - distance.mean()) / distance.std()))


def _fundamental(one: np.ndarray, other: np.ndarray, center: np.ndarray) -> np.ndarray:
    """Return F with other^T F one = 0 for pixels of two cameras (3, 4), Hartley & Zisserman 9.1."""
    x, y, z = other @ np.append(center, 1)
    return np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]) @ other @ np.linalg.pinv(one)


def matched_groups(affinities: np.ndarray, view: np.ndarray) -> list[np.ndarray]:
    """Return groups of two or more detections of one person, by cycle-consistent matching of all views.

    A consistent match of all views is a matrix of low rank. Equation 8, min <alpha - A, X> + lambda ||X||_*, over X
    with entries in [0, 1], ones on the diagonal and zeros within a view, is solved by alternating directions (ADMM).
    A group is a detection and its matches that no group has yet, in the order of views.
    """
    count = len(view)
    if not count:
        return []
    weights = np.where(np.eye(count, dtype=bool), 0, (affinities + affinities.T) / 2)
    cost, same_view = _ALPHA - weights, view[:, None] == view
    solution, dual, mu = weights.copy(), np.zeros_like(weights), _MU
    for _ in range(_ITERATIONS):
        before = solution
        left, values, right = np.linalg.svd(dual / mu + solution)
        low_rank = (left * np.maximum(values - _LAMBDA / mu, 0)) @ right
        solution = np.where(same_view, np.eye(count), np.clip(low_rank - (cost + dual) / mu, 0, 1))
        solution = (solution + solution.T) / 2
        dual = dual + mu * (solution - low_rank)
        primal_residual = np.linalg.norm(solution - low_rank) / count
        dual_residual = mu * np.linalg.norm(solution - before) / count
        if max(primal_residual, dual_residual) < _TOLERANCE:
            break
        if primal_residual > 10 * dual_residual:
            mu *= 2
        elif dual_residual > 10 * primal_residual:
            mu /= 2
    matches, free, groups = solution > _MATCHED, np.ones(count, bool), []
    for first in range(count):
        if free[first]:
            groups.append(np.flatnonzero(matches[first] & free))
            free[groups[-1]] = False
    return [group for group in groups if len(np.unique(view[group])) > 1]


def _body(frame: Frame, rig: CameraRig, group: np.ndarray, skeleton, prior) -> np.ndarray:
    """Return the joints (J, 3) of a person, chosen among the points of all pairs of views: section 3.3, max-product."""
    a, b = (group[index] for index in np.triu_indices(len(group), 1))
    other_view = frame.view[a] != frame.view[b]
    points, _ = meet(frame, rig.centers, a[other_view], b[other_view])
    # Logarithms of the product of heatmaps, (pairs, J), in base 10 as in the released code.
    seen = frame.view[group]
    xy, depth = project(rig.projections[seen][:, None, None], points)
    sigma = _HEATMAP_M * rig.focal[seen][:, None, None] / depth
    heat = frame.score[group][:, None] * np.exp(
        -(((xy - frame.xy[group][:, None]) / sigma[..., None]) ** 2).sum(-1) / 2
    )
    scores = np.log10(np.where(np.isnan(frame.score[group])[:, None], 1, np.nan_to_num(heat) + _FLOOR)).sum(0)
    known = np.isfinite(points[..., 0])
    joints = range(len(skeleton))
    candidates = [points[known[:, joint], joint] for joint in joints]
    chosen = max_product([scores[known[:, joint], joint] for joint in joints], candidates, skeleton, prior)
    return np.array(
        [each[index] if index >= 0 else np.full(3, np.nan) for each, index in zip(candidates, chosen, strict=True)]
    )
