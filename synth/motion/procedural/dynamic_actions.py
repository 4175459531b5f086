"""Dynamic actions on the spot: kicking, punching and dancing. See `synth.motion.procedural.actions`."""

import numpy as np

from synth.motion.procedural.actions import Style
from synth.motion.procedural.pose_offsets import Action, PoseOffsets, keyframes, plateau, scaled, step_profile


def kick(style: Style, *, rng: np.random.Generator) -> Action:
    """Kick forward, the thigh first and the shin after it: Kellis and Katis, J. Sports Sci. Med. 6 (2007)."""
    level, back, fold = rng.uniform((35, -26, 60), (92, -12, 85))
    high = level / 92
    lifts, backs = 0.35 / style.pace, 0.70 / style.pace
    hits = backs + rng.uniform(0.24, 0.34)
    folds, lands = hits + rng.uniform(0.4, 0.55) / style.pace, hits + rng.uniform(1.0, 1.2) / style.pace
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

    def pose(times: np.ndarray) -> PoseOffsets:
        offsets = PoseOffsets.zeros(len(times))
        offsets.air[:, 0] = keyframes(times, (lifts - 0.1, 0), (lifts + 0.15, 1), (lands - 0.3, 1), (lands, 0))
        offsets.leg[:, 0, 0], offsets.leg[:, 0, 2] = (
            np.radians(keyframes(times, *thigh)),
            np.radians(keyframes(times, *knee)),
        )
        offsets.leg[:, 0, 1] = np.radians(side) * offsets.air[:, 0]
        offsets.leg[:, 0, 3] = np.radians(
            keyframes(times, (lifts, 0), (backs, -15), (hits, -8), (folds, 0), (lands, 24))
        )
        offsets.hips[:, 2] = -keyframes(times, (0, 0), (backs, 0.012), (lands, 0.012), (last, 0))
        swing = keyframes(times, (0, 0), (backs, 1), (hits, -1), (folds, -0.4), (lands, 0))
        offsets.pelvis[:, 0] = np.radians(9) * swing
        offsets.pelvis[:, 1] = np.radians(
            keyframes(times, (0, 0), (backs, 9), (hits, -0.7 * lean), (folds, -4), (lands, 0))
        )
        offsets.chest[:, 0] = -np.radians(12) * swing
        offsets.chest[:, 1] = np.radians(keyframes(times, (0, 0), (backs, 10), (hits, -lean), (folds, 2), (last, 0)))
        offsets.head[:, 1] = np.radians(keyframes(times, (0, 0), (backs, 18), (folds, 8), (last, 0)))
        # The opposite arm swings with the leg.
        arms = {0: ((15, 35), (-38, 45)), 1: ((-25, 45), (48, 30))}
        for number, (first, second) in arms.items():
            keys = [(0, (*first, 10, 30, 20)), (backs, (*first, 10, 30, 20)), (hits + 0.03, (*second, 10, 28, 20))]
            offsets.arms[:, number] = np.radians(keyframes(times, *keys))
        offsets.raised[:] = keyframes(times, (0, 0), (backs, 1), (folds, 1), (last, 0))[:, None]
        return offsets

    return Action("kick", last, pose)


def punch(style: Style, *, rng: np.random.Generator) -> Action:
    """Step into a guard, throw a few straight punches with a turn of the trunk, and step back."""
    count = int(rng.integers(2, 6))
    ready, apart = 0.6 / style.pace, rng.uniform(0.42, 0.6, count) / style.pace
    hits = ready + 0.1 + np.cumsum(apart)
    hands = rng.integers(2, size=count)
    last = float(hits[-1]) + 0.45 + 0.6 / style.pace
    out, crouched, bladed = rng.uniform(0.16, 0.24), rng.uniform(0.03, 0.09), rng.uniform(15, 32)
    guard = rng.uniform((38, 8, -5, 112, 20), (55, 20, 14, 128, 50))
    height = rng.uniform(75, 100, count)

    def pose(times: np.ndarray) -> PoseOffsets:
        offsets = PoseOffsets.zeros(len(times))
        into, rise = step_profile(times, 0.12, 0.12 + 0.42)
        away, fall = step_profile(times, last - 0.55, last - 0.12)
        share = plateau(times, 0, last, ready)
        # The left foot steps ahead, the heel of the right foot rises.
        offsets.feet[:, 0, 0], offsets.feet[:, 0, 2] = (into - away) * 2 * out, rise + fall
        offsets.feet[:, 1, 4] = -np.radians(18) * plateau(times, 0.5, last - 0.5, 0.3)
        offsets.hips[:, 2] = -(crouched + 0.03) * share
        offsets.arms[:], offsets.raised[:] = np.radians(guard), share[:, None]
        turn = -bladed * share
        for hit, hand, level in zip(hits, hands, height, strict=True):
            blow = keyframes(times, (hit - 0.2, 0), (hit, 1), (hit + 0.05, 1), (hit + 0.27, 0))
            straight = np.radians((level, 8, 15, 8, 80))
            offsets.arms[:, hand] += blow[:, None] * (straight - offsets.arms[:, hand])
            turn += blow * ((-14, 14 + 1.4 * bladed)[hand])
            offsets.chest[:, 1] += np.radians(5) * blow
        offsets.chest[:, 0] = np.radians(turn)
        offsets.chest[:, 1] += np.radians(8) * share
        offsets.pelvis[:, 0], offsets.pelvis[:, 1] = np.radians(0.6 * turn), np.radians(4) * share
        offsets.head[:] = np.radians(scaled(share, (-3, 10)))
        return offsets

    return Action(f"punch {count} times", last, pose)


def dance(style: Style, *, rng: np.random.Generator) -> Action:
    """Dance phrases of four beats, stepping from side to side or swaying the hips, at 96 to 132 beats/min."""
    beat, phrases = 60 / rng.uniform(96, 132), int(rng.integers(2, 4))
    count, lead = 4 * phrases, 0.4
    last = 2 * lead + count * beat
    wide, bounce, sway = rng.uniform(0.18, 0.32), rng.uniform(0.01, 0.03), rng.uniform(6, 14)
    kinds = rng.choice(("sides", "sway"), phrases, p=(0.6, 0.4))
    shapes = rng.uniform((20, 15, 10, 60, 30), (75, 60, 40, 100, 50), (phrases, 5))
    high = rng.uniform(size=phrases) < 0.3
    shapes[high] = rng.uniform((130, 10, 0, 20, 0), (155, 30, 20, 50, 30), (int(high.sum()), 5))
    together, turn = rng.uniform(size=phrases) < 0.5, rng.uniform(8, 18)

    def pose(times: np.ndarray) -> PoseOffsets:
        offsets = PoseOffsets.zeros(len(times))
        clock = (times - lead) / beat
        share = plateau(times, 0, last, lead)
        offsets.hips[:, 2] = -share * (bounce + 0.015 + bounce * np.cos(2 * np.pi * clock))
        weights = share[:, None] * _phrases(clock, phrases)
        side = np.sin(np.pi * clock / 2)
        for phrase, (kind, shape) in enumerate(zip(kinds, shapes, strict=True)):
            weight, begin = weights[:, phrase], lead + 4 * phrase * beat
            if kind == "sides":
                _step_touch(offsets, times, begin, beat, wide)
            else:
                offsets.hips[:, 1] += weight * 0.05 * np.sin(np.pi * clock)
                offsets.pelvis[:, 2] += np.radians(sway) * weight * np.sin(np.pi * clock)
                offsets.pelvis[:, 0] += np.radians(sway) * weight * np.cos(np.pi * clock)
            for arm, sign in enumerate((1, -1)):
                beating = np.sin(np.pi * clock + (0 if together[phrase] else np.pi * arm))
                angles = shape + beating[:, None] * (14, 6, 0, 16, 0)
                offsets.arms[:, arm] += np.radians(angles) * weight[:, None]
                offsets.chest[:, 0] += 0.5 * sign * np.radians(turn) * weight * beating
        offsets.raised[:] = share[:, None]
        offsets.chest[:, 2] += np.radians(5) * share * side
        offsets.head[:] = np.radians(scaled(share * np.sin(np.pi * clock / 4), (16, 0)))
        offsets.head[:, 1] += np.radians(5) * share * np.cos(2 * np.pi * clock)
        return offsets

    return Action(f"dance at {60 / beat:.0f} beats/min", last, pose)


def _step_touch(offsets: PoseOffsets, times: np.ndarray, begin: float, beat: float, wide: float) -> None:
    """Add four beats: the left foot steps out, the right one follows; the right foot steps back, the left follows."""
    for number, (foot, way) in enumerate(((0, 1), (1, 1), (1, -1), (0, -1))):
        start = begin + (number + 0.1) * beat
        gone, height = step_profile(times, start, start + 0.75 * beat, 0.04)
        offsets.feet[:, foot, 1] += way * wide * gone
        offsets.feet[:, foot, 2] += height


def _phrases(clock: np.ndarray, count: int) -> np.ndarray:
    """Return the weights of the phrases of four beats over time, (F, count); one after the other, with a sum of 1."""
    edges = np.arange(1, count) * 4
    gone = np.stack([keyframes(clock, (edge - 0.5, 0), (edge + 0.5, 1)) for edge in edges], axis=1)
    return np.diff(np.pad(gone, ((0, 0), (1, 1)), constant_values=((0, 0), (1, 0))), axis=1) * -1
