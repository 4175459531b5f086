"""Whose detection is whose, within one frame: from tracks to detections, and across views.

T tracks; D detections a view, padded with NaN; n detections of all views in a row.
"""

from itertools import combinations

import numpy as np
from scipy.optimize import linear_sum_assignment

NONE = -1
"""In place of the index of a track or detection."""


def propagate(closeness: np.ndarray, seniors: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Identity propagation: give detections to the tracks on whose reprojection they lie.

    In each view the Hungarian algorithm maximises the total closeness. Senior tracks choose first, so
    that no ghost takes a person's detection. What is left over but lies on a track is a fragment or a
    double of that person.

    Args:
        closeness: (V, T, D, J) how much a detected joint speaks for being the track's, negative where it
            speaks against it; NaN where either is absent.
        seniors: (T,) True for tracks that have lasted.

    Returns:
        owner: (V, D) track of each detection, or `NONE`.
        primary: (V, T) the detection that each track was matched with, or `NONE`.
    """
    views, tracks, detections, _ = closeness.shape
    owner, primary = np.full((views, detections), NONE), np.full((views, tracks), NONE)
    if not tracks:
        return owner, primary
    total = np.nansum(closeness, -1)
    for view in range(views):
        for rank in (seniors, ~seniors):
            rows, columns = np.flatnonzero(rank), np.flatnonzero(owner[view] == NONE)
            if not len(rows):
                continue
            gain = np.maximum(total[view][np.ix_(rows, columns)], 0)
            for row, column in zip(*linear_sum_assignment(gain, maximize=True), strict=True):
                if gain[row, column] > 0:
                    owner[view, columns[column]] = rows[row]
                    primary[view, rows[row]] = columns[column]
    left_over = (owner == NONE) & (total.max(1) > 0)
    owner[left_over] = total.argmax(1)[left_over]
    return owner, primary


def ray_distances(origins: np.ndarray, rays: np.ndarray) -> np.ndarray:
    """How close the rays of the same joint pass, for all pairs of detections.

    Args:
        origins: (n, 3) camera centre of each detection, m.
        rays: (n, J, 3) unit directions, NaN where the joint is absent.

    Returns:
        (n, n, J) m between the rays in front of their cameras; NaN where either is absent.
    """
    base = origins[None] - origins[:, None]
    cosine = np.einsum("ajx,bjx->abj", rays, rays)
    along_a, along_b = np.einsum("abx,ajx->abj", base, rays), np.einsum("abx,bjx->abj", base, rays)

    def gap(far_a: np.ndarray | float, far_b: np.ndarray | float) -> np.ndarray:
        far_a, far_b = np.asarray(far_a)[..., None], np.asarray(far_b)[..., None]
        return np.linalg.norm(base[:, :, None] + far_b * rays[None] - far_a * rays[:, None], axis=-1)

    # Either the lines are closest in front of both cameras, or one of the rays is at its start.
    sine2 = np.maximum(1 - cosine**2, 1e-12)
    far_a, far_b = (along_a - cosine * along_b) / sine2, (cosine * along_a - along_b) / sine2
    in_front = (sine2 > 1e-8) & (far_a >= 0) & (far_b >= 0)
    at_start = np.fmin(gap(0.0, np.maximum(-along_b, 0)), gap(np.maximum(along_a, 0), 0.0))
    return np.where(in_front, gap(far_a, far_b), at_start)


def affinity(distances: np.ndarray, weights: np.ndarray, half: float) -> np.ndarray:
    """From distances to affinities in [0, 1], the weighted mean of 1 / (1 + (distance / half)^2).

    One weight's worth of indifference is added, so that a pair that shares little evidence cannot be sure.

    Args:
        distances: (n, n, J) NaN where unknown.
        weights: (n, n, J) of the evidence, at most 1.
        half: Distance of affinity 1/2.

    Returns:
        (n, n), NaN where nothing is shared.
    """
    known = ~np.isnan(distances)
    weights = np.where(known, weights, 0)
    near = np.where(known, 1 / (1 + (np.where(known, distances, 0) / half) ** 2), 0)
    return np.where(known.any(-1), (weights * near).sum(-1) / (weights.sum(-1) + 1), np.nan)


def cluster(affinities: np.ndarray, view: np.ndarray, threshold: float) -> list[np.ndarray]:
    """Identity matching: groups of detections of one person, at most one from a view.

    The Hungarian algorithm proposes pairs for every two views. Pairs are then joined, those first that
    agree best, with each other and with whom they both agree in all other views, as long as all members
    of the joint group agree with each other on average: what is decided for two views holds in all others.

    Args:
        affinities: (n, n) in [0, 1], NaN where unknown.
        view: (n,) index of the view of each detection.
        threshold: Least mean affinity between the members of two groups to be joined.

    Returns:
        Index arrays of groups of two detections or more, ordered by view.
    """
    known = np.nan_to_num(affinities)
    support = known.copy()
    for third in np.unique(view):
        others = known[:, view == third]
        support += np.minimum(others[:, None], others[None]).max(-1)
    pairs = []
    for a, b in combinations(np.unique(view), 2):
        rows, columns = np.flatnonzero(view == a), np.flatnonzero(view == b)
        block = known[np.ix_(rows, columns)]
        pairs += [
            (support[rows[i], columns[j]], rows[i], columns[j])
            for i, j in zip(*linear_sum_assignment(block, maximize=True), strict=True)
            if block[i, j] >= threshold
        ]
    group = list(range(len(view)))
    members = {i: [i] for i in group}
    for _, a, b in sorted(pairs, key=lambda pair: -pair[0]):
        into, gone = members[group[a]], members[group[b]]
        if into is gone or set(view[into]) & set(view[gone]):
            continue
        if np.nanmean(affinities[np.ix_(into, gone)]) >= threshold:
            del members[group[b]]
            into += gone
            for i in gone:
                group[i] = group[a]
    return [np.array(sorted(found, key=lambda i: view[i])) for found in members.values() if len(found) > 1]
