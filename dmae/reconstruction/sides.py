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
from dmae.reconstruction.evidence import Evidence, evidence_blocks, project

_SIGMA = 0.04  # m; standard deviation of the distance of joints from their expected places, including the noise of both
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


def nearer_side(distance: np.ndarray, exchanged: np.ndarray, sides: Sides) -> np.ndarray:
    """Return distances (..., J), replaced by those of exchanged joints where these are clearly smaller.

    Args:
        distance: (..., J) m, distances of detected joints from their expected places.
        exchanged: (..., J) m, distances from the expected places of their partners on the other side.
        sides: Sides of the skeleton.
    """
    if not len(sides.pairs):
        return distance
    chosen = distance.copy()
    rows = [each.reshape(-1, distance.shape[-1]) for each in (chosen, np.ascontiguousarray(exchanged))]
    take_sides(rows[1], sides.pairs, _is_exchanged(*rows, sides.pairs, sides.groups), rows[0])
    return chosen


def find_exchanged(
    evidence: Evidence, frames: slice, assigned: np.ndarray, expected: np.ndarray, sides: Sides
) -> tuple[np.ndarray, np.ndarray]:
    """Find the pairs of joints with left and right exchanged in a minority of views, or in half of them.

    If most views have them exchanged, the expected place is wrong.

    Args:
        evidence: Detections.
        frames: F frames of the evidence.
        assigned: (F, P, V, J) index of the detection that shows the joint in the view, or `NONE`.
        expected: (F, P, J, 3) m, expected places of the joints; NaN where unknown.
        sides: Of the skeleton.

    Returns:
        exchanged: (F, P, V, n) True where the sides of a pair are exchanged.
        detection: (F, P, V, n) index of the detection that shows the pair, or `NONE`.
    """
    pairs = sides.pairs
    left, right = (assigned[..., pairs[:, side]] for side in (0, 1))
    detection = np.where(left == NONE, right, left)
    detection = np.where((right != NONE) & (right != detection), NONE, detection)
    rig, found = evidence.rig, np.empty((2, *detection.shape, 2))
    focal = rig.focal
    expected, shown = np.ascontiguousarray(expected, np.float64), np.ascontiguousarray(detection, np.int64)
    measure_pairs(rig.projections, focal, evidence.xy[frames], expected, shown, pairs, *found)
    rows, both = found.reshape(2, prod(detection.shape[:-1]), pairs.size), np.arange(pairs.size).reshape(pairs.shape)
    wrong = _is_exchanged(*rows, both, sides.groups).reshape(detection.shape)
    observing = (assigned != NONE).any(-1).sum(2)[:, :, None, None]
    return wrong & (2 * wrong.sum(2, keepdims=True) <= observing), detection


def exchange(evidence: Evidence, first: int, wrong: np.ndarray, detection: np.ndarray, sides: Sides) -> Evidence:
    """Return the evidence with left and right exchanged, from frame `first` on, where `find_exchanged` says so."""
    if not wrong.any():
        return evidence
    frame, _, view, pair = np.nonzero(wrong)
    pairs = sides.pairs
    places = (frame + first, view, detection[wrong])
    left, right = pairs[pair, 0], pairs[pair, 1]
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
    config, sides, frames = CaptureConfig(), Sides.of(clip.detections.skeleton), slice(0, len(xyz))
    evidence = Evidence.of(clip, config.th_p, config, part)
    xyz, mirrored = xyz.astype(np.float64), xyz[:, :, list(clip.detections.skeleton.mirror)]
    near, other = (evidence.distances(frames, each, DistanceUnit.metres) for each in (xyz, mirrored))
    closeness = np.nansum(np.maximum(1 - nearer_side(near, other, sides) / config.th_d, -1), -1)
    found = np.where(closeness.max(-1, initial=-np.inf) > 0, closeness.argmax(-1), NONE).swapaxes(1, 2)
    assigned = np.repeat(found[..., None], xyz.shape[2], -1)
    wrong, _ = find_exchanged(evidence, frames, assigned, xyz, sides)
    # A pair of ears or eyes alone is weak evidence, as they are close to each other.
    return (wrong.sum(-1) >= 2).any(1)


def _is_exchanged(distance: np.ndarray, exchanged: np.ndarray, pairs: np.ndarray, groups: np.ndarray) -> np.ndarray:
    """Return (m, n) True for pairs that are clearly nearer to their expected places with sides exchanged.

    The whole body is judged first, then its limbs, then each pair alone.

    Args:
        distance, exchanged: (m, J) m.
        pairs: (n, 2) indices of the left and the right joint.
        groups: (G, n), see `Sides`.
    """
    wrong = np.empty((len(distance), len(pairs)), bool)
    judge_sides(distance, exchanged, pairs, groups, _SIGMA, _FARTHEST, _MAX_DISTANCE, _MIN_EVIDENCE, wrong)
    return wrong


@compiled()
def measure_pairs(projections, focal, xy, xyz, detection, pairs, distance, exchanged):
    """Write distances of detected pairs from where they are expected, and from where their partners are, in metres.

    Args:
        projections: (V, 3, 4) pinhole projection matrices.
        focal: (V,) px.
        xy: (F, V, D, J, 2) px; NaN where absent.
        xyz: (F, P, J, 3) m; NaN where unknown.
        detection: (F, P, V, n) index of the detection of each pair; negative for none.
        pairs: (n, 2) indices of the left and the right joint.
        distance, exchanged: (F, P, V, n, 2), written; NaN where either is absent.
    """
    frames, persons, views, count = detection.shape
    for f in range(frames):
        for p in range(persons):
            for v in range(views):
                for n in range(count):
                    d = detection[f, p, v, n]
                    for side in range(2):
                        x, y, depth = project(projections[v], xyz[f, p, pairs[n, side]])
                        # The positions of the left and of the right joint are each compared with both detected joints.
                        for shown in range(2):
                            found = np.nan
                            if d >= 0:
                                dx, dy = x - xy[f, v, d, pairs[n, shown], 0], y - xy[f, v, d, pairs[n, shown], 1]
                                found = np.sqrt(dx * dx + dy * dy) * depth / focal[v]
                            if side == shown:
                                distance[f, p, v, n, shown] = found
                            else:
                                exchanged[f, p, v, n, shown] = found


@compiled()
def judge_sides(distance, exchanged, pairs, groups, sigma, farthest, most, least, wrong):
    """Write True for pairs of joints that are clearly nearer to their expected places with sides exchanged.

    Args:
        distance: (m, J) m, distances of joints from their expected places.
        exchanged: (m, J) m, distances from the expected places of their partners.
        pairs: (n, 2) indices of the left and the right joint.
        groups: (G, n) True for the pairs that are exchanged together.
        sigma: m, standard deviation of the distances.
        farthest: m; larger distances count as this.
        most: m, largest mean distance of joints after the exchange.
        least: Smallest logarithm of the ratio of likelihoods for an exchange of sides.
        wrong: (m, n) bool, written.
    """
    rows, number = wrong.shape
    evidence, after, count = np.empty(number), np.empty(number), np.empty(number)
    for i in range(rows):
        for pair in range(number):
            evidence[pair], after[pair], count[pair] = 0.0, 0.0, 0.0
            for side in range(2):
                here, there = distance[i, pairs[pair, side]], exchanged[i, pairs[pair, side]]
                if not (np.isnan(here) or np.isnan(there)):
                    here, there = min(here, farthest), min(there, farthest)
                    evidence[pair] += (here * here - there * there) / (2 * sigma * sigma)
                    after[pair] += there
                    count[pair] += 1
            wrong[i, pair] = evidence[pair] > least and after[pair] <= most * count[pair]
        for group in range(len(groups)):
            total, near, joints = 0.0, 0.0, 0.0
            for pair in range(number):
                if groups[group, pair]:
                    total += evidence[pair]
                    near += after[pair]
                    joints += count[pair]
            if total > least and near <= most * joints:
                for pair in range(number):
                    wrong[i, pair] |= groups[group, pair]
        for pair in range(number):
            wrong[i, pair] &= evidence[pair] > -least and count[pair] > 0


@compiled()
def take_sides(exchanged, pairs, wrong, distance):
    """Replace distances (m, J) by exchanged ones (m, J) at the joints of pairs (n, 2) that are wrong, (m, n)."""
    for i in range(len(wrong)):
        for pair in range(len(pairs)):
            if wrong[i, pair]:
                for side in range(2):
                    distance[i, pairs[pair, side]] = exchanged[i, pairs[pair, side]]
