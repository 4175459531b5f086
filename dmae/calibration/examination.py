"""Examination: the camera that differs from its calibration, the kind of difference, and the limits of detection.

A difference is judged by the improvement of the fit in frames on which it was not fitted.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from scipy.stats import t as student_t
from scipy.stats import ttest_1samp

from dmae.calibration.bundle_adjustment import (
    CENTRE,
    FOCAL,
    K1,
    OFFSET,
    ROTATION,
    Adjusted,
    Calibration,
    Freedom,
    ImageTracks,
    Observations,
    Q,
    adjust,
)
from dmae.progress import progress

BODIES = 200
"""Largest number of bodies that are compared."""
_BLOCK_S, _MOST_BLOCKS, _FEWEST_BLOCKS = 0.4, 16, 4
"""s and numbers of the stretches of time that are compared. Errors of detectors last some tenths of a second."""
SHORTEST_S = _FEWEST_BLOCKS * _BLOCK_S
"""s; duration below which nothing is examined."""
_CHANCE = 0.001  # Largest probability that a gain is a coincidence (one-sided t test over the stretches of time)
_CHANCE_OF_KIND = 0.01  # The same for distinguishing two kinds of one camera
_REFERENCE = 4.0  # Smallest ratio of the gain to the gain that the other cameras would have from this kind of change
_NEAR = 0.04
"""Largest difference between the gains of two kinds, as a share of the gain, at which they are not distinguished."""
_RIVAL = 0.7  # Largest gain that a change of another camera may have, as a share of the gain
_SURE = 0.1
"""Share of the cost that a reliably detected difference saves. In some stretches of time its effect is small."""
_MUCH, _CHANCE_OF_MUCH = 0.25, 0.01
"""Share of the cost, and probability of a coincidence, from which a difference that is not certain raises suspicion."""
_EXAMINED = 2  # Number of cameras that are examined for every kind
_OFFSETS = (0, *(sign * frames for frames in (2, 4, 7, 10, 14, 18) for sign in (-1, 1)))
"""Frames at which the search of a time offset starts. Larger offsets are found earlier, without tracks."""
_MOST_OFFSET = 20  # Frames; a search that ends at more is of no camera that sees people
_HALF_WAY = 0.1  # Frames from the middle between two, within which a search of a time offset may have stopped there


class Kind(StrEnum):
    """A way in which one camera differs from its calibration."""

    moved = "camera moved"
    turned = "camera turned"
    focal = "focal length differs"
    lens = "distortion differs"
    late = "camera is not synchronised"
    displaced = "camera moved and turned"


PARAMETERS = {
    Kind.moved: tuple(range(*CENTRE.indices(Q))),
    Kind.turned: tuple(range(*ROTATION.indices(Q))),
    Kind.focal: (FOCAL,),
    Kind.lens: (K1,),
    Kind.late: (OFFSET,),
    Kind.displaced: (*range(*ROTATION.indices(Q)), *range(*CENTRE.indices(Q))),
}
"""The parameters of each kind."""


@dataclass(frozen=True)
class CameraDifference:
    """A tested difference of one camera."""

    view: int  # The camera
    kind: Kind  # What differs
    step: np.ndarray  # (Q,) from the calibration to the camera, see `Calibration.changed`
    gain: float  # Cost per body that it saves in frames on which it was not fitted
    cost: np.ndarray  # (B,) cost per body in each stretch of time, in frames on which it was not fitted
    before: np.ndarray  # (B,) the same without the difference

    @property
    def chance(self) -> float:
        """Probability that a false difference saves at least the same cost."""
        return _chance(self.before, self.cost)

    def beats(self, other: CameraDifference, chance: float = _CHANCE) -> bool:
        """Return whether this difference clearly explains more than another one."""
        return _chance(other.cost, self.cost) < chance


_NO_COST = 1e-12  # Costs of exact detections are 0


def _chance(worse: np.ndarray, better: np.ndarray) -> float:
    """Return the probability of a decrease of costs (B,) by coincidence."""
    ratio = np.log(np.maximum(worse, _NO_COST) / np.maximum(better, _NO_COST))
    if len(ratio) < _FEWEST_BLOCKS or not ratio.any():
        return 1.0
    return float(ttest_1samp(ratio, 0, alternative="greater").pvalue)


@dataclass(frozen=True)
class Examination:
    """The result of an examination."""

    # Differences of the named camera that fit equally well, the best first; empty if no camera is named
    kinds: tuple[CameraDifference, ...]
    # One of these cameras seems to differ, and the recording does not show which, or not for certain; empty otherwise
    suspects: tuple[int, ...]
    tried: tuple[CameraDifference, ...]  # All differences that were tried
    base: Adjusted  # The fit of the unchanged calibration
    # By kind, (V,) smallest amount that would be named: m, rad, relative, k1, s; inf if no amount would be
    limits: dict[Kind, np.ndarray]


def examine(tracks: ImageTracks, calibration: Calibration) -> Examination | None:
    """Examine each camera against the others. Return None if too few people are seen by several cameras."""
    observations = Observations.of(tracks, BODIES)
    blocks = _blocks(observations)
    if blocks.max(initial=0) + 1 < _FEWEST_BLOCKS:
        return None
    views = len(calibration.rig)
    base = adjust(observations, calibration)
    xyz = _start(observations, base)
    gains = []
    for view in progress(range(views), "comparing cameras"):
        fits = (_fit(observations, calibration, xyz, view, kind) for kind in (Kind.displaced, Kind.late))
        gains.append(base.cost.sum() - min(fit.cost.sum() for fit in fits))
    likely = sorted(range(views), key=lambda view: -gains[view])[:_EXAMINED]
    differences = [(view, kind) for view in likely for kind in Kind]
    tried = [
        _tried(observations, calibration, base, blocks, view, kind)
        for view, kind in progress(differences, "examining cameras")
    ]
    best = max(tried, key=lambda each: each.gain)
    without = calibration.with_step(best.view, best.step)
    everything = Freedom.of(views, rotation=True, centre=True, focal=True, k1=True, offset=True)
    corrected = adjust(observations, without, everything, iterations=0, xyz=_refit(observations, without, xyz).xyz)
    reference = {kind: _reference(corrected, kind, (best.view,)) for kind in Kind}
    least = {kind: _least_gain(tried, kind, best.view, reference[kind]) for kind in Kind}
    limits = {kind: _limits(corrected, kind, least[kind]) for kind in Kind}
    limits[Kind.late] = _measured_limits(observations, corrected, limits[Kind.late], least[Kind.late])
    named, suspects = _judge(tried, reference, views)
    rivals = [each for each in tried if each.view != best.view]
    rival = max(rivals, key=lambda each: each.gain)
    # Two faults hide each other: neither camera is clear while the other one is off.
    if views > 3 and max(best.chance, rival.chance) < _CHANCE_OF_MUCH:
        besides = _besides(observations, calibration, xyz, blocks, (best, rival))
        named, suspects = (besides, ()) if besides else (named, suspects)
    return Examination(named, suspects, tuple(tried), base, limits)


def _fit(observations: Observations, calibration: Calibration, xyz: np.ndarray, view: int, kind: Kind) -> Adjusted:
    """Fit a difference of one camera, from bodies (M, J, 3)."""
    free = np.zeros((len(calibration.rig), Q), bool)
    free[view, list(PARAMETERS[kind])] = True
    freedom = Freedom(free, np.full(free.shape, np.inf))

    def fitted(calibration: Calibration) -> Adjusted:
        return adjust(observations, calibration, freedom, iterations=10, xyz=xyz, tolerance=1e-4)

    if kind != Kind.late:
        return fitted(calibration)
    # Start at the offset at which the detections of the camera are nearest to the bodies.
    frame = (np.arange(Q) == OFFSET) / observations.tracks.fps
    tried = [calibration.with_step(view, frames * frame) for frames in _OFFSETS]
    fits = [fitted(min(tried, key=lambda each: adjust(observations, each, iterations=0, xyz=xyz).cost.sum()))]
    # Lines in the image are fitted around whole frames, so a search stops half way between two: go on from both sides.
    if abs(fits[0].calibration.offset[view] * observations.tracks.fps % 1 - 0.5) < _HALF_WAY:
        fits += [fitted(fits[0].calibration.with_step(view, half * frame)) for half in (-0.5, 0.5)]
    # A camera that is so late that it sees nobody costs nothing.
    fits = [each for each in fits if abs(each.calibration.offset[view]) * observations.tracks.fps <= _MOST_OFFSET]
    return min(fits, key=lambda each: each.cost.sum()) if fits else _refit(observations, calibration, xyz)


def _refit(observations: Observations, calibration: Calibration, xyz: np.ndarray) -> Adjusted:
    """Fit the bodies to cameras that stay, from bodies (M, J, 3)."""
    return adjust(observations, calibration, iterations=10, xyz=xyz, tolerance=1e-4)


def _tried(
    observations: Observations, calibration: Calibration, base: Adjusted, block: np.ndarray, view: int, kind: Kind
) -> CameraDifference:
    """Fit a difference on every other block and measure its gain on the rest; then exchange the two halves."""
    cost, steps, xyz = np.zeros(len(observations)), [], _start(observations, base)
    for half in (0, 1):
        train, test = np.flatnonzero(block % 2 == half), np.flatnonzero(block % 2 != half)
        fitted = _fit(observations.at(train), calibration, xyz[train], view, kind).calibration
        cost[test] = _refit(observations.at(test), fitted, xyz[test]).cost
        steps.append(calibration.difference(fitted)[view])
    by_block = (np.array([each[block == k].mean() for k in range(block.max() + 1)]) for each in (cost, base.cost))
    return CameraDifference(view, kind, np.mean(steps, 0), float((base.cost - cost).mean()), *by_block)


def _blocks(observations: Observations) -> np.ndarray:
    """Return the index (M,) of the stretch of time of each body; empty stretches are not counted."""
    seconds = (observations.frame - observations.frame.min(initial=0)) / observations.tracks.fps
    duration = seconds.max(initial=0)
    count = int(np.clip(duration / _BLOCK_S, 1, _MOST_BLOCKS))
    block = np.minimum((seconds / max(duration, 1e-9) * count).astype(int), count - 1)
    return np.unique(block, return_inverse=True)[1]


def _linear(state: Adjusted, view: int, kind: Kind) -> tuple[np.ndarray, np.ndarray]:
    found = state.reduced
    index = np.searchsorted(state.problem.free, [view * Q + parameter for parameter in PARAMETERS[kind]])
    return found.information[np.ix_(index, index)], found.gradient[index]


def _reference(state: Adjusted, kind: Kind, without: tuple[int, ...]) -> float:
    """Return the cost per body that a change of the other cameras would save, to first order."""
    saved = []
    for view in set(range(len(state.calibration.rig))) - set(without):
        S, g = _linear(state, view, kind)
        saved.append(g @ np.linalg.lstsq(S, g, rcond=1e-9)[0] / len(state.cost))
    return float(np.max(saved))


def _least_gain(tried: list[CameraDifference], kind: Kind, without: int, reference: float) -> float:
    """Return the cost per body that a difference must save to be named."""
    gains = [each.before - each.cost for each in tried if each.kind == kind and each.view != without]
    noise = max((np.std(gain, ddof=1) / np.sqrt(len(gain)) for gain in gains), default=0.0)
    significant = student_t.isf(_CHANCE, len(tried[0].cost) - 1) * noise
    return max(_REFERENCE * reference, significant, _SURE * tried[0].before.mean())


def _limits(state: Adjusted, kind: Kind, least: float) -> np.ndarray:
    """Return the amount (V,) of a difference that would save a given cost per body, in its weakest direction."""
    views = range(len(state.calibration.rig))
    weakest = [np.linalg.eigvalsh(_linear(state, view, kind)[0] / len(state.cost))[0] for view in views]
    return np.array([np.sqrt(least / each) if each > 0 else np.inf for each in weakest])


def _measured_limits(observations: Observations, state: Adjusted, expected: np.ndarray, least: float) -> np.ndarray:
    """Return the time offsets (V,), s, that cost `least`, given offsets (V,) expected to cost it.

    Expected costs count the noise of velocities as motion, although people that stand still hardly move.
    """
    limits, xyz = np.full(len(expected), np.inf), _start(observations, state)
    for view in np.flatnonzero(np.isfinite(expected)).tolist():
        step = np.where(np.arange(Q) == OFFSET, expected[view], 0)
        late = (state.calibration.with_step(view, sign * step) for sign in (-1, 1))
        costs = [adjust(observations, each, iterations=5, xyz=xyz, tolerance=1e-4).cost for each in late]
        more = float((np.mean(costs, 0) - state.cost).mean())
        if more > 0:
            limits[view] = expected[view] * max(1.0, np.sqrt(least / more))
    return limits


def _start(observations: Observations, state: Adjusted) -> np.ndarray:
    """Return the joints (M, J, 3), m, of an adjustment, or of the tracks where the adjustment has none."""
    return np.where(np.isfinite(state.xyz), state.xyz, observations.start)


def _judge(
    tried: list[CameraDifference], reference: dict[Kind, float], views: int
) -> tuple[tuple[CameraDifference, ...], tuple[int, ...]]:
    """Return the kinds that explain the recording. If there are none, return the cameras that may differ instead."""
    clear = [each for each in tried if each.chance < _CHANCE and each.gain > _REFERENCE * reference[each.kind]]
    if not clear:
        much = [each for each in tried if each.chance < _CHANCE_OF_MUCH and each.gain > _MUCH * each.before.mean()]
        most = max((each.gain for each in much), default=0.0)
        return (), tuple(dict.fromkeys(each.view for each in much if each.gain > _RIVAL * most))
    best = max(clear, key=lambda each: each.gain)
    rival = max((each for each in tried if each.view != best.view), key=lambda each: each.gain)
    if views < 3 or not best.beats(rival) or rival.gain > _RIVAL * best.gain:
        return (), (best.view, rival.view)
    return _alike(best, tried, reference), ()


def _alike(
    best: CameraDifference, tried: list[CameraDifference], reference: dict[Kind, float]
) -> tuple[CameraDifference, ...]:
    """Return the kinds of a camera that fit about as well as its best one."""
    # Correct calibrations also have small errors. Two kinds are distinguished only by larger differences.
    least = max(_NEAR * best.gain, _REFERENCE * max(reference.values()))
    near = [
        each
        for each in tried
        if each.view == best.view and (each.gain > best.gain - least or not best.beats(each, _CHANCE_OF_KIND))
    ]
    near.sort(key=lambda each: -each.gain)
    simple = [each for each in near if each.kind != Kind.displaced]
    return tuple(simple or near)


def _besides(
    observations: Observations,
    calibration: Calibration,
    xyz: np.ndarray,
    blocks: np.ndarray,
    alone: tuple[CameraDifference, CameraDifference],
) -> tuple[CameraDifference, ...]:
    """Return the kinds of the camera of two that certainly differs besides the other, the worse of both; or nothing.

    If one fault can be explained by either camera, undoing one explanation leaves the other nothing to save. A camera
    with a fault of its own saves nearly as much with the other one undone as `alone`.
    """
    both = calibration
    for each in alone:
        both = both.with_step(each.view, each.step)
    everything = Freedom.of(len(calibration.rig), rotation=True, centre=True, focal=True, k1=True, offset=True)
    state = adjust(observations, both, everything, iterations=0, xyz=_refit(observations, both, xyz).xyz)
    reference = {kind: _reference(state, kind, (alone[0].view, alone[1].view)) for kind in Kind}
    found: list[tuple[CameraDifference, ...]] = []
    for each, other in (alone, alone[::-1]):
        without = calibration.with_step(other.view, other.step)
        base = _refit(observations, without, xyz)
        again = [_tried(observations, without, base, blocks, each.view, kind) for kind in Kind]
        best = max(again, key=lambda one: one.gain)
        certain = best.chance < _CHANCE and best.gain > _REFERENCE * reference[best.kind]
        if certain and best.gain > _RIVAL * each.gain:
            found.append(_alike(best, again, reference))
    return max(found, key=lambda kinds: kinds[0].gain, default=())
