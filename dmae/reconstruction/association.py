"""Association within one frame: detections to tracks, and detections of different views to each other.

T tracks; D detections a view, padded with NaN; n detections of all views in a row.
"""

from itertools import combinations

import numpy as np
from scipy.optimize import linear_sum_assignment

from dmae.numerics.closest_approach import closest_approach

NONE = -1
"""Index of no track or detection."""


def propagate(closeness: np.ndarray, confirmed: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Identity propagation: assign detections to the tracks that are reprojected near them.

    In each view the Hungarian algorithm maximises the total closeness. Confirmed tracks are assigned first, so that no
    false positive takes a person's detection. A detection that is left over but lies near a track is a fragment or a
    duplicate of that person.

    Args:
        closeness: (V, T, D, J) how much a detected joint supports being of the track, negative where it contradicts
            that; NaN where either is absent.
        confirmed: (T,) True for tracks that have lasted.

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
        for rank in (confirmed, ~confirmed):
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
    """Measure how close rays of the same joint pass, for all pairs of detections.

    Args:
        origins: (n, 3) camera centre of each detection, m.
        rays: (n, J, 3) unit directions, NaN where the joint is absent.

    Returns:
        (n, n, J) distance between the rays in front of their cameras, m; NaN where either is absent.
    """
    base, rays_a, rays_b = (origins[None] - origins[:, None])[:, :, None], rays[:, None], rays[None]
    along_a, along_b, sine2 = closest_approach(base, rays_a, rays_b)

    def distance(at_a: np.ndarray | float, at_b: np.ndarray | float) -> np.ndarray:
        at_a, at_b = np.asarray(at_a)[..., None], np.asarray(at_b)[..., None]
        return np.linalg.norm(base + at_b * rays_b - at_a * rays_a, axis=-1)

    # Either the lines are closest in front of both cameras, or one of the rays is closest at its start.
    in_front = (sine2 > 1e-8) & (along_a >= 0) & (along_b >= 0)
    on_b, on_a = np.maximum(-(rays_b * base).sum(-1), 0), np.maximum((rays_a * base).sum(-1), 0)
    at_start = np.fmin(distance(0.0, on_b), distance(on_a, 0.0))
    return np.where(in_front, distance(along_a, along_b), at_start)


def affinity(distances: np.ndarray, weights: np.ndarray, half_distance: float) -> np.ndarray:
    """Turn distances into affinities in [0, 1]:

        sum_j w_j / (1 + (d_j / half_distance)^2) / (1 + sum_j w_j).

    The 1 in the denominator keeps the affinity low for pairs that share little evidence.

    Args:
        distances: (n, n, J) NaN where unknown.
        weights: (n, n, J) weight of each joint, at most 1.
        half_distance: Distance at which a joint counts half.

    Returns:
        (n, n) affinities; NaN where no joint is shared.
    """
    known = ~np.isnan(distances)
    weights = np.where(known, weights, 0)
    near = np.where(known, 1 / (1 + (np.where(known, distances, 0) / half_distance) ** 2), 0)
    return np.where(known.any(-1), (weights * near).sum(-1) / (weights.sum(-1) + 1), np.nan)


def cluster(affinities: np.ndarray, view: np.ndarray, threshold: float) -> list[np.ndarray]:
    """Identity matching: group detections of one person, at most one from each view.

    The Hungarian algorithm proposes pairs for every two views. Groups are then joined along these pairs, best support
    first: the affinity of the pair plus, in each other view, that of the detection which fits both. Two groups are
    joined only if their members agree on average, so that what is decided for two views holds in all others.

    Args:
        affinities: (n, n) in [0, 1], NaN where unknown.
        view: (n,) index of the view of each detection.
        threshold: Smallest mean affinity between the members of two groups that are joined.

    Returns:
        Index arrays of the groups of two detections or more, each ordered by view.
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
        into, joined = members[group[a]], members[group[b]]
        if into is joined or set(view[into]) & set(view[joined]):
            continue
        if np.nanmean(affinities[np.ix_(into, joined)]) >= threshold:
            del members[group[b]]
            into += joined
            for i in joined:
                group[i] = group[a]
    return [np.array(sorted(found, key=lambda i: view[i])) for found in members.values() if len(found) > 1]
