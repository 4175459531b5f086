"""Fault search: the fault that explains a recording best, with its amount if it has one."""

from collections.abc import Iterator
from fractions import Fraction

import numpy as np
from scipy.optimize import minimize_scalar

from dmae.calibration.agreement import SOUND, PairScores, mean_agreement, pairs_to_compare, score_pairs
from dmae.calibration.corrections import Correction, binary_corrections, change_distortion, rescale
from dmae.calibration.faults import Fault
from dmae.calibration.hypothesis import CHECKED_FRAMES, Hypothesis
from dmae.calibration.time_offsets import MIN_OFFSET_GAIN, offset_corrections, refine_offsets

_SCALE_STEP = 0.04
_LOG_SCALES = np.arange(-40, 41) * _SCALE_STEP
"""Logarithms of the tested scales, from 1/5 to 5."""
_K1_STEP = 0.1
_K1 = np.arange(-6, 7) * _K1_STEP
_BLOCKS = 10
"""Number of blocks of frames for the standard error of a gain."""
_SCREENED_FRAMES = 24
"""Number of frames that are sampled to find candidates."""
_CHECKED_CANDIDATES = 6
_CLEAR_GAIN = 0.1
"""Gain in agreement that needs no further check."""
_MIN_GAIN = 0.02
"""Smallest gain in agreement of a correction."""
_MIN_GAIN_OF = {Fault.focal: 0.005, Fault.delay: MIN_OFFSET_GAIN, Fault.distorted: 0.008}
"""The same for faults that change little and do not resemble any other fault."""
_MIN_AGREEMENT_OF_AMOUNT = 0.25
"""Smallest agreement after a correction with an amount."""
_MIN_DETECTIONS = 150
"""Fewest detections that support such a correction."""
_SIGMAS = 3.0
"""Number of standard errors by which a gain must be above 0."""


def find_fault(hypothesis: Hypothesis, max_offset: int) -> tuple[Correction | None, float]:
    """Find the fault with the correction that increases the agreement of the views most, if the gain is clear.

    Args:
        max_offset: Largest time offset between two cameras that is tried, in frames, in both directions.

    Returns:
        correction: The correction; None if no fault gives a clear gain.
        sensitivity: How much the agreement depends on time, see `dmae.calibration.time_offsets.offset_corrections`.
    """
    pairs, frames = pairs_to_compare(len(hypothesis.rig)), hypothesis.sample_frames(_SCREENED_FRAMES)
    base = score_pairs(hypothesis, frames, pairs)
    offsets, sensitivity = offset_corrections(hypothesis, frames, max_offset)

    def gain(correction: Correction) -> float:
        return mean_agreement(base | _corrected_scores(base, correction, frames)) - mean_agreement(base)

    candidates = [(gain(each), each) for each in [*offsets, *binary_corrections(hypothesis)]]
    most, likely = max(candidates, key=lambda pair: pair[0], default=(0.0, None))
    if most < _CLEAR_GAIN or mean_agreement(_corrected_scores(base, likely, frames)) < SOUND:
        candidates += [(gain(each), each) for each in _corrections_with_amount(hypothesis, frames, base)]
    candidates.sort(key=lambda pair: -pair[0])
    many = hypothesis.sample_frames(CHECKED_FRAMES)
    before = score_pairs(hypothesis, many, pairs)
    checked = [(_checked_gain(before, many, each), each) for _, each in candidates[:_CHECKED_CANDIDATES]]
    best, correction = max(checked, key=lambda pair: pair[0], default=(0.0, None))
    if best > 0 and correction.fault == Fault.delay:
        delay = refine_offsets(hypothesis, correction.hypothesis.offsets - hypothesis.offsets, many)
        views = tuple(int(view) for view in np.flatnonzero(delay))
        correction = Correction(Fault.delay, views, hypothesis.delayed(delay))
    return (correction if best > 0 and correction.views else None), sensitivity


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
    gains = [
        np.subtract(*(mean_agreement({p: x[:, block] for p, x in scores.items()}) for scores in (after, same)))
        for block in blocks
    ]
    error = np.std(gains, ddof=1) / np.sqrt(len(gains)) if len(gains) > 2 else np.inf
    if gain < _CLEAR_GAIN and np.mean(gains) < _SIGMAS * error:
        return 0.0
    return mean_agreement(before | after) - mean_agreement(before)


def _corrections_with_amount(hypothesis: Hypothesis, frames: np.ndarray, base: PairScores) -> Iterator[Correction]:
    """Search the best scale of detections, of all cameras or of one, and the best distortion of cameras without one."""
    views = list(range(len(hypothesis.rig)))
    searches = [(Fault.scale, _scaled, part, _LOG_SCALES, _SCALE_STEP) for part in [views, *([view] for view in views)]]
    pinholes = np.flatnonzero(~hypothesis.rig.distorted).tolist()
    if pinholes:
        searches.append((Fault.distorted, _with_lens, pinholes, _K1, _K1_STEP))
    for fault, correct, part, amounts, step in searches:
        pairs = [pair for pair in base if set(pair) & set(part)]
        if fault == Fault.scale and mean_agreement({pair: base[pair] for pair in pairs}) >= SOUND:
            continue

        def cost(amount: float, frames: np.ndarray, correct=correct, pairs=pairs, part=part) -> float:
            return -mean_agreement(score_pairs(correct(hypothesis, part, amount), frames, pairs))

        best = min(amounts, key=lambda amount, cost=cost: cost(amount, frames[::3]))
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


def _scaled(hypothesis: Hypothesis, views: list[int], log_scale: float) -> Hypothesis:
    return rescale(hypothesis, views, np.exp(log_scale))


def _with_lens(hypothesis: Hypothesis, views: list[int], k1: float) -> Hypothesis:
    return change_distortion(
        hypothesis, views, lambda dist: np.concatenate([np.full_like(dist[:, :1], k1), dist[:, 1:]], -1)
    )
