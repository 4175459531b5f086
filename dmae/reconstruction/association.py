"""Association within one frame: detections to tracks, and detections of different views to each other.

T tracks; D detections per view, padded with NaN; n detections of all views in a row.
"""

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy.optimize import linear_sum_assignment

from dmae.reconstruction.compiled.pairs import find_partners, join, supports
from dmae.reconstruction.config import AssociationConfig

NONE = -1
"""Index of no track or detection."""
_PARTNERS = 16
"""Largest number of detections of another view that are compared further with a detection, by highest affinity."""
_ASSIGNED = 100
"""Largest number of detections of a view for the Hungarian algorithm; with more, all pairs of partners are proposed."""


@dataclass(frozen=True)
class Candidates:
    """Detections of one frame that are compared between views.

    Attributes:
        view: (n,) view of each detection, ascending.
        centers: (V, 3) camera centres, m, float32.
        rays: (n, 3, J) unit directions, float32; zeros where a joint is absent. J is filled up to a multiple of 16.
        weights: (n, J) root of the confidence, float32; 0 where a joint is absent.
        colours: (n, 3) CIELAB, float32; NaN where unknown.
    """

    view: np.ndarray
    centers: np.ndarray
    rays: np.ndarray
    weights: np.ndarray
    colours: np.ndarray

    @classmethod
    def of(cls, view: np.ndarray, centers: np.ndarray, rays: np.ndarray, confidence: np.ndarray) -> "Candidates":
        """Return the candidates of views (n,) with rays (n, J, 3) and confidence (n, J), NaN where absent."""
        absent, (count, joints) = np.isnan(confidence), confidence.shape
        towards = np.zeros((count, 3, -(-joints // 16) * 16), np.float32)
        weights = np.zeros((count, towards.shape[-1]), np.float32)
        towards[..., :joints] = np.where(absent[..., None], 0, rays).swapaxes(1, 2)
        weights[:, :joints] = np.sqrt(np.where(absent, 0, confidence))
        colours = np.full((count, 3), np.nan, np.float32)
        return cls(np.asarray(view, np.int64), np.asarray(centers, np.float32), towards, weights, colours)


def propagate(closeness: np.ndarray, confirmed: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Identity propagation: assign detections to the tracks that are reprojected near them.

    In each view the Hungarian algorithm maximises the total closeness. Confirmed tracks are assigned first, so that no
    false positive takes a person's detection. A remaining detection near a track is a fragment or a duplicate of that
    person.

    Args:
        closeness: (V, T, D, J) support of a detected joint for the track, negative where it contradicts the track; NaN
            where either is absent.
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
    ranks = [rows for rows in (np.flatnonzero(confirmed), np.flatnonzero(~confirmed)) if len(rows)]
    for view in range(views):
        for rows in ranks:
            columns = np.flatnonzero(owner[view] == NONE)
            gain = np.maximum(total[view][rows[:, None], columns], 0)
            row, column = linear_sum_assignment(gain, maximize=True)
            near = gain[row, column] > 0
            row, column = rows[row[near]], columns[column[near]]
            owner[view, column], primary[view, row] = row, column
    left_over = (owner == NONE) & (total.max(1) > 0)
    owner[left_over] = total.argmax(1)[left_over]
    return owner, primary


def find_groups(candidates: Candidates, config: AssociationConfig) -> np.ndarray:
    """Identity matching: group detections of one person, at most one from each view.

    The Hungarian algorithm proposes pairs for every two views. Groups are then joined along these pairs, best support
    first: the affinity of the pair plus, in each other view, that of the detection which fits both. Two groups are
    joined only if their members agree on average, so that a decision for two views is consistent with all others.

    Time and memory are bounded for many detections: only the 16 best partners of a detection in every other view are
    used, and in views with more than 100 detections that have partners, all pairs of partners are proposed.

    Args:
        candidates: n detections of V views.
        config: `ray_distance_m`, `min_affinity`, and the weight of clothes.

    Returns:
        (G, V) detections of the groups of two or more, by view, or `NONE`.
    """
    view, views = candidates.view, len(candidates.centers)
    partners = np.full((len(view), views, _PARTNERS), NONE, np.int32)
    affinities = np.zeros(partners.shape, np.float32)
    detections = (view, candidates.centers, candidates.rays, candidates.weights, candidates.colours)
    weight = 0 if np.isnan(candidates.colours).all() else config.colour_weight
    lengths = np.array([config.ray_distance_m, config.colour_difference, weight], np.float32)
    least = np.float32(config.min_affinity)
    find_partners(*detections, *lengths, least, partners, affinities)
    first, second, found = _pairs(view, partners, affinities)
    if not len(first):
        return np.empty((0, views), int)
    proposed = _proposed(first, second, found, view)
    first, second = first[proposed], second[proposed]
    order = np.argsort(-supports(first, second, found[proposed], view, partners, affinities), kind="stable")
    members = np.full((len(view), views), NONE)
    join(first[order], second[order], *detections, *lengths, least, members)
    return members[(members != NONE).sum(1) > 1]


def highest_affinity(candidates: Candidates, config: AssociationConfig) -> float:
    """Return the highest affinity by rays of two detections of different views; 0 where there are none."""
    partners = np.full((len(candidates.view), len(candidates.centers), 1), NONE, np.int32)
    affinities = np.zeros(partners.shape, np.float32)
    lengths = np.array([config.ray_distance_m, 1, 0], np.float32)
    c = candidates
    find_partners(c.view, c.centers, c.rays, c.weights, c.colours, *lengths, np.float32(0), partners, affinities)
    return float(affinities.max(initial=0))


def count_pairs(candidates: Candidates, config: AssociationConfig) -> tuple[int, int]:
    """Return the number of pairs of detections of different views with a common joint, and how many agree by rays.

    If many detections agree with one, only the 16 best in each view count.
    """
    view, known = candidates.view, (candidates.weights > 0).astype(np.float32)
    shared = (known @ known.T > 0) & (view[:, None] < view)
    partners = np.full((len(view), len(candidates.centers), _PARTNERS), NONE, np.int32)
    affinities = np.zeros(partners.shape, np.float32)
    lengths = np.array([config.ray_distance_m, 1, 0], np.float32)
    c = candidates
    least = np.float32(config.min_affinity)
    find_partners(c.view, c.centers, c.rays, c.weights, c.colours, *lengths, least, partners, affinities)
    return int(shared.sum()), len(_pairs(view, partners, affinities)[0])


def _pairs(view: np.ndarray, partners: np.ndarray, affinities: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return pairs of mutual partners, each once: detections (m,) of the lower view, detections (m,) of the higher
    view, and their affinities (m,)."""
    one, _, _ = np.nonzero(partners != NONE)
    other, found = partners[partners != NONE].astype(np.int64), affinities[partners != NONE]
    low, high = np.minimum(one, other), np.maximum(one, other)
    _, kept, lists = np.unique(low * len(view) + high, return_index=True, return_counts=True)
    kept = kept[lists == 2]
    return low[kept], high[kept], found[kept]


def _proposed(first: np.ndarray, second: np.ndarray, found: np.ndarray, view: np.ndarray) -> np.ndarray:
    """Return the indices of pairs (m,) that the Hungarian algorithm proposes for every two views."""
    proposed = []
    for a, b in combinations(np.unique(view), 2):
        pairs = np.flatnonzero((view[first] == a) & (view[second] == b))
        rows, row = np.unique(first[pairs], return_inverse=True)
        columns, column = np.unique(second[pairs], return_inverse=True)
        if max(len(rows), len(columns)) <= _ASSIGNED:
            block = np.zeros((len(rows), len(columns)))
            block[row, column] = found[pairs]
            index = np.full(block.shape, NONE)
            index[row, column] = pairs
            pairs = index[linear_sum_assignment(block, maximize=True)]
        proposed.append(pairs[pairs != NONE])
    return np.concatenate(proposed)
