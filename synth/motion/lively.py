"""Kicking, punching and dancing, as in `synth.motion.actions`."""

import numpy as np

from synth.motion.act import Act, Action, held, scaled, step, through
from synth.motion.actions import Manner


def kick(manner: Manner, *, rng: np.random.Generator) -> Action:
    """Kick forward at some height, after Kellis and Katis, J. Sports Sci. Med. 6 (2007): thigh first, shin after it."""
    level, back, fold = rng.uniform((35, -26, 60), (92, -12, 85))
    high = level / 92
    lifts, backs = 0.35 / manner.pace, 0.70 / manner.pace
    hits = backs + rng.uniform(0.24, 0.34)
    folds, lands = hits + rng.uniform(0.4, 0.55) / manner.pace, hits + rng.uniform(1.0, 1.2) / manner.pace
    last, straight, side = lands + 0.2, rng.uniform(10, 20), rng.uniform(2, 10)
    lean = rng.uniform(2, 6) + 18 * high
    thigh = (
        (lifts - 0.1, 6), (backs, back), (hits - 0.05, 0.92 * level), (hits + 0.08, level + 4),
        (folds, 0.45 * level + 12), (lands, 16),
    )  # fmt: skip
    knee = (
        (lifts - 0.1, 18), (backs, 0.9 * fold), (hits - 0.14, fold), (hits + 0.02, straight),
        (hits + 0.1, straight), (folds, 62), (lands, 42),
    )  # fmt: skip

    def pose(times: np.ndarray) -> Act:
        act = Act.still(len(times))
        act.air[:, 0] = through(times, (lifts - 0.1, 0), (lifts + 0.15, 1), (lands - 0.3, 1), (lands, 0))
        act.leg[:, 0, 0], act.leg[:, 0, 2] = np.radians(through(times, *thigh)), np.radians(through(times, *knee))
        act.leg[:, 0, 1] = np.radians(side) * act.air[:, 0]
        act.leg[:, 0, 3] = np.radians(through(times, (lifts, 0), (backs, -15), (hits, -8), (folds, 0), (lands, 24)))
        act.hips[:, 2] = -through(times, (0, 0), (backs, 0.012), (lands, 0.012), (last, 0))
        swing = through(times, (0, 0), (backs, 1), (hits, -1), (folds, -0.4), (lands, 0))
        act.pelvis[:, 0] = np.radians(9) * swing
        act.pelvis[:, 1] = np.radians(through(times, (0, 0), (backs, 9), (hits, -0.7 * lean), (folds, -4), (lands, 0)))
        act.chest[:, 0] = -np.radians(12) * swing
        act.chest[:, 1] = np.radians(through(times, (0, 0), (backs, 10), (hits, -lean), (folds, 2), (last, 0)))
        act.head[:, 1] = np.radians(through(times, (0, 0), (backs, 18), (folds, 8), (last, 0)))
        # The other arm goes with the leg.
        arms = {0: ((15, 35), (-38, 45)), 1: ((-25, 45), (48, 30))}
        for number, (first, second) in arms.items():
            keys = [(0, (*first, 10, 30, 20)), (backs, (*first, 10, 30, 20)), (hits + 0.03, (*second, 10, 28, 20))]
            act.arms[:, number] = np.radians(through(times, *keys))
        act.raised[:] = through(times, (0, 0), (backs, 1), (folds, 1), (last, 0))[:, None]
        return act

    return Action("kick", last, pose)


def punch(manner: Manner, *, rng: np.random.Generator) -> Action:
    """Step into a guard, throw a few straight punches that the trunk turns after, and step back."""
    count = int(rng.integers(2, 6))
    ready, apart = 0.6 / manner.pace, rng.uniform(0.42, 0.6, count) / manner.pace
    hits = ready + 0.1 + np.cumsum(apart)
    hands = rng.integers(2, size=count)
    last = float(hits[-1]) + 0.45 + 0.6 / manner.pace
    out, crouched, bladed = rng.uniform(0.16, 0.24), rng.uniform(0.03, 0.09), rng.uniform(15, 32)
    guard = rng.uniform((38, 8, -5, 112, 20), (55, 20, 14, 128, 50))
    height = rng.uniform(75, 100, count)

    def pose(times: np.ndarray) -> Act:
        act = Act.still(len(times))
        into, rise = step(times, 0.12, 0.12 + 0.42)
        away, fall = step(times, last - 0.55, last - 0.12)
        share = held(times, 0, last, ready)
        # The left foot goes ahead, the right one's heel comes up.
        act.feet[:, 0, 0], act.feet[:, 0, 2] = (into - away) * 2 * out, rise + fall
        act.feet[:, 1, 4] = -np.radians(18) * held(times, 0.5, last - 0.5, 0.3)
        act.hips[:, 2] = -(crouched + 0.03) * share
        act.arms[:], act.raised[:] = np.radians(guard), share[:, None]
        turn = -bladed * share
        for hit, hand, level in zip(hits, hands, height, strict=True):
            blow = through(times, (hit - 0.2, 0), (hit, 1), (hit + 0.05, 1), (hit + 0.27, 0))
            straight = np.radians((level, 8, 15, 8, 80))
            act.arms[:, hand] += blow[:, None] * (straight - act.arms[:, hand])
            turn += blow * ((-14, 14 + 1.4 * bladed)[hand])
            act.chest[:, 1] += np.radians(5) * blow
        act.chest[:, 0] = np.radians(turn)
        act.chest[:, 1] += np.radians(8) * share
        act.pelvis[:, 0], act.pelvis[:, 1] = np.radians(0.6 * turn), np.radians(4) * share
        act.head[:] = np.radians(scaled(share, (-3, 10)))
        return act

    return Action(f"punch {count} times", last, pose)


def dance(manner: Manner, *, rng: np.random.Generator) -> Action:
    """Steps from side to side or swaying hips, a phrase of four beats each, at 96 to 132 beats a minute."""
    beat, phrases = 60 / rng.uniform(96, 132), int(rng.integers(2, 4))
    count, lead = 4 * phrases, 0.4
    last = 2 * lead + count * beat
    wide, bounce, sway = rng.uniform(0.18, 0.32), rng.uniform(0.01, 0.03), rng.uniform(6, 14)
    kinds = rng.choice(("sides", "sway"), phrases, p=(0.6, 0.4))
    shapes = rng.uniform((20, 15, 10, 60, 30), (75, 60, 40, 100, 50), (phrases, 5))
    high = rng.uniform(size=phrases) < 0.3
    shapes[high] = rng.uniform((130, 10, 0, 20, 0), (155, 30, 20, 50, 30), (int(high.sum()), 5))
    together, turn = rng.uniform(size=phrases) < 0.5, rng.uniform(8, 18)

    def pose(times: np.ndarray) -> Act:
        act = Act.still(len(times))
        clock = (times - lead) / beat
        share = held(times, 0, last, lead)
        act.hips[:, 2] = -share * (bounce + 0.015 + bounce * np.cos(2 * np.pi * clock))
        weights = share[:, None] * _phrases(clock, phrases)
        side = np.sin(np.pi * clock / 2)
        for phrase, (kind, shape) in enumerate(zip(kinds, shapes, strict=True)):
            weight, begin = weights[:, phrase], lead + 4 * phrase * beat
            if kind == "sides":
                _step_touch(act, times, begin, beat, wide)
            else:
                act.hips[:, 1] += weight * 0.05 * np.sin(np.pi * clock)
                act.pelvis[:, 2] += np.radians(sway) * weight * np.sin(np.pi * clock)
                act.pelvis[:, 0] += np.radians(sway) * weight * np.cos(np.pi * clock)
            for arm, sign in enumerate((1, -1)):
                beating = np.sin(np.pi * clock + (0 if together[phrase] else np.pi * arm))
                angles = shape + beating[:, None] * (14, 6, 0, 16, 0)
                act.arms[:, arm] += np.radians(angles) * weight[:, None]
                act.chest[:, 0] += 0.5 * sign * np.radians(turn) * weight * beating
        act.raised[:] = share[:, None]
        act.chest[:, 2] += np.radians(5) * share * side
        act.head[:] = np.radians(scaled(share * np.sin(np.pi * clock / 4), (16, 0)))
        act.head[:, 1] += np.radians(5) * share * np.cos(2 * np.pi * clock)
        return act

    return Action(f"dance at {60 / beat:.0f} beats/min", last, pose)


def _step_touch(act: Act, times: np.ndarray, begin: float, beat: float, wide: float) -> None:
    """Four beats: the left foot steps out, the right one to it; the right foot steps back, the left one to it."""
    for number, (foot, way) in enumerate(((0, 1), (1, 1), (1, -1), (0, -1))):
        start = begin + (number + 0.1) * beat
        gone, height = step(times, start, start + 0.75 * beat, 0.04)
        act.feet[:, foot, 1] += way * wide * gone
        act.feet[:, foot, 2] += height


def _phrases(clock: np.ndarray, count: int) -> np.ndarray:
    """(F, count) how much each phrase of four beats counts, one after the other; the sum is 1."""
    edges = np.arange(1, count) * 4
    gone = np.stack([through(clock, (edge - 0.5, 0), (edge + 0.5, 1)) for edge in edges], axis=1)
    return np.diff(np.pad(gone, ((0, 0), (1, 1)), constant_values=((0, 0), (1, 0))), axis=1) * -1
