"""Association within one frame: detections to tracks, and detections of different views to each other.

T tracks; D detections per view, padded with NaN; n detections of all views in a row.
"""

from typing import NamedTuple

import numpy as np
from scipy.optimize import linear_sum_assignment

from dmae.numerics.compiled import compiled
from dmae.reconstruction.config import AssociationConfig

NONE = -1
"""Index of no track or detection."""
_COLOUR_DIFFERENCE = np.float32(20)  # CIELAB units; colour difference of clothes at which their affinity is 1/2
_PARTNERS = 16
"""Largest number of detections of another view that are compared further with a detection, by highest affinity."""
_ASSIGNED = 100
"""Largest number of detections of a view for the Hungarian algorithm; with more, all pairs of partners are proposed."""


class Candidates(NamedTuple):
    """Detections of one frame that are compared between views. Compiled functions take them as they are."""

    in_view: np.ndarray  # (n,) view of each detection, ascending
    centers: np.ndarray  # (V, 3) camera centres, m, float32
    # (n, 3, J) unit directions, float32; zeros where a joint is absent. J is filled up to a multiple of 16.
    rays: np.ndarray
    # (n, J) root of the confidence, float32; 0 where a joint is absent. Processors take 16 joints together.
    weights: np.ndarray
    colours: np.ndarray  # (n, 3) CIELAB, float32; NaN where unknown

    @classmethod
    def of(cls, view: np.ndarray, centers: np.ndarray, rays: np.ndarray, confidence: np.ndarray) -> "Candidates":
        """Return the candidates of views (n,) with rays (n, J, 3) and confidence (n, J), NaN where absent."""
        absent, (count, joints) = np.isnan(confidence), confidence.shape
        towards = np.zeros((count, 3, -(-joints // 16) * 16), np.float32)
        weights = np.zeros((count, towards.shape[-1]), np.float32)
        towards[..., :joints] = np.where(absent[..., None], 0, rays).swapaxes(1, 2)
        weights[:, :joints] = np.sqrt(np.where(absent, 0, confidence))
        colours = np.full((count, 3), np.nan, np.float32)
        return cls(np.ascontiguousarray(view, np.int64), np.asarray(centers, np.float32), towards, weights, colours)


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


def find_groups(candidates: Candidates, config: AssociationConfig, exchange: bool = False) -> np.ndarray:
    """Identity matching: group detections of one person, at most one from each view.

    The Hungarian algorithm proposes pairs for every two views. Groups are then joined along these pairs, best support
    first: the evidence for the pair and, in each other view, for the detection that fits both. The evidence is
    what an affinity exceeds `min_affinity` by: strangers reach that, so two pairs at the threshold do not outweigh a
    good one. Two groups are joined only if their members agree on average, and no two by less than half of that, so
    that a decision for two views is consistent with all others.

    Time and memory are bounded for many detections: only the 16 best partners of a detection in every other view are
    used, and in views with more than 100 detections that have partners, all pairs of partners are proposed.

    Args:
        candidates: n detections of V views.
        config: `ray_distance_m`, `min_affinity`, and the weight of clothes.
        exchange: Improve the groups as a whole, by `exchange_members`; memory is then quadratic in n.

    Returns:
        (G, V) detections of the groups of two or more, by view, or `NONE`.
    """
    view, views = candidates.in_view, len(candidates.centers)
    weight = 0 if np.isnan(candidates.colours).all() else config.colour_weight
    partners, affinities = _partners(candidates, config, weight, config.min_affinity)
    affinities -= np.float32(config.min_affinity)
    first, second, found = _pairs(view, partners, affinities)
    if not len(first) and not exchange:
        return np.empty((0, views), int)
    proposed = _proposed(first, second, found, view)
    first, second = first[proposed], second[proposed]
    order = np.argsort(-supports(first, second, found[proposed], view, partners, affinities), kind="stable")
    lengths = np.array([config.ray_distance_m, weight, config.min_affinity], np.float32)
    members = join(first[order], second[order], candidates, *lengths)
    if exchange:
        exchange_members(members, view, pair_evidence(candidates, *lengths), lengths[-1])
    return members[(members != NONE).sum(1) > 1]


def highest_affinity(candidates: Candidates, config: AssociationConfig) -> float:
    """Return the highest affinity by rays of two detections of different views; 0 where there are none."""
    _, affinities = _partners(candidates, config, colour_weight=0, least=0, most=1)
    return float(affinities.max(initial=0))


def count_pairs(candidates: Candidates, config: AssociationConfig) -> tuple[int, int]:
    """Return the number of pairs of detections of different views with a common joint, and how many agree by rays.

    If many detections agree with one, only the 16 best in each view count.
    """
    view, known = candidates.in_view, (candidates.weights > 0).astype(np.float32)
    shared = (known @ known.T > 0) & (view[:, None] < view)
    found = _partners(candidates, config, colour_weight=0, least=config.min_affinity)
    return int(shared.sum()), len(_pairs(view, *found)[0])


def _partners(
    candidates: Candidates, config: AssociationConfig, colour_weight: float, least: float, most: int = _PARTNERS
) -> tuple[np.ndarray, np.ndarray]:
    """Return the `most` best partners (n, V, most) of each detection in each other view, and their affinities."""
    rays, shown = (np.ascontiguousarray(np.moveaxis(each, 0, -1)) for each in (candidates.rays, candidates.weights))
    lengths = np.array([config.ray_distance_m, colour_weight, least], np.float32)
    return find_partners(candidates, rays, shown, *lengths, most)


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
    views = view.max() + 1
    between = view[first] * views + view[second]
    order = np.argsort(between, kind="stable")
    lists = first * views + view[second], second * views + view[first]
    if not any((np.bincount(each) > 1).any() for each in lists):
        return order  # no detection has a choice
    proposed = []
    for pairs in np.split(order, np.flatnonzero(np.diff(between[order])) + 1):
        (row, rows), (column, columns) = (_numbered(each[pairs], len(view)) for each in (first, second))
        if max(rows, columns) <= _ASSIGNED:
            block = np.zeros((rows, columns))
            block[row, column] = found[pairs]
            index = np.full(block.shape, NONE)
            index[row, column] = pairs
            pairs = index[linear_sum_assignment(block, maximize=True)]
        proposed.append(pairs[pairs != NONE])
    return np.concatenate(proposed)


def _numbered(values: np.ndarray, most: int) -> tuple[np.ndarray, int]:
    """Return the ranks of integers below `most` among those that occur, and how many occur; np.unique is slower."""
    occurs = np.zeros(most, int)
    occurs[values] = 1
    rank = np.cumsum(occurs)
    return rank[values] - 1, int(rank[-1])


_PARALLEL = np.float32(1e-8)  # Squared sine of an angle; lines at smaller ones are parallel
_FIRST = 19  # Number of joints by which most pairs are rejected, before the other joints are compared
_ROUNDING = np.float32(1e-4)  # Of affinities, by far


@compiled(fastmath=True)
def _ray_distance(ax, ay, az, bx, by, bz, base_x, base_y, base_z, square):
    """Return s and s d^2 of two rays at the distance d in front of their cameras, with s > 0: one division serves all.

    `base` is m from the start of a to the start of b, `square` its squared length; directions are unit vectors.
    """
    zero, one = np.float32(0), np.float32(1)
    cosine = ax * bx + ay * by + az * bz
    base_a = ax * base_x + ay * base_y + az * base_z
    base_b = bx * base_x + by * base_y + bz * base_z
    cx, cy, cz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    sine2 = cx * cx + cy * cy + cz * cz
    volume = cx * base_x + cy * base_y + cz * base_z
    # Either the lines are closest in front of both cameras, or one of the rays is closest at its start.
    ahead = (sine2 > _PARALLEL) & (base_a >= cosine * base_b) & (cosine * base_a >= base_b)
    # Written as choices, not with min and max, so that loops are vectorised.
    back_a, back_b = base_a if base_a > zero else zero, base_b if base_b < zero else zero
    back_a, back_b = back_a * back_a, back_b * back_b
    at_start = square - (back_a if back_a > back_b else back_b)
    at_start = at_start if at_start > zero else zero
    # The distance of the lines is |volume| / sine.
    share = sine2 if ahead else one
    return share, volume * volume if ahead else share * at_start


@compiled(fastmath=True)
def agreement(a, b, rays, weights, base_x, base_y, base_z, half_distance):
    """Return sums over the joints of two detections: of w_j / (1 + (d_j / half_distance)^2), and of w_j.

    d_j is the distance between the rays of joint j in front of their cameras, and w_j the product of their weights.

    Args:
        a: Index of a detection.
        b: Index of the other one.
        rays: (n, 3, J) unit directions; zeros where the joint is absent.
        weights: (n, J) root of the confidence; 0 where the joint is absent.
        base_x: m, x from the camera of a to the camera of b; `base_y` and `base_z` are y and z.
        half_distance: m, distance at which a joint counts half.
    """
    zero, one = np.float32(0), np.float32(1)
    square = base_x * base_x + base_y * base_y + base_z * base_z
    scale = one / (half_distance * half_distance)
    near, total = zero, zero
    for j in range(weights.shape[1]):
        weight = weights[a, j] * weights[b, j]
        share, distance2 = _ray_distance(
            rays[a, 0, j], rays[a, 1, j], rays[a, 2, j], rays[b, 0, j], rays[b, 1, j], rays[b, 2, j],
            base_x, base_y, base_z, square,
        )  # fmt: skip
        near += weight * share / (share + distance2 * scale)
        total += weight
    return near, total


@compiled()
def affinity(i, j, candidates, half_distance, colour_weight):
    """Return the affinity of detections i and j by rays and clothes, -1 where they share no joint; and sum_j w_j.

    The affinity by rays is

        sum_j w_j / (1 + (d_j / half_distance)^2) / (1 + sum_j w_j).

    The 1 in the denominator keeps it low for pairs that share little evidence.

    Args:
        candidates: n `Candidates`.
        half_distance: m, float32, as all numbers that follow.
        colour_weight: Weight of colours, 0 to 1; 0 if none is known.
    """
    one, colours, centers = np.float32(1), candidates.colours, candidates.centers
    a, b = candidates.in_view[i], candidates.in_view[j]
    x, y, z = centers[b, 0] - centers[a, 0], centers[b, 1] - centers[a, 1], centers[b, 2] - centers[a, 2]
    square, dressed = np.float32(0), False
    if colour_weight > 0:
        for k in range(3):
            square += (colours[i, k] - colours[j, k]) ** 2
        dressed = not np.isnan(square)
    near, total = agreement(i, j, candidates.rays, candidates.weights, x, y, z, half_distance)
    if total == 0:
        return -one, total
    found = near / (one + total)
    if dressed:
        similarity = one / (one + square / (_COLOUR_DIFFERENCE * _COLOUR_DIFFERENCE))
        found += colour_weight * (similarity - found)
    return found, total


@compiled()
def find_partners(candidates, rays, shown, half_distance, colour_weight, least, number):
    """Return the best partners of each detection in each other view.

    Args:
        candidates: As for `affinity`.
        rays: (3, J, n) their rays.
        shown: (J, n) their weights.
        half_distance: As for `affinity`, as is `colour_weight`.
        least: Smallest affinity of partners.
        number: Largest number C of partners in a view.

    Returns:
        partners: (n, V, C) indices of partners, the best first; -1 for none.
        affinities: (n, V, C) their affinities.
    """
    view, centers = candidates.in_view, candidates.centers
    count, one = len(view), np.float32(1)
    partners = np.full((count, len(centers), number), -1, np.int32)
    affinities = np.zeros((count, len(centers), number), np.float32)
    most = np.zeros(count, np.float32)
    # Below this, the affinity is too low even with clothes of the same colour.
    by_rays = -one if colour_weight >= one else (least - colour_weight) / (one - colour_weight) - _ROUNDING
    for i in range(count):
        a, first = view[i], i + 1
        while first < count:
            b, last = view[first], first + 1
            while last < count and view[last] == b:
                last += 1
            if a != b:
                x, y, z = centers[b, 0] - centers[a, 0], centers[b, 1] - centers[a, 1], centers[b, 2] - centers[a, 2]
                _most(i, first, last, rays, shown, x, y, z, half_distance, by_rays, most)
                for j in range(first, last):
                    if most[j - first] < by_rays:
                        continue
                    found, _ = affinity(i, j, candidates, half_distance, colour_weight)
                    if found >= least:
                        _insert(partners[i, b], affinities[i, b], j, found)
                        _insert(partners[j, a], affinities[j, a], i, found)
            first = last
    return partners, affinities


@compiled(fastmath=True)
def _most(i, first, last, rays, weights, base_x, base_y, base_z, half_distance, by_rays, most):
    """Write an upper bound of `near - by_rays * total`, the sums of `agreement`, of detection i and `first` to `last`.

    Only the rays (3, J, n) of the first joints are compared; the others are assumed to meet. `by_rays` is the
    least affinity of interest, `weights` (J, n) are roots of confidences, `most` (n,) is written from its beginning.
    """
    zero, one = np.float32(0), np.float32(1)
    square = base_x * base_x + base_y * base_y + base_z * base_z
    scale = one / (half_distance * half_distance)
    most[:] = zero
    for k in range(weights.shape[0]):
        own, theirs = weights[k, i], weights[k][first:last]
        if own == zero:
            continue
        if k >= _FIRST:
            for j in range(len(theirs)):
                most[j] += own * theirs[j] * (one - by_rays)
            continue
        ax, ay, az = rays[0, k, i], rays[1, k, i], rays[2, k, i]
        xs, ys, zs = rays[0, k][first:last], rays[1, k][first:last], rays[2, k][first:last]
        for j in range(len(theirs)):
            share, distance2 = _ray_distance(ax, ay, az, xs[j], ys[j], zs[j], base_x, base_y, base_z, square)
            most[j] += own * theirs[j] * (share / (share + distance2 * scale) - by_rays)


@compiled()
def _insert(partners, affinities, partner, found):
    """Insert a partner into lists that are sorted by affinity; the last one is dropped."""
    place = len(partners)
    while place > 0 and (partners[place - 1] < 0 or affinities[place - 1] < found):
        place -= 1
    if place == len(partners):
        return
    for k in range(len(partners) - 1, place, -1):
        partners[k], affinities[k] = partners[k - 1], affinities[k - 1]
    partners[place], affinities[place] = partner, found


@compiled()
def supports(first, second, found, view, partners, affinities):
    """Return the support of pairs of partners (m,).

    It is the evidence for the pair plus, in each other view, the evidence for the detection that fits both.

    Args:
        first: (m,) detections.
        second: (m,) their partners.
        found: (m,) affinities, less the affinity of strangers.
        view: (n,) view of each detection.
        partners: (n, V, C) as `find_partners` returns them.
        affinities: (n, V, C), less the affinity of strangers.
    """
    support = found.copy()
    for pair in range(len(first)):
        i, j = first[pair], second[pair]
        for third in range(partners.shape[1]):
            if third == view[i] or third == view[j]:
                continue
            best = np.float32(0)
            for k in range(partners.shape[2]):
                if partners[i, third, k] < 0 or affinities[i, third, k] <= best:
                    break
                for m in range(partners.shape[2]):
                    if partners[j, third, m] < 0 or affinities[j, third, m] <= best:
                        break
                    if partners[j, third, m] == partners[i, third, k]:
                        best = min(affinities[i, third, k], affinities[j, third, m])
            support[pair] += best
    return support


@compiled()
def join(first, second, candidates, half_distance, colour_weight, least):
    """Join groups along pairs, in the order given, where their members agree on average and none contradict each other.

    Args:
        first: (m,) detections.
        second: (m,) their partners.
        candidates: As for `affinity`; so are the two arguments that follow.
        least: Smallest mean affinity between the members of two groups that are joined. No two members have less than
            half of it.
    Returns:
        (n, V) each row contains the detections of a group by view, -1 for none, or is empty.
    """
    view = candidates.in_view
    group, members = np.arange(len(view)), np.full((len(view), len(candidates.centers)), -1)
    for i in range(len(view)):
        members[i, view[i]] = i
    for pair in range(len(first)):
        a, b = group[first[pair]], group[second[pair]]
        if a == b:
            continue
        overlap = False
        for v in range(members.shape[1]):
            overlap |= members[a, v] >= 0 and members[b, v] >= 0
        if overlap:
            continue
        total, count, lowest = 0.0, 0, 1.0
        for u in range(members.shape[1]):
            for v in range(members.shape[1]):
                i, j = members[a, u], members[b, v]
                if i >= 0 and j >= 0:
                    found, _ = affinity(i, j, candidates, half_distance, colour_weight)
                    if found >= 0:
                        total += found
                        count += 1
                        lowest = min(lowest, found)
        if count and total / count >= least and lowest >= least / 2:
            for v in range(members.shape[1]):
                if members[b, v] >= 0:
                    group[members[b, v]] = a
                    members[a, v] = members[b, v]
                    members[b, v] = -1
    return members


_SWEEPS = 20  # Largest number of times that all detections are compared with all groups; three are usual
_NEVER = -1e6  # Evidence for a detection in a group that it cannot belong to


@compiled()
def pair_evidence(candidates, half_distance, colour_weight, least):
    """Return (n, n) the evidence that two detections show one person, counted in joints.

    This is what their affinity exceeds the least one by, times the weights of the joints that both show. It is NaN
    where they share none, and -inf for detections of one view and where less than half of the least affinity says that
    they are two people. For that, one more joint counts that just reaches it: detectors put single joints anywhere.

    Its arguments mean what they mean in `join`.
    """
    view, one = candidates.in_view, np.float32(1)
    evidence = np.full((len(view), len(view)), -np.inf, np.float32)
    for i in range(len(view)):
        for j in range(i + 1, len(view)):
            if view[i] == view[j]:
                continue
            found, shared = affinity(i, j, candidates, half_distance, colour_weight)
            near = found * (one + shared)
            if shared == 0:
                evidence[i, j] = evidence[j, i] = np.nan
            elif near + least >= least / 2 * (one + shared):
                evidence[i, j] = evidence[j, i] = near - least * shared
    return evidence


@compiled()
def exchange_members(members, view, evidence, least):
    """Move detections between groups while that increases the evidence of all groups together.

    The evidence of a group sums over its pairs, less `least` for each member but one. A detection thus belongs to a
    group if all joints that it shares with the members, counted together, have at least this affinity: views that show
    different parts of a person have few joints in common with each other. Groups that were joined early, along the best
    pairs, may have taken what another group needs more. A detection moves to another group, from which the one of the
    same view leaves or takes its place; or it leaves its group. The best moves come first.

    Args:
        members: (n, V) as `join` returns them; written.
        view: (n,) view of each detection.
        evidence: (n, n) as `pair_evidence` returns it.
        least: As for `pair_evidence`.
    """
    group, gains, most = np.zeros(len(view), np.int64), np.zeros(len(view)), np.zeros(len(view))
    one, others = np.nonzero(evidence > 0)
    first = np.searchsorted(one, np.arange(len(view) + 1))
    for g in range(len(members)):
        for i in members[g]:
            if i >= 0:
                group[i] = g
    for _ in range(_SWEEPS):
        for i in range(len(view)):
            agreeing = others[first[i] : first[i + 1]]
            gains[i], _to = _best_move(i, agreeing, most, members, group, view, evidence, least)
        changed = False
        while gains.max() > _ROUNDING:
            i = gains.argmax()
            gains[i] = 0
            # Earlier moves may have changed what is best.
            agreeing = others[first[i] : first[i + 1]]
            gain, to = _best_move(i, agreeing, most, members, group, view, evidence, least)
            if gain <= _ROUNDING:
                continue
            own, v, changed = group[i], view[i], True
            replaced = members[to, v]
            members[own, v], members[to, v], group[i] = -1, i, to
            if replaced >= 0:
                if _link(replaced, members[own], v, evidence, least) <= 0:
                    own = _empty(members)
                members[own, v], group[replaced] = replaced, own
        if not changed:
            break


@compiled()
def _best_move(i, agreeing, most, members, group, view, evidence, least):
    """Return the largest gain of a move of detection i, and the group to which it moves; see `exchange_members`.

    Args:
        agreeing: Detections with evidence for being the same person as i.
        most: (n,) zeros, for the evidence of each group; zeros again afterwards.
    """
    own, v = group[i], view[i]
    here = _link(i, members[own], v, evidence, least)
    best, to = 0.0, own
    if here < 0:
        best, to = -here, _empty(members)
    # No group gains more than what its members that agree with the detection say, which most groups need not exceed.
    for j in agreeing:
        most[group[j]] += evidence[i, j]
    for j in agreeing:
        g, bound = group[j], most[group[j]] - least - here
        most[g] = 0
        if g == own or bound <= best:
            continue
        gain, replaced = _link(i, members[g], v, evidence, least) - here, members[g, v]
        if gain <= best:
            continue
        if replaced >= 0:
            gain -= _link(replaced, members[g], v, evidence, least)
            gain += max(_link(replaced, members[own], v, evidence, least), 0.0)
        if gain > best:
            best, to = gain, g
    return best, to


@compiled()
def _link(i, row, v, evidence, least):
    """Return the evidence for detection i of view v in a group (V,) without its member of that view; 0 if it is empty
    then."""
    total, others, shared = 0.0, 0, 0
    for u in range(len(row)):
        if u != v and row[u] >= 0:
            found = evidence[i, row[u]]
            others += 1
            if not np.isnan(found):
                total += found
                shared += 1
    if others == 0:
        return 0.0
    return max(total - least, _NEVER) if shared else _NEVER


@compiled()
def _empty(members):
    """Return the index of an empty group. There is one if any has two members, as there are as many as detections."""
    for g in range(len(members)):
        if (members[g] < 0).all():
            return g
    return -1
