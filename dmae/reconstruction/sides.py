"""Left and right: joints that a detector put on the other side of the body are found and corrected.

A detector may exchange sides for one frame or for seconds, with full confidence, in one view or in most at once. The
other views and neighbouring frames show the correct sides: nobody's left arm is on the right a moment later.
"""

from dataclasses import dataclass, replace
from math import prod

import numpy as np

from dmae.data.clip import Clip, Poses3D
from dmae.data.skeleton import Skeleton
from dmae.files.mapped import frame_blocks, in_steps
from dmae.numerics.compiled import compiled
from dmae.reconstruction.association import NONE
from dmae.reconstruction.config import CaptureConfig, DistanceUnit
from dmae.reconstruction.evidence import Evidence, evidence_blocks
from dmae.reconstruction.triangulation import project

_SIGMA, _SPEED = 0.04, 0.2
"""m and m/s; standard deviation of the distance of joints from their expected places, including the noise of both, and
how fast it grows while joints are predicted by the motion of the body."""
_TURN_S = 0.3  # s; in a longer time somebody may turn round, so that places predicted for it say nothing about sides
_MIN_EVIDENCE = 8.0
"""Smallest logarithm of the ratio of likelihoods, with sides exchanged and as detected, for a pair, a limb or the whole
body to be exchanged. A pair that is exchanged alone is at least 11 cm wide."""
_FARTHEST, _MAX_DISTANCE = 0.3, 0.15
"""m; upper limit of the distance of a joint, and largest mean distance of joints after the exchange."""
_EXCHANGED, _EXCHANGED_S = 0.1, 0.3
"""Share of the time in which a view shows left and right of a person exchanged, and s for which it does so at once."""
_SWING = 1.5, 4.0  # m/s; how fast the two joints of a pair move relative to each other, in the trunk and in limbs
_MOST_OF_A_PAIR, _RARE = 4.0, 1.0
"""Logarithms of the ratio of likelihoods that a person is tracked with the sides of the frame before and with the other
ones: the most that a pair of joints says, as it may be wrong; and what is known without joints."""
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
    trunk: np.ndarray  # (n,) True for the pairs where limbs begin, which nobody swings past each other

    @classmethod
    def of(cls, skeleton: Skeleton) -> "Sides":
        """Return the sides of a skeleton."""
        mirror = np.array(skeleton.mirror, int)
        names = [joint.rpartition(".")[2] for joint in skeleton.joints]
        left = np.array(skeleton.left, int)
        pairs = np.stack([left, mirror[left]], -1).reshape(-1, 2)
        kinds = [names[i].removeprefix("l_") for i in left]
        limbs = [[kind in limb for kind in kinds] for limb in _LIMBS]
        trunk = np.isin(kinds, [limb[0] for limb in _LIMBS])
        if skeleton.defined:
            tops = np.array([_top(skeleton, joint) for joint in left], int)
            limbs, trunk = [list(tops == top) for top in np.unique(tops)], tops == left
        groups = np.array([[True] * len(pairs), *limbs], bool).reshape(1 + len(limbs), len(pairs))
        return cls(pairs, groups, trunk.reshape(len(pairs)))

    def weights(self) -> np.ndarray:
        """Return what each pair (n,) counts: what hangs from the first pair of a limb moves together, so that all of it
        counts as one pair; so does what is in no limb, as eyes and ears."""
        limb = np.where(self.groups[1:].any(0), self.groups[1:].argmax(0), len(self.groups))
        return np.where(self.trunk, 1, 1 / np.maximum(np.bincount(limb, ~self.trunk)[limb], 1))


def _top(skeleton: Skeleton, joint: int) -> int:
    """Return the first joint of a limb: its highest joint with a partner on the other side."""
    parents, mirror = skeleton.parents, skeleton.mirror
    while parents[joint] >= 0 and mirror[parents[joint]] != parents[joint]:
        joint = parents[joint]
    return joint


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
    row, pair = np.nonzero(judge_sides(rows, others, sides.pairs, sides.groups, _sigma(ahead_s)))
    chosen, both = rows.copy(), (row[:, None], sides.pairs[pair])
    chosen[both] = others[both]
    return chosen.reshape(distance.shape)


def _sigma(ahead_s: float) -> float:
    """Return the standard deviation of the distance of joints from places predicted for so many seconds, m."""
    return float(np.hypot(_SIGMA, _SPEED * ahead_s)) if ahead_s <= _TURN_S else np.inf


def find_exchanged(
    evidence: Evidence, assigned: np.ndarray, expected: np.ndarray, sides: Sides, ahead_s: float = 0.0
) -> tuple[np.ndarray, np.ndarray]:
    """Find the pairs of joints with left and right exchanged in a minority of views, or in half of them.

    If most views have them exchanged, the expected place is wrong.

    Args:
        evidence: Detections.
        assigned: (F, P, V, J) index of the detection that shows the joint in the view, or `NONE`.
        expected: (F, P, J, 3) m, expected places of the joints; NaN where unknown.
        sides: Of the skeleton.
        ahead_s: s for which the expected places are predicted.

    Returns:
        exchanged: (F, P, V, n) True where the sides of a pair are exchanged.
        detection: (F, P, V, n) index of the detection that shows the pair, or `NONE`.
    """
    found, detection = _measured_pairs(evidence, assigned, expected, sides)
    rows, both = found.reshape(2, prod(detection.shape[:-1]), sides.pairs.size), np.arange(sides.pairs.size)
    wrong = judge_sides(rows[0], rows[1], both.reshape(sides.pairs.shape), sides.groups, _sigma(ahead_s))
    wrong = wrong.reshape(detection.shape)
    observing = (assigned != NONE).any(-1).sum(2)[:, :, None, None]
    return wrong & (2 * wrong.sum(2, keepdims=True) <= observing), detection


def _measured_pairs(
    evidence: Evidence, assigned: np.ndarray, expected: np.ndarray, sides: Sides
) -> tuple[np.ndarray, np.ndarray]:
    """Return distances (2, F, P, V, n, 2), see `measure_pairs`, and the detection (F, P, V, n) that shows each pair."""
    left, right = (assigned[..., sides.pairs[:, side]] for side in (0, 1))
    detection = np.where(left == NONE, right, left)
    detection = np.where((right != NONE) & (right != detection), NONE, detection)
    expected, shown = np.ascontiguousarray(expected, np.float64), np.ascontiguousarray(detection, np.int64)
    rig = evidence.rig
    return measure_pairs(rig.projections, rig.focal, evidence.xy, expected, shown, sides.pairs), detection


def correct_sides(
    evidence: Evidence, assigned: np.ndarray, expected: np.ndarray, sides: Sides, ahead_s: float = 0.0
) -> Evidence:
    """Return the evidence with left and right exchanged where `find_exchanged` says so."""
    wrong, detection = find_exchanged(evidence, assigned, expected, sides, ahead_s)
    return _exchanged(evidence, wrong, np.stack([detection, detection], -1), sides)


def _exchanged(evidence: Evidence, wrong: np.ndarray, detections: np.ndarray, sides: Sides) -> Evidence:
    """Return the evidence with left and right exchanged in `wrong` (F, P, V, n) pairs.

    `detections` (F, P, V, n, 2) are those that show the left and the right joint.
    """
    if not wrong.any():
        return evidence
    frame, _, view, pair = np.nonzero(wrong)
    left, right = ((frame, view, detections[wrong][:, side], sides.pairs[pair, side]) for side in (0, 1))
    xy, confidence = evidence.xy.copy(), evidence.confidence.copy()
    for array in (xy, confidence):
        array[left], array[right] = array[right], array[left]
    return replace(evidence, xy=xy, confidence=confidence)


def side_votes(evidence: Evidence, assigned: np.ndarray, xyz: np.ndarray, sides: Sides) -> np.ndarray:
    """Return (F, P) logarithms of the ratio of two likelihoods of what views show: if people's sides are exchanged,
    and if they are as tracked.

    Args:
        evidence: Detections.
        assigned: (F, P, V, J) index of the detection that shows the joint in the view, or `NONE`.
        xyz: (F, P, J, 3) m, joints as tracked; NaN where absent.
        sides: Of the skeleton.
    """
    found, _ = _measured_pairs(evidence, assigned, xyz, sides)
    own, other = np.minimum(found, _FARTHEST) ** 2 / (2 * max(_SIGMA, evidence.noise.usual_m) ** 2)
    ratio, odds = np.nansum(own - other, (-1, -2)), np.log(1 / _EXCHANGED - 1)
    # A view may itself be wrong, so it says no more than the odds that it is right.
    return (np.logaddexp(ratio + odds, 0) - np.logaddexp(ratio, odds)).sum(-1)


def find_turned(xyz: np.ndarray, votes: np.ndarray, sides: Sides, fps: float, deviation: float) -> np.ndarray:
    """Find the frames in which people were tracked with left and right exchanged, as most views showed them so.

    Returns the most likely sequence of sides (Viterbi) of a hidden Markov model of two states, right and exchanged:
    views vote for the sides that they show, and pairs of joints speak for the sides that they had a moment before.

    Args:
        xyz: (F, P, J, 3) m, joints as tracked; NaN where absent.
        votes: (F, P) as `side_votes` returns them.
        sides: Of the skeleton.
        fps: Frames per second.
        deviation: m, standard deviation of a joint along one axis.

    Returns:
        (F, P) True where left and right are exchanged.
    """
    if not len(sides.pairs):
        return np.zeros(xyz.shape[:2], bool)
    weight, swing, shape = sides.weights(), np.where(sides.trunk, *_SWING), (xyz.shape[1], len(sides.pairs))
    last, when = np.full((*shape, 3), np.nan), np.full(shape, -np.inf)
    kept = np.zeros(xyz.shape[:2], np.float32)
    for part in frame_blocks(xyz):
        joints = np.ascontiguousarray(xyz[part], np.float64)
        kept[part] = compare_sides(
            joints, sides.pairs, weight, swing, last, when, part.start, fps, max(deviation, _SIGMA)
        )
    # A view shows the same sides for a while, so it has one vote in that time.
    return most_likely(votes * min(1.0, 1 / (fps * _EXCHANGED_S)), kept)


def turn(evidence: Evidence, assigned: np.ndarray, turned: np.ndarray, sides: Sides) -> Evidence:
    """Return the evidence with left and right exchanged in all detections of people `turned` (F, P)."""
    if not turned.any():
        return evidence
    detections = assigned[..., sides.pairs]
    detections = np.where(detections == NONE, detections[..., ::-1], detections)
    wrong = turned[..., None, None] & (detections != NONE).all(-1)
    return _exchanged(evidence, wrong, detections, sides)


def exchanged_detections(clip: Clip, poses: Poses3D) -> tuple[np.ndarray, np.ndarray]:
    """Find the cameras that show a person of the poses with left and right exchanged.

    Args:
        clip: F frames of V cameras, of the skeleton of the poses.
        poses: As captured from the clip: the detection of a person is the one nearest to it.

    Returns:
        exchanged: (F, V) True where most cameras that show the person contradict this one.
        disagreeing: (F, V) True where a camera shows a person with exchanged sides to half of the cameras, as always
            if two show it. Which half is right is not known: a pose of two cameras can have the sides of the wrong one.
    """
    found = np.zeros((2, len(clip), len(clip.rig)), bool)
    if len(Sides.of(clip.detections.skeleton).pairs) and poses.xyz.size:
        for part in in_steps(evidence_blocks(clip, poses.xyz.shape[1])):
            found[:, part] = _exchanged_detections(clip, part, poses.xyz[part])
    return found[0], found[1]


def _exchanged_detections(clip: Clip, part: slice, xyz: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    config, sides = CaptureConfig(), Sides.of(clip.detections.skeleton)
    evidence = Evidence.of(clip, config.th_p, config, part)
    xyz, mirrored = xyz.astype(np.float64), xyz[:, :, list(clip.detections.skeleton.mirror)]
    near, other = (evidence.distances(each, DistanceUnit.metres) for each in (xyz, mirrored))
    closeness = np.nansum(np.maximum(1 - nearer_side(near, other, sides) / config.th_d, -1), -1)
    found = np.where(closeness.max(-1, initial=-np.inf) > 0, closeness.argmax(-1), NONE).swapaxes(1, 2)
    assigned = np.repeat(found[..., None], xyz.shape[2], -1)
    wrong, _ = find_exchanged(evidence, assigned, xyz, sides)
    # A pair of ears or eyes alone is weak evidence, as they are close to each other.
    exchanged, showing = wrong.sum(-1) >= 2, found != NONE
    decided = (2 * exchanged.sum(2) < showing.sum(2))[..., None]
    return (exchanged & decided).any(1), (showing & ~decided & exchanged.any(2, keepdims=True)).any(1)


@compiled()
def measure_pairs(projections, focal, xy, xyz, detection, pairs):
    """Return distances of detected pairs, m, from where they are expected, and from where their partners are.

    Args:
        projections: (V, 3, 4) pinhole projection matrices.
        focal: (V,) px.
        xy: (F, V, D, J, 2) px; NaN where absent.
        xyz: (F, P, J, 3) m; NaN where unknown.
        detection: (F, P, V, n) index of the detection of each pair; negative for none.
        pairs: (n, 2) indices of the left and the right joint.

    Returns:
        (2, F, P, V, n, 2) distances of the two joints of each pair, of both kinds; NaN where either is absent.
    """
    frames, persons, views, count = detection.shape
    distances = np.full((2, frames, persons, views, count, 2), np.nan)
    for f in range(frames):
        for p in range(persons):
            for v in range(views):
                for n in range(count):
                    d = detection[f, p, v, n]
                    if d < 0:
                        continue
                    for side in range(2):
                        x, y, depth = project(projections[v], xyz[f, p, pairs[n, side]])
                        # The positions of the left and of the right joint are each compared with both detected joints.
                        for shown in range(2):
                            dx, dy = x - xy[f, v, d, pairs[n, shown], 0], y - xy[f, v, d, pairs[n, shown], 1]
                            distance = np.sqrt(dx * dx + dy * dy) * depth / focal[v]
                            distances[int(side != shown), f, p, v, n, shown] = distance
    return distances


@compiled()
def judge_sides(distance, exchanged, pairs, groups, sigma):
    """Return (m, n) True for pairs of joints that are clearly nearer to their expected places with sides exchanged.

    The whole body is judged first, then its limbs, then each pair alone.

    Args:
        distance: (m, J) m, distances of joints from their expected places.
        exchanged: (m, J) m, distances from the expected places of their partners.
        pairs: (n, 2) indices of the left and the right joint.
        groups: (G, n) True for the pairs that are exchanged together.
        sigma: m, standard deviation of the distance of a joint from its expected place.
    """
    rows, number = len(distance), len(pairs)
    wrong = np.empty((rows, number), np.bool_)
    evidence, after, count = np.empty(number), np.empty(number), np.empty(number)
    for i in range(rows):
        for pair in range(number):
            evidence[pair], after[pair], count[pair] = 0.0, 0.0, 0.0
            for side in range(2):
                here, there = distance[i, pairs[pair, side]], exchanged[i, pairs[pair, side]]
                if not (np.isnan(here) or np.isnan(there)):
                    here, there = min(here, _FARTHEST), min(there, _FARTHEST)
                    evidence[pair] += (here * here - there * there) / (2 * sigma * sigma)
                    after[pair] += there
                    count[pair] += 1
            wrong[i, pair] = evidence[pair] > _MIN_EVIDENCE and after[pair] <= _MAX_DISTANCE * count[pair]
        for group in range(len(groups)):
            total, near, joints = 0.0, 0.0, 0.0
            for pair in range(number):
                if groups[group, pair]:
                    total += evidence[pair]
                    near += after[pair]
                    joints += count[pair]
            if total > _MIN_EVIDENCE and near <= _MAX_DISTANCE * joints:
                for pair in range(number):
                    wrong[i, pair] |= groups[group, pair]
        for pair in range(number):
            wrong[i, pair] &= evidence[pair] > -_MIN_EVIDENCE and count[pair] > 0
    return wrong


@compiled()
def compare_sides(xyz, pairs, weight, swing, last, when, start, fps, deviation):
    """Return (F, P) logarithms of the ratio of two likelihoods of tracked joints: if people have the sides that they
    had when they were seen last, and if they have the other ones. Infinite where no pair is known.

    Args:
        xyz: (F, P, J, 3) m; NaN where absent.
        pairs: (n, 2) indices of the left and the right joint.
        weight: (n,) what each pair counts.
        swing: (n,) m/s, how fast the joints of each pair move relative to each other.
        last: (P, n, 3) m, from the right joint to the left one when they were known last; changed in place.
        when: (P, n) the frame of that; changed in place.
        start: Number of the first frame.
        fps: Frames per second.
        deviation: m, standard deviation of a joint along one axis.
    """
    frames, persons = xyz.shape[:2]
    kept = np.full((frames, persons), np.inf)
    for f in range(frames):
        for p in range(persons):
            for n in range(len(pairs)):
                across = xyz[f, p, pairs[n, 0]] - xyz[f, p, pairs[n, 1]]
                if np.isnan(across).any():
                    continue
                if np.isinf(kept[f, p]):
                    kept[f, p] = _RARE
                apart_s = (start + f - when[p, n]) / fps
                if apart_s <= _TURN_S:
                    # (|a + b|^2 - |a - b|^2) / 2 = 2 a.b
                    ratio = 2 * (across * last[p, n]).sum() / (4 * deviation**2 + (swing[n] * apart_s) ** 2)
                    kept[f, p] += weight[n] * min(max(ratio, -_MOST_OF_A_PAIR), _MOST_OF_A_PAIR)
                last[p, n], when[p, n] = across, start + f
    return kept


@compiled()
def most_likely(votes, kept):
    """Return (F, P) True where the most likely sequence of sides has them exchanged.

    Args:
        votes: (F, P) as for `find_turned`.
        kept: (F, P) as `compare_sides` returns them.
    """
    frames, persons = votes.shape
    exchanged, changed = np.zeros((frames, persons), np.bool_), np.zeros((frames, 2), np.bool_)
    for p in range(persons):
        right, wrong = 0.0, 0.0
        for f in range(frames):
            changed[f, 0], changed[f, 1] = wrong - kept[f, p] > right, right - kept[f, p] > wrong
            right, wrong = max(right, wrong - kept[f, p]), max(wrong, right - kept[f, p]) + votes[f, p]
            most = max(right, wrong)
            right, wrong = right - most, wrong - most
        now = wrong > right
        for f in range(frames - 1, -1, -1):
            exchanged[f, p] = now
            now ^= changed[f, int(now)]
    return exchanged
