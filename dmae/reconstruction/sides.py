"""Left and right: joints that a detector put on the other side of the body are found and corrected.

A detector may exchange sides for one frame or for seconds, with full confidence, in one view. The other views and
neighbouring frames show the correct sides.
"""

from dataclasses import dataclass, replace
from math import prod

import numpy as np

from dmae.data.clip import Clip, Poses3D
from dmae.data.skeleton import Skeleton
from dmae.files.mapped import in_steps
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

    @classmethod
    def of(cls, skeleton: Skeleton) -> "Sides":
        """Return the sides of a skeleton."""
        mirror = np.array(skeleton.mirror, int)
        names = [joint.rpartition(".")[2] for joint in skeleton.joints]
        left = np.array(skeleton.left, int)
        pairs = np.stack([left, mirror[left]], -1).reshape(-1, 2)
        kinds = [names[i].removeprefix("l_") for i in left]
        limbs = [[kind in limb for kind in kinds] for limb in _LIMBS]
        if skeleton.defined:
            tops = np.array([_top(skeleton, joint) for joint in left], int)
            limbs = [list(tops == top) for top in np.unique(tops)]
        return cls(pairs, np.array([[True] * len(pairs), *limbs], bool).reshape(1 + len(limbs), len(pairs)))


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
    pairs = sides.pairs
    left, right = (assigned[..., pairs[:, side]] for side in (0, 1))
    detection = np.where(left == NONE, right, left)
    detection = np.where((right != NONE) & (right != detection), NONE, detection)
    rig = evidence.rig
    expected, shown = np.ascontiguousarray(expected, np.float64), np.ascontiguousarray(detection, np.int64)
    found = measure_pairs(rig.projections, rig.focal, evidence.xy, expected, shown, pairs)
    rows, both = found.reshape(2, prod(detection.shape[:-1]), pairs.size), np.arange(pairs.size).reshape(pairs.shape)
    wrong = judge_sides(rows[0], rows[1], both, sides.groups, _sigma(ahead_s)).reshape(detection.shape)
    observing = (assigned != NONE).any(-1).sum(2)[:, :, None, None]
    return wrong & (2 * wrong.sum(2, keepdims=True) <= observing), detection


def correct_sides(
    evidence: Evidence, assigned: np.ndarray, expected: np.ndarray, sides: Sides, ahead_s: float = 0.0
) -> Evidence:
    """Return the evidence with left and right exchanged where `find_exchanged` says so."""
    wrong, detection = find_exchanged(evidence, assigned, expected, sides, ahead_s)
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
