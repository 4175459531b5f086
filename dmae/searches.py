"""Which one fault explains a recording best, those among them that come in any amount: delays, scales, lenses."""

from collections import Counter
from collections.abc import Iterator
from fractions import Fraction

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.sparse.csgraph import breadth_first_order, minimum_spanning_tree

from dmae.epipolar import Reading, agree, all_pairs, frames_of, look
from dmae.faults import Fault, Mending, Scores, lens, mean_agreement, scaled, scores, simple_mendings

_SCALE_STEP = 0.04
_SCALES = np.arange(-40, 41) * _SCALE_STEP
"""Logarithms of the scales tried, a fifth to five."""
_K1_STEP = 0.1
_K1 = np.arange(-6, 7) * _K1_STEP
_LAG_ERROR = 3
"""Frames by which what two views say of time can be wrong."""
_LAG_ODDS = 2
"""Frames by which sound views differ in what they say of another's time."""
_BLOCKS = 10
_SCREENED, CHECKED = 24, 150
"""Frames looked at to find a fault, and to be sure of it."""
_SHORT_LIST = 6
SOUND = 0.3
"""Agreement of views that have nothing gross between them, people being as hidden and cut off as they are."""
_CLEAR = 0.1
"""Agreement gained that leaves no doubt."""
_GAIN = 0.02
"""Agreement that mending has to gain."""
_LEAST_GAIN = {Fault.focal: 0.005, Fault.delay: 0.008, Fault.distorted: 0.008}
"""The same of faults that can show very little, and that nothing else looks like."""
_LEAST_SEARCHED = 0.25
"""Agreement that an amount found by search has to reach."""
_LEAST_DETECTIONS = 150
"""Detections that this has to rest on."""
_SIGMAS = 3.0
"""By how many standard errors a gain has to be above nothing."""


def explain(reading: Reading, most_delay: int) -> tuple[Mending | None, float]:
    """The one fault that, once mended, makes the views agree clearly better.

    Args:
        most_delay: Frames by which two cameras are tried to be out of step, either way.

    Returns:
        mending: None where no fault does.
        telling: How much motion tells of time, see `_delay_mendings`.
    """
    pairs, frames = all_pairs(len(reading.rig)), frames_of(reading, _SCREENED)
    base = scores(reading, frames, pairs)
    late, telling = _delay_mendings(reading, frames, most_delay)

    def gain(mending: Mending) -> float:
        return mean_agreement(base | _mended(base, mending, frames)) - mean_agreement(base)

    gains = [(gain(mending), mending) for mending in [*late, *simple_mendings(reading)]]
    most, likely = max(gains, key=lambda pair: pair[0], default=(0.0, None))
    if most < _CLEAR or mean_agreement(_mended(base, likely, frames)) < SOUND:
        gains += [(gain(mending), mending) for mending in _searched(reading, frames, base)]
    gains.sort(key=lambda pair: -pair[0])
    many = frames_of(reading, CHECKED)
    before = scores(reading, many, pairs)
    sure = [(_checked(before, many, mending), mending) for _, mending in gains[:_SHORT_LIST]]
    best, mending = max(sure, key=lambda pair: pair[0], default=(0.0, None))
    if best > 0 and mending.fault == Fault.delay:
        delay = _refined(reading, mending.reading.delay - reading.delay, many)
        mending = Mending(Fault.delay, tuple(int(view) for view in np.flatnonzero(delay)), reading.put_off(delay))
    return (mending if best > 0 and mending.views else None), telling


def _mended(base: Scores, mending: Mending, frames: np.ndarray) -> Scores:
    """How the pairs agree whose cameras were mended."""
    return scores(mending.reading, frames, [pair for pair in base if set(pair) & set(mending.views)])


def _checked(before: Scores, frames: np.ndarray, mending: Mending) -> float:
    """Agreement that a mending adds to that of all pairs; 0 where it is not clear that it does."""
    after = _mended(before, mending, frames)
    same = {pair: before[pair] for pair in after}
    gain, agreement = mean_agreement(after) - mean_agreement(same), mean_agreement(after)
    # Where hardly anything agrees before and after, chance gains a little.
    if gain < (_LEAST_GAIN.get(mending.fault, _GAIN) if agreement >= SOUND else _CLEAR):
        return 0.0
    # Among many amounts one may fit a few people by chance.
    seen, left = (sum(each[1].sum() for each in found.values()) for found in (same, after))
    searched = mending.fault in (Fault.scale, Fault.distorted, Fault.delay)
    if searched and (agreement < _LEAST_SEARCHED or left < max(_LEAST_DETECTIONS, seen / 2)):
        return 0.0
    blocks = np.array_split(np.arange(len(frames)), min(_BLOCKS, len(frames)))
    gains = [
        np.subtract(*(mean_agreement({p: x[:, block] for p, x in s.items()}) for s in (after, same)))
        for block in blocks
    ]
    if gain < _CLEAR and (len(gains) < 3 or np.mean(gains) < _SIGMAS * np.std(gains, ddof=1) / np.sqrt(len(gains))):
        return 0.0
    return mean_agreement(before | after) - mean_agreement(before)


def _delay_mendings(reading: Reading, frames: np.ndarray, most: int) -> tuple[list[Mending], float]:
    """Cameras put in step, by the frames between any two at which people fit best.

    Returns:
        mendings: Of cameras that may each be out of step alone, and of several together.
        telling: By how much, at the best, agreement between two views is above that at other times; near 0
            where nobody moves.
    """
    views, pairs = len(reading.rig), all_pairs(len(reading.rig))
    lags = np.arange(-most, most + 1)
    sight, one = look(reading, frames[::2]), np.ones(views, int)
    found = [agree(sight, pairs, look(reading.put_off(k * one), frames[::2])) for k in lags]
    agreement = np.array([each.total.sum(-1) / np.maximum(each.detections.sum(-1), 1) for each in found])
    telling = float((agreement.max(0) - np.median(agreement, 0)).max())
    # By (view, other): agreement at every lag of the view behind the other.
    by_lag = np.zeros((views, views, len(lags)))
    for pair, fit in zip(pairs, agreement.T, strict=True):
        by_lag[pair[::-1]], by_lag[pair] = fit, fit[::-1]
    # Mostly one camera is late for all others.
    alone = lags[by_lag.sum(1).argmax(-1)]
    starts = [np.where(np.arange(views) == view, alone, 0) for view in np.flatnonzero(alone)]
    # Otherwise the surest pairs that join all cameras tell.
    joined = np.zeros(views, int)
    tree = minimum_spanning_tree(np.where(by_lag.any(-1), 2 - by_lag.max(-1), 0))
    order, parent = breadth_first_order(tree, 0, directed=False)
    for view in order[1:]:
        joined[view] = joined[parent[view]] + lags[by_lag[view, parent[view]].argmax()]
    mendings = {}
    for late in (*starts, joined):
        late = _refined(reading, late, frames)
        wrong = tuple(int(view) for view in np.flatnonzero(late))
        mendings[tuple(late.tolist())] = Mending(Fault.delay, wrong, reading.put_off(late))
    return [mending for mending in mendings.values() if mending.views], telling


def _refined(reading: Reading, late: np.ndarray, frames: np.ndarray) -> np.ndarray:
    """Delays (V,) near those given at which each view fits the others best; 0 for most, and for those at odds."""
    late, pairs = late.copy(), all_pairs(len(late))
    for view in np.flatnonzero(late != Counter(late.tolist()).most_common(1)[0][0]):
        usual = Counter(late.tolist()).most_common(1)[0][0]
        tried = {usual, *range(late[view] - _LAG_ERROR, late[view] + _LAG_ERROR + 1)}
        some, one = [pair for pair in pairs if view in pair], np.arange(len(late)) == view
        fit = {k: mean_agreement(scores(reading.put_off(np.where(one, k, late)), frames, some)) for k in tried}
        best = max(fit, key=fit.get)
        late[view] = best if fit[best] >= fit[usual] + _LEAST_GAIN[Fault.delay] else usual
    late -= Counter(late.tolist()).most_common(1)[0][0]
    for view in np.flatnonzero(late):
        if _at_odds(reading.put_off(late), view) > max(_LAG_ODDS, abs(late[view]) / 2):
            late[view] = 0
    return late


def _at_odds(reading: Reading, view: int) -> int:
    """Frames by which the other views differ in when one fits them best.

    One that is late is so for all. One whose calibration is somewhat off looks late to some and early to others.
    """
    pairs = [pair for pair in all_pairs(len(reading.rig)) if view in pair]
    late = np.arange(-2 * _LAG_ERROR, 2 * _LAG_ERROR + 1)
    one = (np.arange(len(reading.rig)) == view).astype(int)
    frames = frames_of(reading, CHECKED)
    found = [scores(reading.put_off(k * one), frames, pairs) for k in late]
    fit = np.array([[mean_agreement({pair: each[pair]}) for pair in pairs] for each in found])
    best = late[fit.argmax(0)[fit.max(0) >= SOUND / 2]]
    return int(np.ptp(best)) if len(best) else 0


def _searched(reading: Reading, frames: np.ndarray, base: Scores) -> Iterator[Mending]:
    """Scales of the detections, of all cameras or of one, and a lens of those said to have none, at their best."""
    views = list(range(len(reading.rig)))
    searches = [(Fault.scale, _rescaled, some, _SCALES, _SCALE_STEP) for some in [views, *([view] for view in views)]]
    pinholes = np.flatnonzero(~reading.rig.distorted).tolist()
    if pinholes:
        searches.append((Fault.distorted, _with_lens, pinholes, _K1, _K1_STEP))
    for fault, make, some, amounts, step in searches:
        pairs = [pair for pair in base if set(pair) & set(some)]
        if fault == Fault.scale and mean_agreement({pair: base[pair] for pair in pairs}) >= SOUND:
            continue

        def cost(amount: float, frames: np.ndarray, make=make, pairs=pairs, some=some) -> float:
            return -mean_agreement(scores(make(reading, some, amount), frames, pairs))

        best = min(amounts, key=lambda amount, cost=cost: cost(amount, frames[::3]))
        if best != 0:
            within = (best - step, best + step)
            best = minimize_scalar(cost, bounds=within, args=(frames,), method="bounded", options={"maxiter": 8}).x
            best = _rounded(best) if fault == Fault.scale else best
            amount = np.exp(best) if fault == Fault.scale else best
            yield Mending(fault, tuple(some), make(reading, some, best), float(amount))


def _rounded(logarithm: float) -> float:
    """Images are mostly scaled by ratios of small numbers."""
    ratio = np.log(float(Fraction(np.exp(logarithm)).limit_denominator(4)))
    return ratio if abs(ratio - logarithm) < 0.02 else logarithm


def _rescaled(reading: Reading, views: list[int], logarithm: float) -> Reading:
    return scaled(reading, views, np.exp(logarithm))


def _with_lens(reading: Reading, views: list[int], k1: float) -> Reading:
    return lens(reading, views, lambda dist: np.concatenate([np.full_like(dist[:, :1], k1), dist[:, 1:]], -1))
