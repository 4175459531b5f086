"""Left and right: joints that a detector put on the other side of the body are found and corrected.

A detector may exchange sides for one frame or for seconds, with full confidence, in one view or in most at once. The
other views and neighbouring frames show the correct sides: nobody's left arm is on the right a moment later. So the
sides of a person are followed through time, and views that show the other ones speak against them only as long as that
is more likely than that they exchange sides.
"""

from dataclasses import dataclass, replace

import numpy as np

from dmae.data.clip import Clip, Poses3D
from dmae.data.skeleton import Skeleton
from dmae.files.mapped import in_steps
from dmae.numerics.compiled import compiled
from dmae.reconstruction.association import NONE
from dmae.reconstruction.config import CaptureConfig, DistanceUnit
from dmae.reconstruction.evidence import Evidence, evidence_blocks
from dmae.reconstruction.triangulation import project

_SIGMA, _SPEEDS = 0.04, (0.2, 0.45, 0.7)
"""m and m/s; standard deviation of the distance of joints from their expected places, including the noise of both, and
how fast it grows while joints are predicted by the motion of the body: the first joint of a limb, the second, and
others. Root mean squares of recorded people (CMU). Seen from the side, legs change places in a quarter of a second."""
TURN_S = 0.3  # s; in a longer time somebody may turn round, so that places predicted for it say nothing about sides
_MIN_EVIDENCE = 8.0
"""Smallest logarithm of the ratio of likelihoods, with sides exchanged and as detected, for a pair, a limb or the whole
body to be exchanged. A pair that is exchanged alone is at least 11 cm wide."""
_ODDS, _EXCHANGED_S = 2.2, 0.3
"""Logarithm of the odds that a view shows the sides of a person as they are, nine to one; and s for which it shows them
exchanged, so that it says something new about sides as often as that."""
_LEAST_DOUBT = -15.0  # Smallest doubt; it takes seconds of contradiction, not the whole recording, to turn a person
_FEWEST_PAIRS = 4  # A body is judged as a whole if so many pairs, and half of those that a view shows, are known
_FARTHEST, _MAX_DISTANCE = 0.3, 0.15
"""m; upper limit of the distance of a joint, and largest mean distance of joints after the exchange."""
_LIMBS = (
    ("shoulder", "elbow", "wrist", "little_finger", "index_finger", "thumb"),
    ("hip", "knee", "ankle", "heel", "big_toe", "small_toe"),
)
"""Joints that a detector exchanges together."""


@dataclass(frozen=True)
class Sides:
    """The joints of a skeleton that have a left and a right."""

    pairs: np.ndarray  # (n, 2) indices of left joints and of their partners on the right
    groups: np.ndarray  # (G, n) True for the pairs that are exchanged together: the whole body, and its limbs
    speed: np.ndarray  # (n,) m/s, standard deviation along each axis of their motion about that of the body

    @classmethod
    def of(cls, skeleton: Skeleton) -> "Sides":
        """Return the sides of a skeleton."""
        mirror = np.array(skeleton.mirror, int)
        names = [joint.rpartition(".")[2] for joint in skeleton.joints]
        left = np.array(skeleton.left, int)
        pairs = np.stack([left, mirror[left]], -1).reshape(-1, 2)
        kinds = [names[i].removeprefix("l_") for i in left]
        limbs = [[kind in limb for kind in kinds] for limb in _LIMBS]
        tops, place = np.array([_top(skeleton, joint) for joint in left], int).reshape(-1, 2).T
        if skeleton.defined:
            limbs = [list(tops == top) for top in np.unique(tops)]
        groups = np.array([[True] * len(pairs), *limbs], bool).reshape(1 + len(limbs), len(pairs))
        return cls(pairs, groups, np.array(_SPEEDS)[np.minimum(place, len(_SPEEDS) - 1)])

    def sigma(self, ahead_s: float) -> np.ndarray:
        """Return (n,) standard deviations of the distances of joints from places predicted for so many seconds, m."""
        return np.hypot(_SIGMA, self.speed * ahead_s) if ahead_s <= TURN_S else np.full(len(self.pairs), np.inf)


def _top(skeleton: Skeleton, joint: int) -> tuple[int, int]:
    """Return the first joint of a limb, its highest joint with a partner on the other side, and the number of joints
    from there to this one."""
    parents, mirror, number = skeleton.parents, skeleton.mirror, 0
    while parents[joint] >= 0 and mirror[parents[joint]] != parents[joint]:
        joint, number = parents[joint], number + 1
    return joint, number


def nearer_side(distance: np.ndarray, exchanged: np.ndarray, sides: Sides, ahead_s: float = 0.0) -> np.ndarray:
    """Return distances (..., J), or where they are clearly smaller, the distances with left and right exchanged.

    Args:
        distance: (..., J) m, distances of detected joints from their expected places.
        exchanged: (..., J) m, distances from the expected places of their partners on the other side.
        sides: Sides of the skeleton.
        ahead_s: s for which the expected places are predicted.
    """
    if not len(sides.pairs):
        return distance
    rows, others = (np.ascontiguousarray(each).reshape(-1, distance.shape[-1]) for each in (distance, exchanged))
    row, pair = np.nonzero(judge_sides(rows, others, sides.pairs, sides.groups, sides.sigma(ahead_s)))
    chosen, both = rows.copy(), (row[:, None], sides.pairs[pair])
    chosen[both] = others[both]
    return chosen.reshape(distance.shape)


def follow_sides(
    evidence: Evidence, assigned: np.ndarray, expected: np.ndarray, doubt: np.ndarray, sides: Sides, ahead_s: float
) -> tuple[Evidence, np.ndarray, np.ndarray]:
    """Correct the sides that views show of T tracked people, or turn the people whose own sides are wrong.

    Args:
        evidence: Detections of one frame.
        assigned: (T, V, J) index of the detection that shows the joint in the view, or `NONE`.
        expected: (T, J, 3) m, expected places of the joints; NaN where unknown.
        doubt: (T,) logarithm of the ratio of likelihoods that the sides of a person are exchanged, and right.
        sides: Of the skeleton.
        ahead_s: s for which the expected places are predicted.

    Returns:
        The evidence with left and right exchanged where views are wrong, the doubt after this frame, and (T,) True for
        people whose sides are exchanged from now on.
    """
    found, detection = _measured(evidence, assigned[None], expected[None], sides)
    wrong, said = judge_people(found, detection, sides.groups, sides.sigma(ahead_s))
    doubt = np.where(np.isnan(said[0]), 0, doubt + min(1, ahead_s / _EXCHANGED_S) * said[0])
    turned = doubt > 0
    if turned.any():
        found[:, :, turned] = found[::-1, :, turned]
        wrong, _ = judge_people(found, detection, sides.groups, sides.sigma(ahead_s))
    return _exchanged(evidence, wrong, detection, sides), np.maximum(-np.abs(doubt), _LEAST_DOUBT), turned


def correct_sides(evidence: Evidence, assigned: np.ndarray, expected: np.ndarray, sides: Sides) -> Evidence:
    """Return the evidence with left and right exchanged where `find_exchanged` says so."""
    return _exchanged(evidence, *find_exchanged(evidence, assigned, expected, sides), sides)


def find_exchanged(
    evidence: Evidence, assigned: np.ndarray, expected: np.ndarray, sides: Sides
) -> tuple[np.ndarray, np.ndarray]:
    """Find the pairs of joints with left and right exchanged: of the whole body, or in at most half of the views.

    If most views have a pair or a limb exchanged, its expected place is wrong.

    Args:
        evidence: Detections.
        assigned: (F, P, V, J) index of the detection that shows the joint in the view, or `NONE`.
        expected: (F, P, J, 3) m, expected places of the joints; NaN where unknown.
        sides: Of the skeleton.

    Returns:
        exchanged: (F, P, V, n) True where the sides of a pair are exchanged.
        detection: (F, P, V, n) index of the detection that shows the pair, or `NONE`.
    """
    found, detection = _measured(evidence, assigned, expected, sides)
    return judge_people(found, detection, sides.groups, sides.sigma(0))[0], detection


def _measured(
    evidence: Evidence, assigned: np.ndarray, expected: np.ndarray, sides: Sides
) -> tuple[np.ndarray, np.ndarray]:
    rig, assigned = evidence.rig, np.ascontiguousarray(assigned, np.int64)
    expected = np.ascontiguousarray(expected, np.float64)
    return measure_pairs(rig.projections, rig.focal, evidence.xy, expected, assigned, sides.pairs)


def _exchanged(evidence: Evidence, wrong: np.ndarray, detection: np.ndarray, sides: Sides) -> Evidence:
    """Return the evidence with left and right exchanged in pairs of joints of detections, both (F, P, V, n)."""
    if not wrong.any():
        return evidence
    frame, _, view, pair = np.nonzero(wrong)
    places = (frame, view, detection[wrong])
    left, right = sides.pairs[pair].T
    xy, confidence = evidence.xy.copy(), evidence.confidence.copy()
    for array in (xy, confidence):
        array[*places, left], array[*places, right] = array[*places, right], array[*places, left]
    return replace(evidence, xy=xy, confidence=confidence)


def exchanged_detections(clip: Clip, poses: Poses3D) -> np.ndarray:
    """Return (F, V) True where a camera shows a person of the poses with left and right exchanged.

    Args:
        clip: F frames of V cameras, of the skeleton of the poses.
        poses: As captured from the clip: the detection of a person is the one nearest to it.
    """
    found = np.zeros((len(clip), len(clip.rig)), bool)
    if len(Sides.of(clip.detections.skeleton).pairs) and poses.xyz.size:
        for part in in_steps(evidence_blocks(clip, poses.xyz.shape[1])):
            found[part] = _exchanged_detections(clip, part, poses.xyz[part])
    return found


def _exchanged_detections(clip: Clip, part: slice, xyz: np.ndarray) -> np.ndarray:
    config, sides = CaptureConfig(), Sides.of(clip.detections.skeleton)
    evidence = Evidence.of(clip, config.th_p, config, part)
    xyz, mirrored = xyz.astype(np.float64), xyz[:, :, list(clip.detections.skeleton.mirror)]
    near, other = (evidence.distances(each, DistanceUnit.metres) for each in (xyz, mirrored))
    closeness = np.nansum(np.maximum(1 - nearer_side(near, other, sides) / config.th_d, -1), -1)
    found = np.where(closeness.max(-1, initial=-np.inf) > 0, closeness.argmax(-1), NONE).swapaxes(1, 2)
    assigned = np.repeat(found[..., None], xyz.shape[2], -1)
    wrong, _ = find_exchanged(evidence, assigned, xyz, sides)
    # A pair of ears or eyes alone is weak evidence, as they are close to each other.
    return (wrong.sum(-1) >= 2).any(1)


@compiled()
def measure_pairs(projections, focal, xy, xyz, assigned, pairs):
    """Measure how far detected pairs are from where they are expected, and from where their partners are.

    Args:
        projections: (V, 3, 4) pinhole projection matrices.
        focal: (V,) px.
        xy: (F, V, D, J, 2) px; NaN where absent.
        xyz: (F, P, J, 3) m; NaN where unknown.
        assigned: (F, P, V, J) index of the detection of each joint; negative for none.
        pairs: (n, 2) indices of the left and the right joint.

    Returns:
        (2, F, P, V, n, 2) m, distances of the two joints of each pair, of both kinds, NaN where either is absent; and
        (F, P, V, n) the detection that shows the pair, -1 where none or two do.
    """
    frames, persons, views, _ = assigned.shape
    count = len(pairs)
    detection = np.full((frames, persons, views, count), -1)
    distances = np.full((2, frames, persons, views, count, 2), np.nan)
    for f in range(frames):
        for p in range(persons):
            for v in range(views):
                for n in range(count):
                    d, other = assigned[f, p, v, pairs[n, 0]], assigned[f, p, v, pairs[n, 1]]
                    if d < 0:
                        d = other
                    if d < 0 or (other >= 0 and other != d):
                        continue
                    detection[f, p, v, n] = d
                    for side in range(2):
                        x, y, depth = project(projections[v], xyz[f, p, pairs[n, side]])
                        # The positions of the left and of the right joint are each compared with both detected joints.
                        for shown in range(2):
                            dx, dy = x - xy[f, v, d, pairs[n, shown], 0], y - xy[f, v, d, pairs[n, shown], 1]
                            distance = np.sqrt(dx * dx + dy * dy) * depth / focal[v]
                            distances[int(side != shown), f, p, v, n, shown] = distance
    return distances, detection


@compiled()
def judge_people(distances, detection, groups, sigma):
    """Judge in which views people have left and right exchanged.

    If most views have a pair or a limb exchanged, its expected place is wrong. The whole body is judged in each view,
    if enough of it is known.

    Args:
        distances: (2, F, P, V, n, 2) m, as `measure_pairs` returns them.
        detection: (F, P, V, n) detection that shows the pair, negative for none.
        groups: (G, n) True for the pairs that are exchanged together.
        sigma: (n,) m, standard deviations of the distances of joints from their expected places.

    Returns:
        (F, P, V, n) True for exchanged pairs; and (F, P) logarithm of the ratio of likelihoods of the views if the
        person's sides are exchanged, and if they are right, NaN where no view shows enough that is known. A view may
        show a person exchanged, so it says no more than the odds that it does not.
    """
    frames, persons, views, count = detection.shape
    wrong, said = np.zeros(detection.shape, np.bool_), np.zeros((frames, persons))
    pairs, whole = np.arange(2 * count).reshape(count, 2), np.zeros(views, np.bool_)
    for f in range(frames):
        for p in range(persons):
            observing, judged = 0, 0
            for v in range(views):
                shown = (detection[f, p, v] >= 0).sum()
                whole[v] = False
                if shown == 0:
                    continue
                observing += 1
                here, there = distances[0, f, p, v].ravel(), distances[1, f, p, v].ravel()
                fewest = max(shown / 2, min(count / 2, _FEWEST_PAIRS))
                whole[v], ratio = _judge(here, there, pairs, groups, sigma, fewest, wrong[f, p, v])
                if not np.isnan(ratio):
                    judged += 1
                    odds, ratio = np.exp(_ODDS), np.exp(min(max(ratio, -50.0), 50.0))
                    said[f, p] += np.log((ratio * odds + 1) / (ratio + odds))
            if observing and not judged:
                said[f, p] = np.nan
            for n in range(count):
                exchanged = 0
                for v in range(views):
                    wrong[f, p, v, n] &= detection[f, p, v, n] >= 0
                    exchanged += wrong[f, p, v, n] and not whole[v]
                for v in range(views):
                    wrong[f, p, v, n] &= whole[v] or 2 * exchanged <= observing
    return wrong, said


@compiled()
def judge_sides(distance, exchanged, pairs, groups, sigma):
    """Return (m, n) True for pairs of joints that are clearly nearer to their expected places with sides exchanged.

    Args:
        distance: (m, J) m, distances of joints from their expected places.
        exchanged: (m, J) m, distances from the expected places of their partners.
        pairs: (n, 2) indices of the left and the right joint.
        groups: (G, n) True for the pairs that are exchanged together.
        sigma: (n,) m, standard deviations of the distances of joints from their expected places.
    """
    wrong = np.zeros((len(distance), len(pairs)), np.bool_)
    for i in range(len(distance)):
        _judge(distance[i], exchanged[i], pairs, groups, sigma, np.inf, wrong[i])
    return wrong


@compiled()
def _judge(distance, exchanged, pairs, groups, sigma, fewest, wrong):
    """Write to `wrong` (n,) the pairs of one detection that are exchanged: first the whole body is judged, then its
    limbs, then each pair alone.

    Returns whether the whole body is exchanged, with its unknown pairs, and the logarithm of the ratio of likelihoods,
    NaN if fewer than `fewest` pairs are known.
    """
    number, known = len(pairs), 0
    evidence, after, count = np.zeros(number), np.zeros(number), np.zeros(number)
    for pair in range(number):
        for side in range(2):
            here, there = distance[pairs[pair, side]], exchanged[pairs[pair, side]]
            if not (np.isnan(here) or np.isnan(there)):
                here, there = min(here, _FARTHEST), min(there, _FARTHEST)
                evidence[pair] += (here * here - there * there) / (2 * sigma[pair] * sigma[pair])
                after[pair] += there
                count[pair] += 1
        known += count[pair] > 0
        wrong[pair] = evidence[pair] > _MIN_EVIDENCE and after[pair] <= _MAX_DISTANCE * count[pair]
    whole, ratio = False, np.nan
    for group in range(len(groups)):
        total, near, joints = 0.0, 0.0, 0.0
        for pair in range(number):
            if groups[group, pair]:
                total += evidence[pair]
                near += after[pair]
                joints += count[pair]
        exchange = total > _MIN_EVIDENCE and near <= _MAX_DISTANCE * joints
        if group == 0 and known >= fewest:
            whole, ratio = exchange, total
        if exchange:
            for pair in range(number):
                wrong[pair] |= groups[group, pair]
    for pair in range(number):
        wrong[pair] &= evidence[pair] > -_MIN_EVIDENCE and (count[pair] > 0 or whole)
    return whole, ratio
