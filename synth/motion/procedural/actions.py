"""Actions on the spot: each function draws one performance and returns it as an `Action`, a function of time.

The leading limb is the left one; `Action.mirrored` makes it the right. Angles in keys are in degrees.
"""

from dataclasses import dataclass

import numpy as np

from synth.motion.procedural.legs import HIP_HEIGHT
from synth.motion.procedural.pose_offsets import Action, PoseOffsets, Seat, keyframes, plateau, scaled


@dataclass(frozen=True)
class Style:
    """The style in which one person moves.

    Attributes:
        pace: Pace of actions, 1 on average.
        speed: Walking speed, m/s.
        width: Distance between the lines on which left and right ankles land in walking, m.
        apart: Distance between the ankles in standing, m.
        swing: Arm swing in walking, rad.
        lean: Forward lean of the trunk in walking, rad.
        seat: Height of the hips in sitting, m; in standing it is `legs.HIP_HEIGHT`.
    """

    pace: float
    speed: float
    width: float
    apart: float
    swing: float
    lean: float
    seat: float


def stand(style: Style, *, rng: np.random.Generator) -> Action:
    """Stand, and maybe shift the weight to one leg and look around."""
    last, shift = rng.uniform(1.2, 3.0), rng.uniform(0, 0.045)
    turn, look, tilt = rng.uniform((-12, -45, 0), (12, 45, 3))

    def pose(times: np.ndarray) -> PoseOffsets:
        offsets = PoseOffsets.zeros(len(times))
        share = plateau(times, 0, last, 0.6)
        offsets.hips[:, 1] = share * shift
        offsets.pelvis[:] = np.radians(scaled(share, (0.3 * turn, 0, -tilt)))
        offsets.chest[:] = np.radians(scaled(share, (turn, 0, tilt)))
        offsets.head[:] = np.radians(scaled(plateau(times, 0.3, last - 0.2, 0.45), (look, 3)))
        return offsets

    return Action("stand", last, pose)


def reach(style: Style, *, rng: np.random.Generator) -> Action:
    """Reach out with one hand; the shoulder and a little of the trunk follow."""
    move, hold = rng.uniform(0.6, 1.0) / style.pace, rng.uniform(0.2, 0.9)
    last = 2 * move + hold
    angles = rng.uniform((45, 0, -10, 5, 0), (130, 35, 30, 40, 60))
    low = np.clip((90 - angles[0]) / 45, 0, 1)
    lean, turn = rng.uniform(2, 12) + 10 * low, rng.uniform(5, 20)

    def pose(times: np.ndarray) -> PoseOffsets:
        offsets = PoseOffsets.zeros(len(times))
        share = plateau(times, 0, last, move)
        offsets.arms[:, 0], offsets.raised[:, 0] = np.radians(angles), share
        offsets.chest[:] = np.radians(scaled(share, (-turn, lean, 0)))
        offsets.pelvis[:] = np.radians(scaled(share, (-0.35 * turn, 0.4 * lean, 0)))
        offsets.head[:] = np.radians(scaled(share, (-0.2 * turn, (90 - angles[0]) * 0.35)))
        return offsets

    return Action("reach", last, pose)


def wave(style: Style, *, rng: np.random.Generator) -> Action:
    """Wave: the forearm is upright and swings as the upper arm turns about its length."""
    move, hold = rng.uniform(0.5, 0.8) / style.pace, rng.uniform(1.2, 2.4)
    last, rate, width = 2 * move + hold, rng.uniform(1.4, 2.4), rng.uniform(15, 25)
    angles, look = rng.uniform((5, 65, -85, 80, -10), (30, 95, -60, 105, 20)), rng.uniform(0, 20)

    def pose(times: np.ndarray) -> PoseOffsets:
        offsets = PoseOffsets.zeros(len(times))
        share = plateau(times, 0, last, move)
        offsets.arms[:, 0], offsets.raised[:, 0] = np.radians(angles), share
        offsets.arms[:, 0, 2] += np.radians(width) * np.sin(2 * np.pi * rate * times)
        offsets.chest[:] = np.radians(scaled(share, (4, -1, -3)))
        offsets.head[:, 0] = np.radians(look) * share
        return offsets

    return Action("wave", last, pose)


def bend(style: Style, *, rng: np.random.Generator) -> Action:
    """Bend over towards a low table or the floor, the knees nearly straight."""
    move, hold = rng.uniform(0.8, 1.2) / style.pace, rng.uniform(0.2, 1.0)
    last, lean, turn = 2 * move + hold, rng.uniform(45, 95), rng.uniform(-15, 15)
    tilt, knees, ahead = rng.uniform(0.5, 0.65) * lean, rng.uniform(0.02, 0.09), rng.uniform(0, 25)
    one = rng.uniform() < 0.4

    def pose(times: np.ndarray) -> PoseOffsets:
        offsets = PoseOffsets.zeros(len(times))
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
        return offsets

    return Action("bend", last, pose)


def crouch(style: Style, *, rng: np.random.Generator) -> Action:
    """Crouch on bent knees, heels off the floor, forearms on the thighs."""
    move, hold = rng.uniform(0.9, 1.2) / style.pace, rng.uniform(0.5, 2.0)
    last, deep = 2 * move + hold, rng.uniform(0.40, 0.50)
    lean, heels, look = rng.uniform(15, 35), rng.uniform(22, 38), rng.uniform(-25, 25)

    def pose(times: np.ndarray) -> PoseOffsets:
        offsets = PoseOffsets.zeros(len(times))
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
        return offsets

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
    low = ((at[0], 0), (at[1], 1), (at[2], 1), (at[3], 0))
    keys = [(at[0], floor), (at[2], floor), (at[3], carried), (at[4], carried), (at[5], top), (at[6], top)]
    if not shelf:
        at = np.cumsum([0, down, grip, up, hold, down, grip, up])
        low = (*low, (at[4], 0), (at[5], 1), (at[6], 1), (at[7], 0))
        keys = [(at[0], floor), (at[2], floor), (at[3], carried), (at[4], carried), (at[5], floor), (at[6], floor)]
    last = float(at[-1])

    def pose(times: np.ndarray) -> PoseOffsets:
        offsets = PoseOffsets.zeros(len(times))
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
        return offsets

    return Action("lift to a shelf" if shelf else "lift and put down", last, pose)


def sit(style: Style, *, rng: np.random.Generator) -> Action:
    """Sit down on a seat behind, stay, and get up; the trunk leans forward until the feet bear the weight."""
    down, hold, up = rng.uniform((1.4, 1.5, 1.4), (1.9, 3.5, 1.9)) / (style.pace, 1, style.pace)
    last, back, rest = down + hold + up, rng.uniform(0.36, 0.42), rng.uniform(-6, 10)
    lean, drop = rng.uniform(34, 46), HIP_HEIGHT - style.seat
    look, hands = rng.uniform(-30, 30), rng.uniform((18, 4, 15, 24, 40), (30, 10, 30, 40, 70))
    at = (0, 0.45 * down, down, down + hold, last - 0.55 * up, last)

    def pose(times: np.ndarray) -> PoseOffsets:
        offsets = PoseOffsets.zeros(len(times))
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
        return offsets

    return Action("sit", last, pose, Seat(down, down + hold, back))
