"""Things to do on the spot: each draws how it is done and gives back an `Action`, a function of time.

The leading limb is the left one; `mirrored` makes it the right. Angles in keys are in degrees.
"""

from dataclasses import dataclass

import numpy as np

from synth.motion.act import Act, Action, Seat, held, scaled, through
from synth.motion.legs import HIP_HEIGHT


@dataclass(frozen=True)
class Manner:
    """How somebody does things.

    Attributes:
        pace: How fast, 1 on average.
        speed: Of walking, m/s.
        width: Between the lines on which the ankles land in walking, m.
        apart: Between the ankles in standing, m.
        swing: By how much arms swing in walking, rad.
        lean: Of the trunk in walking, rad.
        seat: Height of the hips in sitting, where those of who stands are at `legs.HIP_HEIGHT`, m.
    """

    pace: float
    speed: float
    width: float
    apart: float
    swing: float
    lean: float
    seat: float


def stand(manner: Manner, *, rng: np.random.Generator) -> Action:
    """Stand, and maybe shift the weight to one leg and look around."""
    last, shift = rng.uniform(1.2, 3.0), rng.uniform(0, 0.045)
    turn, look, tilt = rng.uniform((-12, -45, 0), (12, 45, 3))

    def pose(times: np.ndarray) -> Act:
        act = Act.still(len(times))
        share = held(times, 0, last, 0.6)
        act.hips[:, 1] = share * shift
        act.pelvis[:] = np.radians(scaled(share, (0.3 * turn, 0, -tilt)))
        act.chest[:] = np.radians(scaled(share, (turn, 0, tilt)))
        act.head[:] = np.radians(scaled(held(times, 0.3, last - 0.2, 0.45), (look, 3)))
        return act

    return Action("stand", last, pose)


def reach(manner: Manner, *, rng: np.random.Generator) -> Action:
    """Reach out with one hand, the shoulder and a little of the trunk after it."""
    move, hold = rng.uniform(0.6, 1.0) / manner.pace, rng.uniform(0.2, 0.9)
    last = 2 * move + hold
    angles = rng.uniform((45, 0, -10, 5, 0), (130, 35, 30, 40, 60))
    low = np.clip((90 - angles[0]) / 45, 0, 1)
    lean, turn = rng.uniform(2, 12) + 10 * low, rng.uniform(5, 20)

    def pose(times: np.ndarray) -> Act:
        act = Act.still(len(times))
        share = held(times, 0, last, move)
        act.arms[:, 0], act.raised[:, 0] = np.radians(angles), share
        act.chest[:] = np.radians(scaled(share, (-turn, lean, 0)))
        act.pelvis[:] = np.radians(scaled(share, (-0.35 * turn, 0.4 * lean, 0)))
        act.head[:] = np.radians(scaled(share, (-0.2 * turn, (90 - angles[0]) * 0.35)))
        return act

    return Action("reach", last, pose)


def wave(manner: Manner, *, rng: np.random.Generator) -> Action:
    """Wave: the forearm stands up and swings as the upper arm turns about itself."""
    move, hold = rng.uniform(0.5, 0.8) / manner.pace, rng.uniform(1.2, 2.4)
    last, rate, width = 2 * move + hold, rng.uniform(1.4, 2.4), rng.uniform(15, 25)
    angles, look = rng.uniform((5, 65, -85, 80, -10), (30, 95, -60, 105, 20)), rng.uniform(0, 20)

    def pose(times: np.ndarray) -> Act:
        act = Act.still(len(times))
        share = held(times, 0, last, move)
        act.arms[:, 0], act.raised[:, 0] = np.radians(angles), share
        act.arms[:, 0, 2] += np.radians(width) * np.sin(2 * np.pi * rate * times)
        act.chest[:] = np.radians(scaled(share, (4, -1, -3)))
        act.head[:, 0] = np.radians(look) * share
        return act

    return Action("wave", last, pose)


def bend(manner: Manner, *, rng: np.random.Generator) -> Action:
    """Bend over as far as something on a low table or on the floor asks for, the knees nearly straight."""
    move, hold = rng.uniform(0.8, 1.2) / manner.pace, rng.uniform(0.2, 1.0)
    last, lean, turn = 2 * move + hold, rng.uniform(45, 95), rng.uniform(-15, 15)
    tilt, knees, ahead = rng.uniform(0.5, 0.65) * lean, rng.uniform(0.02, 0.09), rng.uniform(0, 25)
    one = rng.uniform() < 0.4

    def pose(times: np.ndarray) -> Act:
        act = Act.still(len(times))
        share = held(times, 0, last, move)
        act.hips[:, 2] = -knees * share
        act.pelvis[:] = np.radians(scaled(share, (0.3 * turn, tilt, 0)))
        act.chest[:] = np.radians(scaled(share, (turn, lean, 0)))
        act.head[:] = np.radians(scaled(share, (turn, 0.75 * lean)))
        # Arms hang from the leaning chest.
        act.arms[:] = np.radians((lean + ahead, 4, 10, 12, 20))
        act.raised[:] = share[:, None]
        if one:
            act.arms[:, 1] = np.radians((35, 12, 30, 75, 60))
        return act

    return Action("bend", last, pose)


def crouch(manner: Manner, *, rng: np.random.Generator) -> Action:
    """Go down on bent knees, heels off the floor, forearms on the thighs."""
    move, hold = rng.uniform(0.9, 1.2) / manner.pace, rng.uniform(0.5, 2.0)
    last, deep = 2 * move + hold, rng.uniform(0.40, 0.50)
    lean, heels, look = rng.uniform(15, 35), rng.uniform(22, 38), rng.uniform(-25, 25)

    def pose(times: np.ndarray) -> Act:
        act = Act.still(len(times))
        share = held(times, 0, last, move)
        act.hips[:, 2] = -deep * share
        act.feet[..., 4] = -np.radians(heels) * held(times, 0.35 * move, last - 0.35 * move, 0.65 * move)[:, None]
        act.feet[:, 0, 4] *= 0.75
        act.pelvis[:] = np.radians(scaled(share, (0, 0.6 * lean, 0)))
        # Going down and coming up, the trunk leans farther.
        act.chest[:] = np.radians(scaled(share, (0, lean, 0)))
        act.chest[:, 1] += np.radians(14) * 4 * share * (1 - share)
        act.head[:] = np.radians(scaled(share, (look, 0.7 * lean)))
        act.arms[:], act.raised[:] = np.radians((62, 12, 25, 55, 45)), share[:, None]
        return act

    return Action("crouch", last, pose)


def lift(manner: Manner, *, rng: np.random.Generator) -> Action:
    """Take something from the floor with both hands, between stoop and squat; then put it on a shelf, or back."""
    down, grip, up = rng.uniform(0.9, 1.2) / manner.pace, rng.uniform(0.15, 0.35), rng.uniform(0.9, 1.2) / manner.pace
    deep, lean = rng.uniform(0.20, 0.38), rng.uniform(0, 1)
    lean = 78 - 70 * (deep - 0.20) + 8 * lean
    shelf, move, hold = rng.uniform() < 0.6, rng.uniform(0.7, 1.0) / manner.pace, rng.uniform(0.2, 0.7)
    carried, wide = (rng.uniform(25, 40), 5, 25, rng.uniform(65, 85), 0), rng.uniform(2, 10)
    top = (rng.uniform(105, 150), wide, 10, rng.uniform(15, 35), 0)
    floor = (lean + rng.uniform(-12, 8), wide, 5, 10, 0)
    at = np.cumsum([0, down, grip, up, 0.15, move, hold, move])
    low = ((at[0], 0), (at[1], 1), (at[2], 1), (at[3], 0))
    keys = [(at[0], floor), (at[2], floor), (at[3], carried), (at[4], carried), (at[5], top), (at[6], top)]
    if not shelf:
        at = np.cumsum([0, down, grip, up, hold, down, grip, up])
        low = (*low, (at[4], 0), (at[5], 1), (at[6], 1), (at[7], 0))
        keys = [(at[0], floor), (at[2], floor), (at[3], carried), (at[4], carried), (at[5], floor), (at[6], floor)]
    last = float(at[-1])

    def pose(times: np.ndarray) -> Act:
        act = Act.still(len(times))
        share = through(times, *low)
        act.hips[:, 2] = -deep * share
        act.feet[..., 4] = -np.radians(40 * max(deep - 0.28, 0) / 0.1) * (share**2)[:, None]
        act.pelvis[:] = np.radians(scaled(share, (0, 0.42 * lean, 0)))
        act.chest[:] = np.radians(scaled(share, (0, lean, 0)))
        act.head[:, 1] = np.radians(0.6 * lean * share)
        act.arms[:] = np.radians(through(times, *keys))[:, None]
        act.raised[:] = through(times, (0, 0), (0.8 * down, 1), (at[6], 1), (last, 0))[:, None]
        if shelf:
            high = through(times, (at[4], 0), (at[5], 1), (at[6], 1), (at[7], 0))
            act.chest[:, 1] -= np.radians(6) * high
            act.head[:, 1] -= np.radians(18) * high
        return act

    return Action("lift to a shelf" if shelf else "lift and put down", last, pose)


def sit(manner: Manner, *, rng: np.random.Generator) -> Action:
    """Sit down on a seat behind, stay, and get up: the trunk leans forward until the feet bear the weight."""
    down, hold, up = rng.uniform((1.4, 1.5, 1.4), (1.9, 3.5, 1.9)) / (manner.pace, 1, manner.pace)
    last, back, rest = down + hold + up, rng.uniform(0.36, 0.42), rng.uniform(-6, 10)
    lean, drop = rng.uniform(34, 46), HIP_HEIGHT - manner.seat
    look, hands = rng.uniform(-30, 30), rng.uniform((18, 4, 15, 24, 40), (30, 10, 30, 40, 70))
    at = (0, 0.45 * down, down, down + hold, last - 0.55 * up, last)

    def pose(times: np.ndarray) -> Act:
        act = Act.still(len(times))
        sitting = held(times, 0, last, down, up)
        act.hips[:, 0], act.hips[:, 2] = -back * sitting, -drop * sitting
        act.held[:] = through(times, (0.15 * down, 0), (down, 1), (at[3], 1), (last - 0.15 * up, 0))
        trunk = through(times, (0, 0), (0.55 * down, lean), (down + 0.25, rest), (at[3] - 0.3, rest),
                        (at[3] + 0.35 * up, lean), (last, 0))  # fmt: skip
        act.chest[:, 1] = np.radians(trunk)
        act.pelvis[:, 1] = np.radians(0.6 * trunk - 8 * sitting)
        act.head[:] = np.radians(scaled(sitting, (look, 3)))
        act.head[:, 1] += np.radians(0.3 * trunk)
        act.arms[:], act.raised[:] = np.radians(hands), sitting[:, None]
        return act

    return Action("sit", last, pose, Seat(down, down + hold, back))
