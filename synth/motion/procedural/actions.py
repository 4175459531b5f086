"""Actions on the spot as functions of time: offsets from standing at ease, given as smooth curves through keyframes."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import PchipInterpolator

from synth.motion.geometry import minimum_jerk
from synth.motion.procedural.trajectory import HIP_HEIGHT
from synth.people.hands import GESTURES


@dataclass(frozen=True)
class PoseOffsets:
    """Offsets from standing at ease, in F frames: m in the frame of the stance (x ahead, y left, z up), and rad."""

    hips: np.ndarray  # (F, 3) displacement of the mid hip
    # pelvis, chest: (F, 3) turn to the left, lean to the front, lean to the right
    pelvis: np.ndarray
    chest: np.ndarray
    head: np.ndarray  # (F, 2) turn to the left, nod
    arms: np.ndarray  # (F, 2, 5) angles of left and right arm, as `trajectory.HANGING`
    raised: np.ndarray  # (F, 2) weight of these angles, from 0, an arm at ease, to 1
    # (F, 2, 5) displacement of the ankle, turn to the left, and the pitch, toes up, by which the foot rolls
    feet: np.ndarray
    # (F, 2, 4) of a leg in the air: thigh forward and outward of the vertical, knee flexion, dorsiflexion
    leg: np.ndarray
    air: np.ndarray  # (F, 2) weight of `leg` against standing, 0 to 1
    # (F,) share of the weight that a seat carries, 0 to 1; balance does not move hips that are supported
    supported: np.ndarray

    @staticmethod
    def zeros(frames: int) -> "PoseOffsets":
        """Return the offsets of standing at ease."""
        shapes = ((3,), (3,), (3,), (2,), (2, 5), (2,), (2, 5), (2, 4), (2,), ())
        return PoseOffsets(*(np.zeros((frames, *shape)) for shape in shapes))

    def mirrored(self) -> "PoseOffsets":
        """Return the offsets with left and right exchanged."""
        turned = np.array((-1, 1, -1))
        feet = self.feet[:, ::-1] * (1, -1, 1, -1, 1)
        return PoseOffsets(
            self.hips * (1, -1, 1), self.pelvis * turned, self.chest * turned, self.head * (-1, 1),
            self.arms[:, ::-1], self.raised[:, ::-1], feet, self.leg[:, ::-1], self.air[:, ::-1], self.supported,
        )  # fmt: skip


@dataclass(frozen=True)
class Seat:
    """A seat in use: from `begin` to `end`, s, at a distance `behind` the middle of the feet, m."""

    begin: float
    end: float
    behind: float


@dataclass(frozen=True)
class Action:
    """An action on the spot."""

    name: str  # Label for reports
    lasts: float  # Time from the first key to the last, s
    # Sets `PoseOffsets`, which are zero, at times (F,) since the first key, s. They stay zero at both ends.
    pose: Callable[[np.ndarray, PoseOffsets], None]
    seat: Seat | None = None  # The seat that the action uses, if any; its times count from the first key
    # Shapes, of `synth.people.clothing.HANDS`, one of which the left and the right hand has while its arm is raised
    hands: tuple[tuple[str, ...], tuple[str, ...]] = ((), ())
    turned: bool = False  # Whether left and right are exchanged

    @property
    def seconds(self) -> float:
        """Duration, s. Curves through keys are rounded, and therefore begin a little before the first key."""
        return self.lasts + 2 * _ROUND

    def offsets(self, times: np.ndarray) -> PoseOffsets:
        """Return the pose at times (F,) since the action began, s."""
        offsets = PoseOffsets.zeros(len(times))
        self.pose(times - _ROUND, offsets)
        return offsets.mirrored() if self.turned else offsets

    def seated(self, times: np.ndarray) -> np.ndarray:
        """Return whether the body sits, (F,) bool, at times (F,) since the action began, s."""
        if self.seat is None:
            return np.zeros(len(times), bool)
        return (times - _ROUND >= self.seat.begin) & (times - _ROUND <= self.seat.end)

    def mirrored(self) -> "Action":
        """Return the action with left and right exchanged."""
        return replace(self, hands=self.hands[::-1], turned=not self.turned)


_NODES, _WEIGHTS = np.polynomial.hermite.hermgauss(5)
_SOFT = 0.03
"""Standard deviation of the Gaussian that rounds curves through keys, s."""
_ROUND = float(np.sqrt(2) * _SOFT * _NODES.max())


def keyframes(times: np.ndarray, *keys: tuple) -> np.ndarray:
    """Return a smooth curve through keys (time, value), monotone between them and constant outside them, (F, ...)."""
    # Constant ends make the curve start and end at rest.
    (first, start), (last, end) = keys[0], keys[-1]
    keys = ((first - 1, start), *keys, (last + 1, end))
    at = np.array([key[0] for key in keys], np.float64)
    values = np.array([key[1] for key in keys], np.float64)
    curve = PchipInterpolator(at, values, axis=0)
    rounded = curve(np.clip(times + np.sqrt(2) * _SOFT * _NODES[:, None], at[0], at[-1]))
    return np.tensordot(_WEIGHTS / _WEIGHTS.sum(), rounded, axes=1)


def plateau(times: np.ndarray, begin: float, end: float, move: float, back: float | None = None) -> np.ndarray:
    """Return a curve (F,) that rises from 0 at `begin` to 1 in `move`, s, and falls to 0 at `end`, in `back`."""
    move = min(move, (end - begin) / 2)
    back = min(back or move, (end - begin) / 2)
    return keyframes(times, (begin, 0), (begin + move, 1), (max(end - back, begin + move + 1e-3), 1), (end, 0))


def scaled(share: np.ndarray, angles: tuple) -> np.ndarray:
    """Return the angles (n,) times a share (F,), (F, n)."""
    return share[:, None] * np.array(angles)


def step_profile(times: np.ndarray, begin: float, end: float, lift: float = 0.05) -> tuple[np.ndarray, np.ndarray]:
    """Return the progress of a foot in a step from `begin` to `end`, s: (F,) share of the way, and (F,) height, m."""
    u = np.clip((times - begin) / (end - begin), 0, 1)
    return minimum_jerk(u), lift * 16 * u**2 * (1 - u) ** 2


# Each function draws one performance and returns it as an `Action`, a function of time. The leading limb is the left
# one; `Action.mirrored` makes it the right. Angles in keys are in degrees.


@dataclass(frozen=True)
class Style:
    """The style in which one person moves."""

    pace: float  # Pace of actions, 1 on average
    speed: float  # Walking speed, m/s
    width: float  # Distance between the lines on which left and right ankles land in walking, m
    apart: float  # Distance between the ankles in standing, m
    swing: float  # Arm swing in walking, rad
    lean: float  # Forward lean of the trunk in walking, rad
    seat: float  # Height of the hips in sitting, m; in standing it is `HIP_HEIGHT`


def stand(style: Style, *, rng: np.random.Generator) -> Action:
    """Stand, and maybe shift the weight to one leg and look around."""
    last, shift = rng.uniform(1.2, 3.0), rng.uniform(0, 0.045)
    turn, look, tilt = rng.uniform((-12, -45, 0), (12, 45, 3))

    def pose(times: np.ndarray, offsets: PoseOffsets) -> None:
        share = plateau(times, 0, last, 0.6)
        offsets.hips[:, 1] = share * shift
        offsets.pelvis[:] = np.radians(scaled(share, (0.3 * turn, 0, -tilt)))
        offsets.chest[:] = np.radians(scaled(share, (turn, 0, tilt)))
        offsets.head[:] = np.radians(scaled(plateau(times, 0.3, last - 0.2, 0.45), (look, 3)))

    return Action("stand", last, pose)


def reach(style: Style, *, rng: np.random.Generator) -> Action:
    """Reach out with one hand; the shoulder and a little of the trunk follow."""
    move, hold = rng.uniform(0.6, 1.0) / style.pace, rng.uniform(0.2, 0.9)
    last = 2 * move + hold
    angles = rng.uniform((45, 0, -10, 5, 0), (130, 35, 30, 40, 60))
    low = np.clip((90 - angles[0]) / 45, 0, 1)
    lean, turn = rng.uniform(2, 12) + 10 * low, rng.uniform(5, 20)

    def pose(times: np.ndarray, offsets: PoseOffsets) -> None:
        share = plateau(times, 0, last, move)
        offsets.arms[:, 0], offsets.raised[:, 0] = np.radians(angles), share
        offsets.chest[:] = np.radians(scaled(share, (-turn, lean, 0)))
        offsets.pelvis[:] = np.radians(scaled(share, (-0.35 * turn, 0.4 * lean, 0)))
        offsets.head[:] = np.radians(scaled(share, (-0.2 * turn, (90 - angles[0]) * 0.35)))

    return Action("reach", last, pose, hands=(GESTURES["reach"], ()))


def wave(style: Style, *, rng: np.random.Generator) -> Action:
    """Wave: the forearm is upright and swings as the upper arm turns about its length."""
    move, hold = rng.uniform(0.5, 0.8) / style.pace, rng.uniform(1.2, 2.4)
    last, rate, width = 2 * move + hold, rng.uniform(1.4, 2.4), rng.uniform(15, 25)
    angles, look = rng.uniform((5, 65, -85, 80, -10), (30, 95, -60, 105, 20)), rng.uniform(0, 20)

    def pose(times: np.ndarray, offsets: PoseOffsets) -> None:
        share = plateau(times, 0, last, move)
        offsets.arms[:, 0], offsets.raised[:, 0] = np.radians(angles), share
        offsets.arms[:, 0, 2] += np.radians(width) * np.sin(2 * np.pi * rate * times)
        offsets.chest[:] = np.radians(scaled(share, (4, -1, -3)))
        offsets.head[:, 0] = np.radians(look) * share

    return Action("wave", last, pose, hands=(GESTURES["wave"], ()))


def bend(style: Style, *, rng: np.random.Generator) -> Action:
    """Bend over towards a low table or the floor, the knees nearly straight."""
    move, hold = rng.uniform(0.8, 1.2) / style.pace, rng.uniform(0.2, 1.0)
    last, lean, turn = 2 * move + hold, rng.uniform(45, 95), rng.uniform(-15, 15)
    tilt, knees, ahead = rng.uniform(0.5, 0.65) * lean, rng.uniform(0.02, 0.09), rng.uniform(0, 25)
    one = rng.uniform() < 0.4

    def pose(times: np.ndarray, offsets: PoseOffsets) -> None:
        share = plateau(times, 0, last, move)
        offsets.hips[:, 2] = -knees * share
        offsets.pelvis[:] = np.radians(scaled(share, (0.3 * turn, tilt, 0)))
        offsets.chest[:] = np.radians(scaled(share, (turn, lean, 0)))
        offsets.head[:] = np.radians(scaled(share, (turn, 0.75 * lean)))
        # Arms hang from the leaning chest.
        offsets.arms[:] = np.radians((lean + ahead, 4, 10, 12, 20))
        offsets.raised[:] = share[:, None]
        if one:
            offsets.arms[:, 1] = np.radians((35, 12, 30, 75, 60))

    return Action("bend", last, pose, hands=(("open", "grip"), () if one else ("open",)))


def crouch(style: Style, *, rng: np.random.Generator) -> Action:
    """Crouch on bent knees, heels off the floor, forearms on the thighs."""
    move, hold = rng.uniform(0.9, 1.2) / style.pace, rng.uniform(0.5, 2.0)
    last, deep = 2 * move + hold, rng.uniform(0.40, 0.50)
    lean, heels, look = rng.uniform(15, 35), rng.uniform(22, 38), rng.uniform(-25, 25)

    def pose(times: np.ndarray, offsets: PoseOffsets) -> None:
        share = plateau(times, 0, last, move)
        offsets.hips[:, 2] = -deep * share
        offsets.feet[..., 4] = (
            -np.radians(heels) * plateau(times, 0.35 * move, last - 0.35 * move, 0.65 * move)[:, None]
        )
        offsets.feet[:, 0, 4] *= 0.75
        offsets.pelvis[:] = np.radians(scaled(share, (0, 0.6 * lean, 0)))
        # The trunk leans farther on the way down and on the way up.
        offsets.chest[:] = np.radians(scaled(share, (0, lean, 0)))
        offsets.chest[:, 1] += np.radians(14) * 4 * share * (1 - share)
        offsets.head[:] = np.radians(scaled(share, (look, 0.7 * lean)))
        offsets.arms[:], offsets.raised[:] = np.radians((62, 12, 25, 55, 45)), share[:, None]

    return Action("crouch", last, pose)


def lift(style: Style, *, rng: np.random.Generator) -> Action:
    """Take something from the floor with both hands, between stoop and squat, then put it on a shelf or back."""
    down, grip, up = rng.uniform(0.9, 1.2) / style.pace, rng.uniform(0.15, 0.35), rng.uniform(0.9, 1.2) / style.pace
    deep, lean = rng.uniform(0.20, 0.38), rng.uniform(0, 1)
    lean = 78 - 70 * (deep - 0.20) + 8 * lean
    shelf, move, hold = rng.uniform() < 0.6, rng.uniform(0.7, 1.0) / style.pace, rng.uniform(0.2, 0.7)
    carried, wide = (rng.uniform(25, 40), 5, 25, rng.uniform(65, 85), 0), rng.uniform(2, 10)
    top = (rng.uniform(105, 150), wide, 10, rng.uniform(15, 35), 0)
    floor = (lean + rng.uniform(-12, 8), wide, 5, 10, 0)
    at = np.cumsum([0, down, grip, up, 0.15, move, hold, move])
    low: tuple[tuple[float, int], ...] = ((at[0], 0), (at[1], 1), (at[2], 1), (at[3], 0))
    keys = [(at[0], floor), (at[2], floor), (at[3], carried), (at[4], carried), (at[5], top), (at[6], top)]
    if not shelf:
        at = np.cumsum([0, down, grip, up, hold, down, grip, up])
        low = (*low, (at[4], 0), (at[5], 1), (at[6], 1), (at[7], 0))
        keys = [(at[0], floor), (at[2], floor), (at[3], carried), (at[4], carried), (at[5], floor), (at[6], floor)]
    last = float(at[-1])

    def pose(times: np.ndarray, offsets: PoseOffsets) -> None:
        share = keyframes(times, *low)
        offsets.hips[:, 2] = -deep * share
        offsets.feet[..., 4] = -np.radians(40 * max(deep - 0.28, 0) / 0.1) * (share**2)[:, None]
        offsets.pelvis[:] = np.radians(scaled(share, (0, 0.42 * lean, 0)))
        offsets.chest[:] = np.radians(scaled(share, (0, lean, 0)))
        offsets.head[:, 1] = np.radians(0.6 * lean * share)
        offsets.arms[:] = np.radians(keyframes(times, *keys))[:, None]
        offsets.raised[:] = keyframes(times, (0, 0), (0.8 * down, 1), (at[6], 1), (last, 0))[:, None]
        if shelf:
            high = keyframes(times, (at[4], 0), (at[5], 1), (at[6], 1), (at[7], 0))
            offsets.chest[:, 1] -= np.radians(6) * high
            offsets.head[:, 1] -= np.radians(18) * high

    return Action("lift to a shelf" if shelf else "lift and put down", last, pose, hands=(("grip",), ("grip",)))


def sit(style: Style, *, rng: np.random.Generator) -> Action:
    """Sit down on a seat behind, stay, and get up; the trunk leans forward until the feet bear the weight."""
    down, hold, up = rng.uniform((1.4, 1.5, 1.4), (1.9, 3.5, 1.9)) / (style.pace, 1, style.pace)
    last, back, rest = down + hold + up, rng.uniform(0.36, 0.42), rng.uniform(-6, 10)
    lean, drop = rng.uniform(34, 46), HIP_HEIGHT - style.seat
    look, hands = rng.uniform(-30, 30), rng.uniform((18, 4, 15, 24, 40), (30, 10, 30, 40, 70))
    at = (0, 0.45 * down, down, down + hold, last - 0.55 * up, last)

    def pose(times: np.ndarray, offsets: PoseOffsets) -> None:
        sitting = plateau(times, 0, last, down, up)
        offsets.hips[:, 0], offsets.hips[:, 2] = -back * sitting, -drop * sitting
        offsets.supported[:] = keyframes(times, (0.15 * down, 0), (down, 1), (at[3], 1), (last - 0.15 * up, 0))
        trunk = keyframes(times, (0, 0), (0.55 * down, lean), (down + 0.25, rest), (at[3] - 0.3, rest),
                        (at[3] + 0.35 * up, lean), (last, 0))  # fmt: skip
        offsets.chest[:, 1] = np.radians(trunk)
        offsets.pelvis[:, 1] = np.radians(0.6 * trunk - 8 * sitting)
        offsets.head[:] = np.radians(scaled(sitting, (look, 3)))
        offsets.head[:, 1] += np.radians(0.3 * trunk)
        offsets.arms[:], offsets.raised[:] = np.radians(hands), sitting[:, None]

    return Action("sit", last, pose, Seat(down, down + hold, back), hands=(("relaxed", "open"),) * 2)


# Dynamic actions: kicking, punching and dancing


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

    def pose(times: np.ndarray, offsets: PoseOffsets) -> None:
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

    def pose(times: np.ndarray, offsets: PoseOffsets) -> None:
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

    return Action(f"punch {count} times", last, pose, hands=(("fist",), ("fist",)))


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

    def pose(times: np.ndarray, offsets: PoseOffsets) -> None:
        clock = (times - lead) / beat
        share = plateau(times, 0, last, lead)
        offsets.hips[:, 2] = -share * (bounce + 0.015 + bounce * np.cos(2 * np.pi * clock))
        # The weights of the phrases, one after the other, with a sum of 1.
        edges = np.arange(1, phrases) * 4
        gone = np.stack([keyframes(clock, (edge - 0.5, 0), (edge + 0.5, 1)) for edge in edges], axis=1)
        weights = np.diff(np.pad(gone, ((0, 0), (1, 1)), constant_values=((0, 0), (1, 0))), axis=1) * -1
        weights = share[:, None] * weights
        side = np.sin(np.pi * clock / 2)
        for phrase, (kind, shape) in enumerate(zip(kinds, shapes, strict=True)):
            weight, begin = weights[:, phrase], lead + 4 * phrase * beat
            if kind == "sides":
                # The left foot steps out, the right one follows; the right foot steps back, the left one follows.
                for number, (foot, way) in enumerate(((0, 1), (1, 1), (1, -1), (0, -1))):
                    start = begin + (number + 0.1) * beat
                    gone, height = step_profile(times, start, start + 0.75 * beat, 0.04)
                    offsets.feet[:, foot, 1] += way * wide * gone
                    offsets.feet[:, foot, 2] += height
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

    return Action(f"dance at {60 / beat:.0f} beats/min", last, pose)


ON_THE_SPOT = {each.__name__: each for each in (stand, reach, wave, bend, crouch, lift, sit, kick, punch, dance)}
"""The actions by name."""
