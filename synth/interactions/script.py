"""What interactions are made of: roles, reaches and loads, paths on the floor, and measures of bodies."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from synth.motion.geometry import PALM, forwards, leftwards, minimum_jerk
from synth.motion.motion import Motion
from synth.people.body import SEGMENTS, Body, segment_origins, sitting_depth, trunk_sections
from synth.rooms.props import PlacedProp, prop_size

STOOL = "stool"
"""The prop that people sit on."""


@dataclass(frozen=True)
class Cast:
    """The people who take part, and the frames of the clip."""

    bodies: tuple[Body, ...]  # One for each of P people
    seconds: np.ndarray  # (F,) time of each frame, s
    fps: float  # Frames per second
    radius: float  # Greatest distance of hips from the origin, m


@dataclass(frozen=True)
class Role:
    """The part of one person."""

    path: np.ndarray  # (F, 3) x, y of the hips, m, and heading, rad, around the origin
    # Whether a walk from the motion source is bent along the path at its own pace; otherwise the legs follow the path
    # step by step
    walks: bool = False
    hips: np.ndarray | None = None  # (F,) greatest height of the hips above the floor in sitting or crouching, m
    ahead: float = 0.0  # Distance of the feet ahead of the hips in sitting, m
    gaze: np.ndarray | None = None  # (F,) index of the person looked at; -1 leaves the head to the motion
    lean: np.ndarray | None = None  # (F,) angle by which the trunk is bent forward, rad
    # Shapes of the left and the right hand, of `synth.people.clothing.HANDS`, in physics, and of hands that keep still;
    # None draws them
    hands: tuple[str, str] | None = None


@dataclass(frozen=True)
class Reach:
    """A hand that goes to a point."""

    person: int  # Index of the person
    side: str  # `l` or `r`
    share: np.ndarray  # (F,) weight of the reach, 0 to 1; the rest is the arm's own motion
    palm: np.ndarray  # (F, 3) target of the skin of the palm, m
    normal: np.ndarray  # (F, 3) direction that the palm faces at the target
    elbow: tuple[float, float, float] = (-0.35, 0.45, -1.0)  # Direction of the elbow in the chest's frame, y outward
    # Whether the wrist stays straight; otherwise it bends so that the palm lies on the touched surface
    straight: bool = False
    # Shapes, of `synth.people.clothing.HANDS`, one of which the hand takes; before a "grip" or a "clasp" it opens
    hand: tuple[str, ...] = ("open",)


@dataclass(frozen=True)
class Poses:
    """The people's segments before the hands reach."""

    origins: np.ndarray  # (F, P, 16, 3) joints of `SEGMENTS`, m
    rotations: np.ndarray  # (F, P, 16, 3, 3) their orientations

    def point(self, person: int, segment: str, at: tuple[float, float, float]) -> np.ndarray:
        """Return the (F, 3) world position of a point `at` of a segment's frame, m."""
        index = SEGMENTS.index(segment)
        return self.origins[:, person, index] + self.rotations[:, person, index] @ np.array(at)

    def axis(self, person: int, segment: str, along: tuple[float, float, float]) -> np.ndarray:
        """Return the (F, 3) world direction of the direction `along` of a segment's frame."""
        return self.rotations[:, person, SEGMENTS.index(segment)] @ np.array(along)


def poses_of(bodies: tuple[Body, ...], motions: list[Motion]) -> Poses:
    """Return the poses of P bodies in their motions."""
    origins = [
        segment_origins(body, motion.root, motion.rotations) for body, motion in zip(bodies, motions, strict=True)
    ]
    return Poses(np.stack(origins, axis=1), np.stack([motion.rotations for motion in motions], axis=1))


@dataclass(frozen=True)
class Grip:
    """A grip: both hands of a person hold an object from `begin` to `end`, s, at `height` above its middle, m."""

    person: int
    begin: float
    end: float
    height: float


@dataclass(frozen=True)
class Load:
    """An object that hands carry: kind as in `scenes/props/`."""

    kind: str
    # at, yaw: Its middle in the first frame, m, and heading, rad
    at: tuple[float, float, float]
    yaw: float
    half_width: float  # Distance from its middle to the palms that hold it left and right, m
    grips: tuple[Grip, ...]  # When each person holds it


@dataclass(frozen=True)
class Script:
    """An interaction around the origin."""

    roles: tuple[Role, ...]  # One for each person
    # Greatest distance that people keep between their hips, m; None for the clearance of the scene
    clearance: float | None = None
    furniture: tuple[PlacedProp, ...] = ()  # The props that it needs
    loads: tuple[Load, ...] = ()  # The objects that are carried
    paired: bool = False  # Whether recordings of two people together, if there are any, are played unchanged
    # Function from the people's poses to the reaches of their hands
    reaches: Callable[[Poses], list[Reach]] = field(default=lambda poses: [])


def check_script(script: Script, cast: Cast, name: str) -> None:
    """Raise ValueError, which begins with the name of the interaction, if there is not one role for each person, or if
    an array of a role is not one row for each frame.
    """
    if len(script.roles) != len(cast.bodies):
        raise ValueError(
            f"interaction={name}: expected a role for each of {len(cast.bodies)} people, found {len(script.roles)}"
        )
    frames = len(cast.seconds)
    wanted = {"path": (frames, 3), "hips": (frames,), "gaze": (frames,), "lean": (frames,)}
    for number, role in enumerate(script.roles):
        for key, shape in wanted.items():
            value = getattr(role, key)
            if value is not None and np.shape(value) != shape:
                raise ValueError(
                    f"interaction={name}: roles[{number}].{key}: expected {shape}, one row for each frame, found "
                    f"{np.shape(value)}"
                )


# Paths on the floor, and time curves


def standing(cast: Cast, at: np.ndarray, heading: float) -> np.ndarray:
    """Return the (F, 3) path of a person who stands at a point (2,), m, with a heading, rad."""
    return np.tile((*at, heading), (len(cast.seconds), 1))


def approach(cast: Cast, start: np.ndarray, end: np.ndarray, *, begin: float, speed: float) -> np.ndarray:
    """Return the straight (F, 3) path from `start` (3,) to `end` (3,) that begins at `begin`, s; mean speed in m/s."""
    way = end[:2] - start[:2]
    length, last = float(np.linalg.norm(way)), _lasting(start, end, speed)
    share = ease((cast.seconds - begin) / last)
    path = start + share[:, None] * (end - start)
    # People face the direction in which they walk, and turn at the end.
    if length > 0.3:
        going = start[2] + wrapped(np.arctan2(way[1], way[0]) - start[2])
        turned = minimum_jerk((cast.seconds - begin + 0.5) / 0.8)
        facing = minimum_jerk((cast.seconds - begin - last + 0.8) / 0.9)
        path[:, 2] = start[2] + turned * (going - start[2])
        path[:, 2] += facing * wrapped(end[2] - going)
    return path


def arrival(start: np.ndarray, end: np.ndarray, begin: float, speed: float) -> float:
    """Return the time at which `approach` arrives, s."""
    return begin + _lasting(start, end, speed)


def _lasting(start: np.ndarray, end: np.ndarray, speed: float) -> float:
    """Return the duration of `approach`, s. In a clip of one frame people walk no distance, at no speed."""
    length = float(np.linalg.norm(end[:2] - start[:2]))
    return max(length / speed, 0.6) if length else 0.6


def ease(x: np.ndarray) -> np.ndarray:
    """Return a curve from 0 to 1: constant acceleration, constant rate from 1/4 to 3/4 of x, constant deceleration."""
    x = np.clip(x, 0, 1)
    slow, rate = 0.25, 1 / (1 - 0.25)
    begun, ended = rate * x**2 / (2 * slow), 1 - rate * (1 - x) ** 2 / (2 * slow)
    return np.where(x < slow, begun, np.where(x > 1 - slow, ended, rate * (x - slow / 2)))


def during(seconds: np.ndarray, begin: float, end: float, move: float = 0.7) -> np.ndarray:
    """Return (F,) 1 from `begin` to `end`, s, and 0 from `move` before and after, s; minimum-jerk curves between.

    It is 0 throughout if the end is so far before the beginning that nothing is between, as in very short clips.
    """
    return np.maximum(minimum_jerk((seconds - begin + move) / move) - minimum_jerk((seconds - end) / move), 0)


def wrapped(angle: np.ndarray | float) -> np.ndarray | float:
    """Return the same angle in the range from -pi to pi, rad."""
    return (angle + np.pi) % (2 * np.pi) - np.pi


def step_back(path: np.ndarray, cast: Cast, begin: float, far: float) -> np.ndarray:
    """Return a (F, 3) path that goes back a distance `far`, m, from the time `begin`, s, on, facing ahead."""
    share = far * ease((cast.seconds - begin) / max(0.8, far / 0.5))
    ahead = forwards(path[:, 2])
    return np.column_stack([path[:, :2] - share[:, None] * ahead, path[:, 2]])


def meeting(cast: Cast, longest: float, *, rng: np.random.Generator) -> tuple[float, float, float]:
    """Return the distance that each person walks, m, and the times at which they meet and part, s; for any clip."""
    last = max(cast.seconds[-1], 1e-9)
    when = min(rng.uniform(1.2, 2.4), 0.36 * last)
    return min(longest, 0.55 * when), when, max(last - 1.0, 0.75 * last)


def face_to_face(
    cast: Cast, apart: float, aside: float, *, come: float, when: float, rng: np.random.Generator
) -> tuple[tuple[Role, ...], np.ndarray]:
    """Return the roles of two people who walk up to each other, and look at each other, and the direction (2,) from the
    first to the second. They walk `come`, m, each, arrive at `when`, s, and are then `apart` along and `aside` across
    it, m."""
    yaw = rng.uniform(0, 2 * np.pi)
    ahead, left = forwards(yaw), leftwards(yaw)
    roles = []
    for person, sign in enumerate((-1, 1)):
        place = sign * (ahead * apart / 2 + left * aside / 2)
        facing = yaw if sign < 0 else yaw + np.pi
        start = np.array((*(place + sign * come * ahead), facing))
        path = approach(cast, start, np.array((*place, facing)), begin=0.0, speed=come / max(when, 0.6))
        roles.append(Role(path, gaze=np.full(len(path), 1 - person)))
    return tuple(roles), ahead


# Measures of bodies: seats, arms, trunks, and the heights that hands reach

STOOL_BEHIND = 0.085
"""Distance of the middle of a stool behind the hip joints, m: thighs that slope to low knees stay above its edge."""
_SQUARE, _SHIRT = 2.3, 0.005
"""Exponent of the superellipse across a trunk, and thickness of cloth on it, m."""
_PROJECTIONS = 20
_STRETCH = 0.94
"""Greatest extension of an arm at ease, as a share of its length."""


def seated(body: Body) -> float:
    """Return the hip height in sitting on a stool, m."""
    return float(prop_size(STOOL).reach[2]) + sitting_depth(body)


def arm_length(body: Body) -> float:
    """Return the distance from the shoulder to the palm of a straight arm, m."""
    lengths = sum(float(np.linalg.norm(body.offsets[SEGMENTS.index(f"l_{part}")])) for part in ("forearm", "hand"))
    return lengths + float(PALM[1]) * body.stature * body.arms


def thickness(body: Body) -> float:
    """Return half the greatest depth of the trunk, at the belly or at the chest, m."""
    return float(trunk_sections(body, np.array((0.105, 0.21)))[:, 2].max())


def on_trunk(body: Body, height: float, angle: float, press: float) -> tuple[str, np.ndarray, np.ndarray]:
    """Return a point on the clothed skin of the trunk: its segment, point (3,) in its frame, m, and unit normal (3,).

    Args:
        height: Height above the hip joints, as a fraction of stature, of a person with an average trunk.
        angle: Direction from the middle of the trunk: 0 to the front, pi / 2 to the left, rad.
        press: Depth of the point below the skin, m.
    """
    ahead, up, depth, breadth = trunk_sections(body, np.array([height]))[0]
    segment = "pelvis" if height < 0.05 else "spine" if height < 0.13 else "chest"
    origin = np.cumsum(body.offsets[: SEGMENTS.index(segment) + 1], axis=0)[-1]
    cos, sin = np.cos(angle), np.sin(angle)
    # A superellipse, as the surface is drawn.
    far = (np.abs(cos) ** _SQUARE + np.abs(sin) ** _SQUARE) ** (-1 / _SQUARE)
    normal = np.array((np.sign(cos) * np.abs(far * cos) ** (_SQUARE - 1) / depth,
                       np.sign(sin) * np.abs(far * sin) ** (_SQUARE - 1) / breadth, 0.0))  # fmt: skip
    normal /= np.linalg.norm(normal)
    point = np.array((ahead + far * cos * (depth + _SHIRT), far * sin * (breadth + _SHIRT), up))
    return segment, point - origin - press * normal, normal


def nearest_reached(points: np.ndarray, bodies: Sequence[Body], shoulders: Sequence[np.ndarray]) -> np.ndarray:
    """Return points (F, 3), m, moved as little as a palm of each person needs, from a shoulder (F, 3), m.

    Alternating projections find them. If no point is in reach of all people, the result is between them.
    """
    for _ in range(_PROJECTIONS):
        for body, shoulder in zip(bodies, shoulders, strict=True):
            way = points - shoulder
            far = np.linalg.norm(way, axis=1, keepdims=True)
            points = shoulder + way * np.minimum(1, _STRETCH * arm_length(body) / np.maximum(far, 1e-6))
    return points


def within_reach(bodies: Sequence[Body], away: Sequence[float]) -> tuple[float, float]:
    """Return the least and greatest height at which the palms of all people can be, standing upright, m.

    The palm is a horizontal distance `away`, m, from each person's shoulder. Without such a height, the least is
    greater.
    """
    low, high = 0.0, np.inf
    for body, far in zip(bodies, away, strict=True):
        up = [body.offsets[SEGMENTS.index(segment)][2] for segment in ("spine", "chest", "l_upper_arm")]
        shoulder, span = body.hip_height + sum(up), _STRETCH * arm_length(body)
        rise = np.sqrt(max(span**2 - far**2, 0.0))
        low, high = max(low, shoulder - rise), min(high, shoulder + rise)
    return float(low), float(high)
