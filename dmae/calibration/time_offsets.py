"""Time offsets: the cameras that are not synchronised with the others, and their offsets in frames."""

from collections import Counter

import numpy as np
from scipy.sparse.csgraph import breadth_first_order, minimum_spanning_tree

from dmae.calibration.agreement import SOUND, mean_agreement, measure_agreement, pairs_to_compare, score_pairs
from dmae.calibration.corrections import Correction
from dmae.calibration.epipolar import ViewSample
from dmae.calibration.faults import Fault
from dmae.calibration.hypothesis import CHECKED_FRAMES, Hypothesis

MIN_OFFSET_GAIN = 0.008
"""Smallest gain in agreement that supports an offset."""
_REFINED_FRAMES = 3
"""Largest expected error, in frames, of an offset found from two views."""
_INCONSISTENT_FRAMES = 2
"""Largest difference, in frames, between the offsets of one view that two correct views find."""


def offset_corrections(hypothesis: Hypothesis, frames: np.ndarray, most: int) -> tuple[list[Correction], float]:
    """Synchronise cameras by the offsets at which pairs of them agree best.

    Args:
        frames: (S,) sampled frames.
        most: Largest offset that is tried, in frames, in both directions.

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
    """Return offsets (V,) near those given at which each view agrees best with the others.

    They are relative to the most common offset. A view gets 0 if the others do not find the same offset for it.
    """
    offsets, pairs = offsets.copy(), pairs_to_compare(len(offsets))
    for view in np.flatnonzero(offsets != _most_common(offsets)):
        usual = _most_common(offsets)
        tried = {usual, *range(offsets[view] - _REFINED_FRAMES, offsets[view] + _REFINED_FRAMES + 1)}
        own, one = [pair for pair in pairs if view in pair], np.arange(len(offsets)) == view
        fit = {
            k: mean_agreement(score_pairs(hypothesis.delayed(np.where(one, k, offsets)), frames, own)) for k in tried
        }
        best = max(fit, key=fit.get)
        offsets[view] = best if fit[best] >= fit[usual] + MIN_OFFSET_GAIN else usual
    offsets -= _most_common(offsets)
    for view in np.flatnonzero(offsets):
        if _inconsistency(hypothesis.delayed(offsets), view) > max(_INCONSISTENT_FRAMES, abs(offsets[view]) / 2):
            offsets[view] = 0
    return offsets


def _most_common(offsets: np.ndarray) -> int:
    return Counter(offsets.tolist()).most_common(1)[0][0]


def _inconsistency(hypothesis: Hypothesis, view: int) -> int:
    """Return the spread, in frames, of the offsets at which a view agrees best with each of the other views.

    A camera with a time offset has it relative to all others. A camera with a slightly wrong calibration seems to be
    late for some of them and early for others.
    """
    pairs = [pair for pair in pairs_to_compare(len(hypothesis.rig)) if view in pair]
    offsets = np.arange(-2 * _REFINED_FRAMES, 2 * _REFINED_FRAMES + 1)
    one = (np.arange(len(hypothesis.rig)) == view).astype(int)
    frames = hypothesis.sample_frames(CHECKED_FRAMES)
    found = [score_pairs(hypothesis.delayed(k * one), frames, pairs) for k in offsets]
    fit = np.array([[mean_agreement({pair: each[pair]}) for pair in pairs] for each in found])
    best = offsets[fit.argmax(0)[fit.max(0) >= SOUND / 2]]
    return int(np.ptp(best)) if len(best) else 0
