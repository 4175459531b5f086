"""Faults: common errors of calibrations and detections, and the search for the one that explains a recording best."""

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from enum import StrEnum
from fractions import Fraction
from functools import partial
from itertools import combinations

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.sparse.csgraph import breadth_first_order, minimum_spanning_tree

from dmae.calibration.epipolar import (
    CHECKED_FRAMES,
    SOUND,
    Hypothesis,
    PairScores,
    ViewSample,
    mean_agreement,
    measure_agreement,
    pairs_to_compare,
    score_pairs,
)


class Fault(StrEnum):
    """A fault of a recording; its value is the text that is printed."""

    inverse = "extrinsics are inverse"
    centre = "translation is the camera's centre"
    transposed_rotation = "rotation is transposed"
    focal = "focal lengths are swapped"
    principal = "principal point is swapped"
    mirrored = "x is mirrored"
    flipped = "y is flipped"
    upside_down = "image is upside down"
    turned_left = "image is turned left"
    turned_right = "image is turned right"
    swapped_axes = "x and y are swapped"
    scale = "detections have another resolution"
    distorted = "distortion is ignored"
    undistorted = "distortion was removed already"
    distortion_sign = "distortion has the wrong sign"
    order = "cameras are exchanged"
    delay = "cameras are not synchronised"
    moved = "camera was moved"
    turned = "camera was turned"
    displaced = "camera was moved and turned"
    focal_length = "focal length is wrong"
    lens = "distortion is wrong"
    differs = "camera differs from its calibration"
    unit = "unit of length is wrong"
    up = "another axis is up"
    tilted = "z is not vertical"
    size = "image size is transposed"
    unexplained = "calibration and detections disagree"


@dataclass(frozen=True)
class Correction:
    """A hypothesis with one fault undone."""

    fault: Fault  # The fault
    views: tuple[int, ...]  # Cameras that had it
    hypothesis: Hypothesis  # Cameras and detections without it
    amount: float = 1.0  # Its amount, for faults that have one: scale of the detections, k1


Correct = Callable[[Hypothesis, list[int]], Hypothesis]
"""A function that undoes a fault of some views."""


def binary_corrections(hypothesis: Hypothesis) -> Iterator[Correction]:
    """Undo each fault that is present or absent, of all cameras and of each one; then exchange pairs of cameras."""
    views = list(range(len(hypothesis.rig)))
    for fault, correct in (*_CORRECTIONS.items(), (Fault.mirrored, _unmirrored_image)):
        for part in [views, *([view] for view in views)]:
            corrected = correct(hypothesis, part)
            if corrected.xy is not hypothesis.xy:
                yield Correction(fault, tuple(part), corrected)
                continue
            # The correction changes nothing, for example with equal focal lengths or without distortion.
            parts = [
                (getattr(hypothesis.rig, name), getattr(corrected.rig, name))
                for name in ("K", "dist", "fisheye", "cam_from_world")
            ]
            differ = np.any([~np.isclose(x, y).reshape(len(x), -1).all(-1) for x, y in parts], 0)
            if differ.sum() > 1 or differ[part].all():
                yield Correction(fault, tuple(int(view) for view in np.flatnonzero(differ)), corrected)
    for a, b in combinations(views, 2):
        order = views.copy()
        order[a], order[b] = b, a
        exchanged = replace(
            hypothesis, xy=hypothesis.xy[:, order], score=hypothesis.score[:, order], offsets=hypothesis.offsets[order]
        )
        yield Correction(Fault.order, (a, b), exchanged)


def rescale(hypothesis: Hypothesis, views: list[int], scale: float) -> Hypothesis:
    """Divide the detections of some views by a scale."""
    xy = hypothesis.xy.copy()
    xy[:, views] /= scale
    return replace(hypothesis, xy=xy)


def change_distortion(
    hypothesis: Hypothesis, views: list[int], change: Callable[[np.ndarray], np.ndarray]
) -> Hypothesis:
    """Change the distortion (n, 5..8) of some views."""
    dist = hypothesis.rig.dist.copy()
    dist[views] = change(dist[views])
    return replace(hypothesis, rig=replace(hypothesis.rig, dist=dist))


def _extrinsics(change: Callable[[np.ndarray], np.ndarray]) -> Correct:
    """Change poses (n, 4, 4) in the convention of the files."""

    def correct(hypothesis: Hypothesis, views: list[int]) -> Hypothesis:
        written = hypothesis.convention.written_rig(hypothesis.rig)
        pose = written.cam_from_world.copy()
        pose[views] = change(pose[views])
        return replace(hypothesis, rig=hypothesis.convention.rig(replace(written, cam_from_world=pose)))

    return correct


def _translation_from_centre(pose: np.ndarray) -> np.ndarray:
    pose = pose.copy()
    pose[:, :3, 3] = -np.einsum("vij,vj->vi", pose[:, :3, :3], pose[:, :3, 3])
    return pose


def _transposed_rotation(pose: np.ndarray) -> np.ndarray:
    pose = pose.copy()
    pose[:, :3, :3] = pose[:, :3, :3].swapaxes(-1, -2)
    return pose


def _intrinsics(x: tuple[int, int], y: tuple[int, int]) -> Correct:
    """Swap two entries of K, given as row and column."""

    def correct(hypothesis: Hypothesis, views: list[int]) -> Hypothesis:
        K = hypothesis.rig.K.copy()
        K[views, *x], K[views, *y] = K[views, *y], K[views, *x]
        return replace(hypothesis, rig=replace(hypothesis.rig, K=K))

    return correct


def _pixels(change: Callable[[np.ndarray, np.ndarray, float, float], tuple]) -> Correct:
    """Change x and y of detections, given the last column and row of the image according to the calibration."""

    def correct(hypothesis: Hypothesis, views: list[int]) -> Hypothesis:
        xy = hypothesis.xy.copy()
        for view in views:
            right, bottom = hypothesis.rig.size[view] - 1
            xy[:, view] = np.stack(change(xy[:, view, ..., 0], xy[:, view, ..., 1], right, bottom), -1)
        return replace(hypothesis, xy=xy)

    return correct


def _without_distortion(hypothesis: Hypothesis, views: list[int]) -> Hypothesis:
    corrected = change_distortion(hypothesis, views, np.zeros_like)
    fisheye = corrected.rig.fisheye & ~np.isin(np.arange(len(corrected.rig)), views)
    return replace(corrected, rig=replace(corrected.rig, fisheye=fisheye))


def _unmirrored_image(hypothesis: Hypothesis, views: list[int]) -> Hypothesis:
    """Undo mirroring of the images in which people were detected: left and right joints are exchanged too."""
    corrected = _CORRECTIONS[Fault.mirrored](hypothesis, views)
    xy = corrected.xy.copy()
    score, mirror = corrected.score.copy(), list(hypothesis.skeleton.mirror)
    xy[:, views], score[:, views] = xy[:, views][..., mirror, :], score[:, views][..., mirror]
    return replace(corrected, xy=xy, score=score)


_CORRECTIONS: dict[Fault, Correct] = {
    Fault.inverse: _extrinsics(np.linalg.inv),
    Fault.centre: _extrinsics(_translation_from_centre),
    Fault.transposed_rotation: _extrinsics(_transposed_rotation),
    Fault.focal: _intrinsics((0, 0), (1, 1)),
    Fault.principal: _intrinsics((0, 2), (1, 2)),
    Fault.mirrored: _pixels(lambda x, y, right, bottom: (right - x, y)),
    Fault.flipped: _pixels(lambda x, y, right, bottom: (x, bottom - y)),
    Fault.upside_down: _pixels(lambda x, y, right, bottom: (right - x, bottom - y)),
    Fault.turned_left: _pixels(lambda x, y, right, bottom: (right - y, x)),
    Fault.turned_right: _pixels(lambda x, y, right, bottom: (y, bottom - x)),
    Fault.swapped_axes: _pixels(lambda x, y, right, bottom: (y, x)),
    Fault.undistorted: _without_distortion,
    Fault.distortion_sign: partial(change_distortion, change=np.negative),
}


MIN_OFFSET_GAIN = 0.008
"""Smallest gain in agreement that supports an offset."""
_REFINED_FRAMES = 3  # Largest expected error, in frames, of an offset found from two views
_INCONSISTENT_FRAMES = 2  # Largest difference, in frames, between the offsets of one view that two correct views find


def offset_corrections(hypothesis: Hypothesis, frames: np.ndarray, most: int) -> tuple[list[Correction], float]:
    """Synchronise cameras by the offsets of up to `most` frames, both ways, at which pairs agree best in frames (S,).

    Returns:
        corrections: One correction for each single camera that may be unsynchronised, and one of several cameras.
        sensitivity: Difference between the best and the median agreement of two views over all offsets; near 0 if no
            person moves.
    """
    views, pairs = len(hypothesis.rig), pairs_to_compare(len(hypothesis.rig))
    offsets = np.arange(-most, most + 1)
    sample, one = ViewSample.of(hypothesis, frames[::2]), np.ones(views, int)
    found = [measure_agreement(sample, pairs, ViewSample.of(hypothesis.delayed(k * one), frames[::2])) for k in offsets]
    agreement = np.array([each.total.sum(-1) / np.maximum(each.detections.sum(-1), 1) for each in found])
    sensitivity = float((agreement.max(0) - np.median(agreement, 0)).max())
    # By (view, other): agreement at each offset between the two views.
    by_offset = np.zeros((views, views, len(offsets)))
    for pair, fit in zip(pairs, agreement.T, strict=True):
        by_offset[pair[::-1]], by_offset[pair] = fit, fit[::-1]
    # In most recordings with a fault, one camera has an offset from all others.
    alone = offsets[by_offset.sum(1).argmax(-1)]
    starts = [np.where(np.arange(views) == view, alone, 0) for view in np.flatnonzero(alone)]
    # Otherwise the offsets come from the pairs with the highest agreement that connect all cameras.
    connected = np.zeros(views, int)
    tree = minimum_spanning_tree(np.where(by_offset.any(-1), 2 - by_offset.max(-1), 0))
    order, parent = breadth_first_order(tree, 0, directed=False)
    for view in order[1:]:
        connected[view] = connected[parent[view]] + offsets[by_offset[view, parent[view]].argmax()]
    corrections = {}
    for start in (*starts, connected):
        refined = refine_offsets(hypothesis, start, frames)
        wrong = tuple(int(view) for view in np.flatnonzero(refined))
        corrections[tuple(refined.tolist())] = Correction(Fault.delay, wrong, hypothesis.delayed(refined))
    return [correction for correction in corrections.values() if correction.views], sensitivity


def refine_offsets(hypothesis: Hypothesis, offsets: np.ndarray, frames: np.ndarray) -> np.ndarray:
    """Return offsets (V,) near those given at which each view agrees best with others, relative to the most common.

    A view gets 0 if the others do not find the same offset for it.
    """
    offsets, pairs = offsets.copy(), pairs_to_compare(len(offsets))
    for view in np.flatnonzero(offsets != _most_common(offsets)).tolist():
        usual = _most_common(offsets)
        tried = {usual, *range(offsets[view] - _REFINED_FRAMES, offsets[view] + _REFINED_FRAMES + 1)}
        own, one = [pair for pair in pairs if view in pair], np.arange(len(offsets)) == view
        fit = {
            k: mean_agreement(score_pairs(hypothesis.delayed(np.where(one, k, offsets)), frames, own)) for k in tried
        }
        best = max(fit, key=fit.__getitem__)
        offsets[view] = best if fit[best] >= fit[usual] + MIN_OFFSET_GAIN else usual
    offsets -= _most_common(offsets)
    for view in np.flatnonzero(offsets).tolist():
        if _inconsistency(hypothesis.delayed(offsets), view) > max(_INCONSISTENT_FRAMES, abs(offsets[view]) / 2):
            offsets[view] = 0
    return offsets


def _most_common(offsets: np.ndarray) -> int:
    return Counter(offsets.tolist()).most_common(1)[0][0]


def _inconsistency(hypothesis: Hypothesis, view: int) -> int:
    """Return the spread, in frames, of the offsets at which a view agrees best with each of the other views.

    A late camera is late for all others; one with a slightly wrong calibration seems late for some and early for
    others.
    """
    pairs = [pair for pair in pairs_to_compare(len(hypothesis.rig)) if view in pair]
    offsets = np.arange(-2 * _REFINED_FRAMES, 2 * _REFINED_FRAMES + 1)
    one = (np.arange(len(hypothesis.rig)) == view).astype(int)
    frames = hypothesis.sample_frames(CHECKED_FRAMES)
    found = [score_pairs(hypothesis.delayed(k * one), frames, pairs) for k in offsets]
    fit = np.array([[mean_agreement({pair: each[pair]}) for pair in pairs] for each in found])
    best = offsets[fit.argmax(0)[fit.max(0) >= SOUND / 2]]
    return int(np.ptp(best)) if len(best) else 0


_SCALE_STEP = 0.04
_LOG_SCALES = np.arange(-40, 41) * _SCALE_STEP  # Logarithms of the tested scales, from 1/5 to 5
_K1_STEP = 0.1
_K1 = np.arange(-6, 7) * _K1_STEP
_BLOCKS = 10  # Number of blocks of frames for the standard error of a gain
_SCREENED_FRAMES = 24  # Number of frames that are sampled to find candidates
_CHECKED_CANDIDATES = 6
_CLEAR_GAIN = 0.1  # Gain in agreement that needs no further check
_MIN_GAIN = 0.02  # Smallest gain in agreement of a correction
_MIN_GAIN_OF = {Fault.focal: 0.005, Fault.delay: MIN_OFFSET_GAIN, Fault.distorted: 0.008}
"""The same for faults that change little and do not resemble any other fault."""
_MIN_AGREEMENT_OF_AMOUNT = 0.25  # Smallest agreement after a correction with an amount
_MIN_DETECTIONS = 150  # Fewest detections that support such a correction
_SIGMAS = 3.0  # Number of standard errors by which a gain must be above 0


def find_fault(hypothesis: Hypothesis, max_offset: int) -> tuple[Correction | None, float]:
    """Find the fault with the correction that increases the agreement of the views most, or None without a clear gain.

    `max_offset` is the largest time offset, in frames and both directions, between two cameras. Also returns how much
    the agreement depends on time, as in `offset_corrections`.
    """
    pairs, frames = pairs_to_compare(len(hypothesis.rig)), hypothesis.sample_frames(_SCREENED_FRAMES)
    base = score_pairs(hypothesis, frames, pairs)
    offsets, sensitivity = offset_corrections(hypothesis, frames, max_offset)

    def gain(correction: Correction) -> float:
        return mean_agreement(base | _corrected_scores(base, correction, frames)) - mean_agreement(base)

    candidates = [(gain(each), each) for each in [*offsets, *binary_corrections(hypothesis)]]
    most, likely = max(candidates, key=lambda pair: pair[0], default=(0.0, None))
    if likely is None or most < _CLEAR_GAIN or mean_agreement(_corrected_scores(base, likely, frames)) < SOUND:
        candidates += [(gain(each), each) for each in _corrections_with_amount(hypothesis, frames, base)]
    candidates.sort(key=lambda pair: -pair[0])
    many = hypothesis.sample_frames(CHECKED_FRAMES)
    before = score_pairs(hypothesis, many, pairs)
    checked = [(_checked_gain(before, many, each), each) for _, each in candidates[:_CHECKED_CANDIDATES]]
    best, correction = max(checked, key=lambda pair: pair[0], default=(0.0, None))
    if correction is not None and best > 0 and correction.fault == Fault.delay:
        delay = refine_offsets(hypothesis, correction.hypothesis.offsets - hypothesis.offsets, many)
        views = tuple(int(view) for view in np.flatnonzero(delay))
        correction = Correction(Fault.delay, views, hypothesis.delayed(delay))
    return (correction if correction is not None and best > 0 and correction.views else None), sensitivity


def _corrected_scores(base: PairScores, correction: Correction, frames: np.ndarray) -> PairScores:
    """Score the pairs with corrected cameras."""
    return score_pairs(correction.hypothesis, frames, [pair for pair in base if set(pair) & set(correction.views)])


def _checked_gain(before: PairScores, frames: np.ndarray, correction: Correction) -> float:
    """Return the gain in the agreement of all pairs by a correction; 0 if a gain is not clear."""
    after = _corrected_scores(before, correction, frames)
    same = {pair: before[pair] for pair in after}
    gain, agreement = mean_agreement(after) - mean_agreement(same), mean_agreement(after)
    # If there is little agreement before and after, a small gain is a coincidence.
    if gain < (_MIN_GAIN_OF.get(correction.fault, _MIN_GAIN) if agreement >= SOUND else _CLEAR_GAIN):
        return 0.0
    # One of many amounts may fit a few people by coincidence.
    detected, left = (sum(each[1].sum() for each in scores.values()) for scores in (same, after))
    has_amount = correction.fault in (Fault.scale, Fault.distorted, Fault.delay)
    if has_amount and (agreement < _MIN_AGREEMENT_OF_AMOUNT or left < max(_MIN_DETECTIONS, detected / 2)):
        return 0.0
    blocks = np.array_split(np.arange(len(frames)), min(_BLOCKS, len(frames)))

    def agreement_in(block: np.ndarray, scores: PairScores) -> float:
        return mean_agreement({pair: score[:, block] for pair, score in scores.items()})

    gains = [agreement_in(block, after) - agreement_in(block, same) for block in blocks]
    error = np.std(gains, ddof=1) / np.sqrt(len(gains)) if len(gains) > 2 else np.inf
    if gain < _CLEAR_GAIN and np.mean(gains) < _SIGMAS * error:
        return 0.0
    return mean_agreement(before | after) - mean_agreement(before)


def _corrections_with_amount(hypothesis: Hypothesis, frames: np.ndarray, base: PairScores) -> Iterator[Correction]:
    """Search the best scale of detections, of all cameras or of one, and the best distortion of cameras without one."""
    views = list(range(len(hypothesis.rig)))

    def scaled(hypothesis: Hypothesis, part: list[int], log_scale: float) -> Hypothesis:
        return rescale(hypothesis, part, np.exp(log_scale))

    parts = [views, *([view] for view in views)]
    searches: list[tuple] = [(Fault.scale, scaled, part, _LOG_SCALES, _SCALE_STEP) for part in parts]
    pinholes = np.flatnonzero(~hypothesis.rig.distorted).tolist()
    if pinholes:
        searches.append((Fault.distorted, _with_lens, pinholes, _K1, _K1_STEP))
    for fault, correct, part, amounts, step in searches:
        pairs = [pair for pair in base if set(pair) & set(part)]
        if fault == Fault.scale and mean_agreement({pair: base[pair] for pair in pairs}) >= SOUND:
            continue

        def cost(amount: float, frames: np.ndarray, correct=correct, pairs=pairs, part=part) -> float:
            return -mean_agreement(score_pairs(correct(hypothesis, part, amount), frames, pairs))

        best = min(amounts, key=partial(cost, frames=frames[::3]))
        if best != 0:
            bounds = (best - step, best + step)
            best = minimize_scalar(cost, bounds=bounds, args=(frames,), method="bounded", options={"maxiter": 8}).x
            best = _rounded(best) if fault == Fault.scale else best
            amount = np.exp(best) if fault == Fault.scale else best
            yield Correction(fault, tuple(part), correct(hypothesis, part, best), float(amount))


def _rounded(log_scale: float) -> float:
    """Round to a ratio of small integers if one is near, because most images are scaled by one."""
    ratio = np.log(float(Fraction(np.exp(log_scale)).limit_denominator(4)))
    return ratio if abs(ratio - log_scale) < 0.02 else log_scale


def _with_lens(hypothesis: Hypothesis, views: list[int], k1: float) -> Hypothesis:
    return change_distortion(
        hypothesis, views, lambda dist: np.concatenate([np.full_like(dist[:, :1], k1), dist[:, 1:]], -1)
    )
