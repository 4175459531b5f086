"""What people do where they stand, as functions of time, and how they keep their balance at it."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import PchipInterpolator
from scipy.ndimage import gaussian_filter1d

from synth.motion.course import SIDES, Course, over_feet
from synth.motion.gait import rolled, smoothstep
from synth.motion.legs import ANKLE, REACH, SHIN, THIGH, hips_of
from synth.motion.rotations import about

_MIDDLE = 0.045
"""Where a foot bears its weight, ahead of the ankle, m."""
_SETTLING = 0.3
"""Time in which balance takes over from standing, s."""
_EASE = 0.005
"""By how much hips are lower in standing than legs would reach, m."""


@dataclass(frozen=True)
class Stance:
    """Both feet flat on the floor.

    Attributes:
        feet: (2, 3) place of left and right ankle, m, and heading of the foot, rad.
    """

    feet: np.ndarray

    @staticmethod
    def at(x: float, y: float, heading: float, width: float, toe_out: float) -> "Stance":
        """Feet side by side, so far apart, m, turned outward by `toe_out`, rad."""
        left = width / 2 * np.array((-np.sin(heading), np.cos(heading)))
        return Stance(np.array([(x + s * left[0], y + s * left[1], heading + s * toe_out) for _, s in SIDES]))

    @property
    def middle(self) -> np.ndarray:
        """(3,) between the ankles, m, and where the body faces, rad."""
        return self.feet.mean(0)

    @property
    def width(self) -> float:
        """Between the ankles, m."""
        return float(np.linalg.norm(self.feet[0, :2] - self.feet[1, :2]))

    @property
    def toe_out(self) -> float:
        """By how much each foot turns outward, rad."""
        return float(self.feet[0, 2] - self.feet[1, 2]) / 2

    @property
    def root(self) -> np.ndarray:
        """(3,) mid point of the hips of who stands so, m."""
        hips = hips_of(np.zeros((1, 3)), np.eye(3)[None])[0]
        return np.array((*self.middle[:2], ANKLE + np.sqrt(REACH**2 - (self.width / 2 - hips[0, 1]) ** 2) - _EASE))


@dataclass(frozen=True)
class Act:
    """F frames on the spot, as differences from standing at ease; x ahead, y left, z up, m; angles in rad.

    Attributes:
        hips: (F, 3) displacement.
        pelvis, chest: (F, 3) turn to the left, lean to the front, lean to the right.
        head: (F, 2) turn to the left, nod.
        arms: (F, 2, 5) angles of left and right arm as `upper.HANGING`.
        raised: (F, 2) share of these angles against those of an arm at ease.
        feet: (F, 2, 5) displacement of the ankle, turn to the left, and pitch, toes up, by which the foot rolls.
        leg: (F, 2, 4) of a leg in the air: thigh forward and outward of the vertical, knee flexion, dorsiflexion.
        air: (F, 2) share of that against standing.
        held: (F,) share by which the hips are carried by something else, so that balance does not place them.
    """

    hips: np.ndarray
    pelvis: np.ndarray
    chest: np.ndarray
    head: np.ndarray
    arms: np.ndarray
    raised: np.ndarray
    feet: np.ndarray
    leg: np.ndarray
    air: np.ndarray
    held: np.ndarray

    @staticmethod
    def still(frames: int) -> "Act":
        """Standing at ease."""
        shapes = ((3,), (3,), (3,), (2,), (2, 5), (2,), (2, 5), (2, 4), (2,), ())
        return Act(*(np.zeros((frames, *shape)) for shape in shapes))

    def mirrored(self) -> "Act":
        """Left for right."""
        turned = np.array((-1, 1, -1))
        feet = self.feet[:, ::-1] * (1, -1, 1, -1, 1)
        return Act(
            self.hips * (1, -1, 1), self.pelvis * turned, self.chest * turned, self.head * (-1, 1),
            self.arms[:, ::-1], self.raised[:, ::-1], feet, self.leg[:, ::-1], self.air[:, ::-1], self.held,
        )  # fmt: skip


@dataclass(frozen=True)
class Seat:
    """What somebody sits on from one time to another, s, so far behind the middle of the feet, m."""

    begin: float
    end: float
    behind: float


@dataclass(frozen=True)
class Action:
    """Something to do on the spot.

    Attributes:
        name: For people to read.
        lasts: From its first key to its last, s.
        pose: From times (F,) since its first key, s, to an `Act` that begins and ends in standing at ease.
        seat: What it is done on, if anything; times since its first key.
    """

    name: str
    lasts: float
    pose: Callable[[np.ndarray], Act]
    seat: Seat | None = None

    @property
    def seconds(self) -> float:
        """How long it takes: curves through keys are rounded, and so begin a little before the first."""
        return self.lasts + 2 * _ROUND

    def act(self, times: np.ndarray) -> Act:
        """The pose at times (F,) since it begins, s."""
        return self.pose(times - _ROUND)

    def seated(self, times: np.ndarray) -> np.ndarray:
        """(F,) whether it is done sitting at times since it begins, s."""
        if self.seat is None:
            return np.zeros(len(times), bool)
        return (times - _ROUND >= self.seat.begin) & (times - _ROUND <= self.seat.end)

    def mirrored(self) -> "Action":
        """With left and right exchanged."""
        return replace(self, pose=lambda times: self.pose(times).mirrored())


_NODES, _WEIGHTS = np.polynomial.hermite.hermgauss(5)
_SOFT = 0.03
"""By how much curves through keys are rounded, s (standard deviation)."""
_ROUND = float(np.sqrt(2) * _SOFT * _NODES.max())


def through(times: np.ndarray, *keys: tuple) -> np.ndarray:
    """(F, ...) a smooth curve through keys (time, value), monotone between them, level before and after."""
    # Level ends make the curve start and end at rest.
    (first, start), (last, end) = keys[0], keys[-1]
    keys = ((first - 1, start), *keys, (last + 1, end))
    at = np.array([key[0] for key in keys], np.float64)
    values = np.array([key[1] for key in keys], np.float64)
    curve = PchipInterpolator(at, values, axis=0)
    rounded = curve(np.clip(times + np.sqrt(2) * _SOFT * _NODES[:, None], at[0], at[-1]))
    return np.tensordot(_WEIGHTS / _WEIGHTS.sum(), rounded, axes=1)


def held(times: np.ndarray, begin: float, end: float, move: float, back: float | None = None) -> np.ndarray:
    """(F,) from 0 at `begin` to 1 in the time of a move, s, and back to 0 at `end`."""
    move = min(move, (end - begin) / 2)
    back = min(back or move, (end - begin) / 2)
    return through(times, (begin, 0), (begin + move, 1), (max(end - back, begin + move + 1e-3), 1), (end, 0))


def scaled(share: np.ndarray, angles: tuple) -> np.ndarray:
    """(F, n) angles times a share (F,)."""
    return share[:, None] * np.array(angles)


def step(times: np.ndarray, begin: float, end: float, lift: float = 0.05) -> tuple[np.ndarray, np.ndarray]:
    """(F,) share of the way that a foot has gone which steps from one time to another, s, and its height, m."""
    u = np.clip((times - begin) / (end - begin), 0, 1)
    return u**3 * (10 - 15 * u + 6 * u**2), lift * 16 * u**2 * (1 - u) ** 2


def on_the_spot(action: Action, times: np.ndarray, stance: Stance, ease: np.ndarray, fps: float) -> Course:
    """What an action comes to in the world.

    Hips go where the centre of mass is over the feet that bear it, as it must be of who moves slowly.

    Args:
        action: What is done.
        times: (F,) since it began, s, `fps` of them a second.
        stance: Where it is done.
        ease: (F, 2, 5) angles of arms at ease.
        fps: Frames per second.
    """
    act = action.act(times)
    heading = stance.middle[2]
    forward, left = np.array((np.cos(heading), np.sin(heading), 0)), np.array((-np.sin(heading), np.cos(heading), 0))
    frame = np.stack([forward, left, (0, 0, 1)])
    turn, front, right = act.pelvis.T
    pelvis = about("z", heading + turn) @ about("y", front) @ about("x", right)
    yaw = stance.feet[:, 2] + act.feet[..., 3]
    pitch = act.feet[..., 4] + act.air * (act.leg[..., 0] - act.leg[..., 2] + act.leg[..., 3])
    feet = about("z", yaw) @ about("y", -pitch)
    # On the floor a foot rolls over heel or tip.
    ahead, up = rolled(pitch)
    standing = act.feet[..., :3] @ frame
    standing[..., :2] += stance.feet[:, :2] + (1 - act.air)[..., None] * ahead[..., None] * feet[..., :2, 0]
    standing[..., 2] += ANKLE
    root = stance.root + act.hips @ frame
    course = Course(
        root=root,
        pelvis=pelvis,
        ankles=_ankles(act, root, pelvis, heading, standing, up),
        feet=feet,
        knees=_knees(act, pelvis, feet, heading),
        chest=act.chest + (heading, 0, 0),
        head=act.head + (heading, 0),
        arms=ease + act.raised[..., None] * (act.arms - ease),
    )
    lifted = np.maximum(smoothstep(act.air / 0.3), smoothstep(act.feet[..., 2] / 0.02))
    bearing = gaussian_filter1d(1.001 - lifted, 0.14 * fps, axis=0, mode="nearest")
    middles = standing[..., :2] + _MIDDLE * np.stack([np.cos(yaw), np.sin(yaw)], -1)
    support = (middles * bearing[..., None]).sum(1) / bearing.sum(1, keepdims=True)
    rest = _at_rest(stance, ease)
    free = (1 - act.held) * smoothstep(times / _SETTLING) * smoothstep((action.seconds - times) / _SETTLING)
    for _ in range(3):
        # As far off as at rest is at ease.
        off = gaussian_filter1d(support - course.centre()[:, :2] - rest, 0.06 * fps, axis=0, mode="nearest")
        root = course.root.copy()
        root[:, :2] += free[:, None] * off
        course = replace(course, root=root, ankles=_ankles(act, root, pelvis, heading, standing, up))
    return course


def _ankles(act: Act, root, pelvis, heading: float, standing: np.ndarray, up: np.ndarray) -> np.ndarray:
    """(F, 2, 3) between where a foot stands and where a leg in the air has it, never below the floor."""
    hips = hips_of(root, pelvis)
    facing = heading + act.pelvis[:, 0]
    ankles = np.empty_like(standing)
    for leg, (_, sign) in enumerate(SIDES):
        thigh, outward, knee, _ = act.leg[:, leg].T
        swing = about("z", facing) @ about("x", sign * outward)
        ahead = THIGH * np.sin(thigh) + SHIN * np.sin(thigh - knee)
        down = THIGH * np.cos(thigh) + SHIN * np.cos(thigh - knee)
        hanging = (swing @ np.stack([ahead, np.zeros_like(ahead), -down], -1)[..., None])[..., 0]
        share = act.air[:, leg, None]
        ankles[:, leg] = (1 - share) * standing[:, leg] + share * (hips[:, leg] + hanging)
    # Smoothly, where they come near it.
    low = up - ankles[..., 2]
    ankles[..., 2] += np.where(low > -0.05, np.maximum(low, 0), 0)
    return ankles


def _knees(act: Act, pelvis: np.ndarray, feet: np.ndarray, heading: float) -> np.ndarray:
    """(F, 2, 3) over the feet, or of a leg in the air square to the thigh."""
    thigh, facing = act.leg[..., 0], (heading + act.pelvis[:, 0])[:, None]
    square = np.stack([np.cos(thigh) * np.cos(facing), np.cos(thigh) * np.sin(facing), np.sin(thigh)], -1)
    share = act.air[..., None]
    return (1 - share) * over_feet(pelvis, feet) + share * square


def _at_rest(stance: Stance, ease: np.ndarray) -> np.ndarray:
    """(F, 2) from the centre of mass to the middle of the feet, level, of who stands at ease, m."""
    frames, heading = len(ease), stance.middle[2]
    yaw = stance.feet[:, 2]
    pelvis, feet = about("z", np.full(frames, heading)), np.tile(about("z", yaw), (frames, 1, 1, 1))
    course = Course(
        root=np.tile(stance.root, (frames, 1)),
        pelvis=pelvis,
        ankles=np.tile(np.column_stack([stance.feet[:, :2], np.full(2, ANKLE)]), (frames, 1, 1)),
        feet=feet,
        knees=over_feet(pelvis, feet),
        chest=np.tile((heading, 0, 0), (frames, 1)),
        head=np.tile((heading, 0), (frames, 1)),
        arms=ease,
    )
    middle = (stance.feet[:, :2] + _MIDDLE * np.stack([np.cos(yaw), np.sin(yaw)], -1)).mean(0)
    return middle - course.centre()[:, :2]
