"""What an interaction consists of: who is where when, facing what, and what hands reach for."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from synth.body import Body, segment_origins
from synth.motion import SEGMENTS, Motion
from synth.motion.limbs import PALM
from synth.motion.upper import minimum_jerk
from synth.shape import trunk_sections

_SEAT = 0.45
"""Height of `scenes/props/stool.xml`, m."""
_CLOTH = 0.012
"""How far from a seat people feel it, m."""
_STRETCH = 0.94
"""How far arms stretch at ease, as a share of their length."""


@dataclass(frozen=True)
class Cast:
    """Who takes part, and when.

    Attributes:
        bodies: Of P people.
        seconds: (F,) time of each frame, s.
        fps: Frames per second.
        radius: How far from the origin hips may stray, m.
    """

    bodies: tuple[Body, ...]
    seconds: np.ndarray
    fps: float
    radius: float


@dataclass(frozen=True)
class Role:
    """One person's part.

    Attributes:
        path: (F, 3) x, y of the hips, m, and heading, rad, about the origin.
        walks: Whether the path is a way to walk at one's own gait, which is bent along it and keeps its pace; otherwise
            the path is followed step by step.
        hips: (F,) greatest height of the hips above the floor, m, of who sits or crouches.
        ahead: How far the feet are ahead of the hips, m, of who sits.
        gaze: (F,) index of the person looked at, -1 for whatever the motion looks at.
        lean: (F,) by which the trunk is bent forward, rad.
    """

    path: np.ndarray
    walks: bool = False
    hips: np.ndarray | None = None
    ahead: float = 0.0
    gaze: np.ndarray | None = None
    lean: np.ndarray | None = None


@dataclass(frozen=True)
class Reach:
    """A hand that goes to a point.

    Attributes:
        person: Whose.
        side: `l` or `r`.
        share: (F,) of the reach against whatever the arm does else, 0 to 1.
        palm: (F, 3) where the skin of the palm is to be, m.
        normal: (F, 3) where the palm is to face.
        elbow: Where the elbow gives way to, in the chest's frame, y outward.
    """

    person: int
    side: str
    share: np.ndarray
    palm: np.ndarray
    normal: np.ndarray
    elbow: tuple[float, float, float] = (-0.35, 0.45, -1.0)


@dataclass(frozen=True)
class Poses:
    """Where people's segments are before hands reach.

    Attributes:
        origins: (F, P, 16, 3) joints of `SEGMENTS`, m.
        rotations: (F, P, 16, 3, 3) their orientations.
    """

    origins: np.ndarray
    rotations: np.ndarray

    def point(self, person: int, segment: str, at: tuple[float, float, float]) -> np.ndarray:
        """(F, 3) a point of a segment's frame, m, world."""
        index = SEGMENTS.index(segment)
        return self.origins[:, person, index] + self.rotations[:, person, index] @ np.array(at)

    def axis(self, person: int, segment: str, along: tuple[float, float, float]) -> np.ndarray:
        """(F, 3) a direction of a segment's frame in the world."""
        return self.rotations[:, person, SEGMENTS.index(segment)] @ np.array(along)


def poses_of(bodies: tuple[Body, ...], motions: list[Motion]) -> Poses:
    """Where people are whose motions these are."""
    origins = [
        segment_origins(body, motion.root, motion.rotations) for body, motion in zip(bodies, motions, strict=True)
    ]
    return Poses(np.stack(origins, axis=1), np.stack([motion.rotations for motion in motions], axis=1))


@dataclass(frozen=True)
class Furniture:
    """A thing that belongs to an interaction: kind as in `scenes/props/`, place, m, and heading, rad."""

    kind: str
    at: tuple[float, float]
    yaw: float


@dataclass(frozen=True)
class Grip:
    """Both hands of a person hold a thing from one time to another, s, so high above its middle, m."""

    person: int
    begin: float
    end: float
    height: float


@dataclass(frozen=True)
class Load:
    """A thing that hands carry: kind as in `scenes/props/`.

    Attributes:
        at, yaw: Its middle in the first frame, m, and heading, rad.
        half_width: From its middle to the palms that hold it left and right, m.
        grips: Who holds it when.
    """

    kind: str
    at: tuple[float, float, float]
    yaw: float
    half_width: float
    grips: tuple[Grip, ...]


@dataclass(frozen=True)
class Script:
    """An interaction about the origin.

    Attributes:
        roles: One a person.
        clearance: Distance that people keep between their hips whatever the scene says, m; None for the scene's.
        furniture: What it needs.
        loads: What is carried.
        paired: Whether takes in which two people were recorded together, if there are any, are played as they are.
        reaches: From where people are to what their hands do.
    """

    roles: tuple[Role, ...]
    clearance: float | None = None
    furniture: tuple[Furniture, ...] = ()
    loads: tuple[Load, ...] = ()
    paired: bool = False
    reaches: Callable[[Poses], list[Reach]] = field(default=lambda poses: [])


def standing(cast: Cast, at: np.ndarray, heading: float) -> np.ndarray:
    """(F, 3) path of who stands at a place (2,), m, facing a heading, rad."""
    return np.tile((*at, heading), (len(cast.seconds), 1))


def approach(cast: Cast, start: np.ndarray, end: np.ndarray, *, begin: float, speed: float) -> np.ndarray:
    """(F, 3) path of who stands at `start` (3,), goes straight to `end` (3,) at a mean speed, and stays there."""
    way = end[:2] - start[:2]
    length = float(np.linalg.norm(way))
    last = max(length / speed, 0.6)
    share = ease((cast.seconds - begin) / last)
    path = start + share[:, None] * (end - start)
    # On the way people face where they go, and turn at the end.
    if length > 0.3:
        going = start[2] + wrapped(np.arctan2(way[1], way[0]) - start[2])
        turned = minimum_jerk((cast.seconds - begin + 0.5) / 0.8)
        facing = minimum_jerk((cast.seconds - begin - last + 0.8) / 0.9)
        path[:, 2] = start[2] + turned * (going - start[2])
        path[:, 2] += facing * wrapped(end[2] - going)
    return path


def arrival(start: np.ndarray, end: np.ndarray, begin: float, speed: float) -> float:
    """When `approach` arrives, s."""
    return begin + max(float(np.linalg.norm(end[:2] - start[:2])) / speed, 0.6)


def ease(x: np.ndarray) -> np.ndarray:
    """From 0 to 1 at an even pace, but for the first and the last quarter in which that is taken up and given up."""
    x = np.clip(x, 0, 1)
    slow, rate = 0.25, 1 / (1 - 0.25)
    begun, ended = rate * x**2 / (2 * slow), 1 - rate * (1 - x) ** 2 / (2 * slow)
    return np.where(x < slow, begun, np.where(x > 1 - slow, ended, rate * (x - slow / 2)))


def during(seconds: np.ndarray, begin: float, end: float, move: float = 0.7) -> np.ndarray:
    """(F,) 1 from `begin` to `end`, s, 0 a `move` before and after, as hands go."""
    return minimum_jerk((seconds - begin + move) / move) - minimum_jerk((seconds - end) / move)


def wrapped(angle: np.ndarray | float) -> np.ndarray | float:
    """The same angle in -pi..pi."""
    return (angle + np.pi) % (2 * np.pi) - np.pi


def seated(body: Body) -> float:
    """Height of the hips of who sits on a stool, m."""
    return _SEAT + _CLOTH + trunk_sections(body, np.zeros(1))[0, 2]


def arm_length(body: Body) -> float:
    """From the shoulder to the palm of a straight arm, m."""
    lengths = sum(float(np.linalg.norm(body.offsets[SEGMENTS.index(f"l_{part}")])) for part in ("forearm", "hand"))
    return lengths + float(PALM[1]) * body.stature * body.arms


def thickness(body: Body) -> float:
    """Half the depth of the trunk where it is deepest, at the belly or at the chest, m."""
    return float(trunk_sections(body, np.array((0.105, 0.21)))[:, 2].max())


def within_reach(bodies: Sequence[Body], away: Sequence[float]) -> tuple[float, float]:
    """Least and greatest height of palms that all who stand upright can have so far from their shoulders, level, m.

    The least exceeds the greatest where there is no such height.
    """
    low, high = 0.0, np.inf
    for body, far in zip(bodies, away, strict=True):
        up = [body.offsets[SEGMENTS.index(segment)][2] for segment in ("spine", "chest", "l_upper_arm")]
        shoulder, span = body.hip_height + sum(up), _STRETCH * arm_length(body)
        rise = np.sqrt(max(span**2 - far**2, 0.0))
        low, high = max(low, shoulder - rise), min(high, shoulder + rise)
    return float(low), float(high)
