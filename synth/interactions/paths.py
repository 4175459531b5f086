"""Paths of people on the floor, and the time curves of their movements."""

import numpy as np

from synth.interactions.script import Cast, Role
from synth.motion.easing import minimum_jerk


def standing(cast: Cast, at: np.ndarray, heading: float) -> np.ndarray:
    """Return the (F, 3) path of a person who stands at a point (2,), m, with a heading, rad."""
    return np.tile((*at, heading), (len(cast.seconds), 1))


def approach(cast: Cast, start: np.ndarray, end: np.ndarray, *, begin: float, speed: float) -> np.ndarray:
    """Return the straight (F, 3) path from `start` (3,) to `end` (3,) that begins at `begin`, s; mean speed in m/s."""
    way = end[:2] - start[:2]
    length = float(np.linalg.norm(way))
    last = max(length / speed, 0.6)
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
    return begin + max(float(np.linalg.norm(end[:2] - start[:2])) / speed, 0.6)


def ease(x: np.ndarray) -> np.ndarray:
    """Return a curve from 0 to 1: constant acceleration, constant rate from 1/4 to 3/4 of x, constant deceleration."""
    x = np.clip(x, 0, 1)
    slow, rate = 0.25, 1 / (1 - 0.25)
    begun, ended = rate * x**2 / (2 * slow), 1 - rate * (1 - x) ** 2 / (2 * slow)
    return np.where(x < slow, begun, np.where(x > 1 - slow, ended, rate * (x - slow / 2)))


def during(seconds: np.ndarray, begin: float, end: float, move: float = 0.7) -> np.ndarray:
    """Return (F,) 1 from `begin` to `end`, s, and 0 from `move` before and after, s; minimum-jerk curves between."""
    return minimum_jerk((seconds - begin + move) / move) - minimum_jerk((seconds - end) / move)


def wrapped(angle: np.ndarray | float) -> np.ndarray | float:
    """Return the same angle in the range from -pi to pi, rad."""
    return (angle + np.pi) % (2 * np.pi) - np.pi


def step_back(path: np.ndarray, cast: Cast, begin: float, far: float) -> np.ndarray:
    """Return a (F, 3) path that goes back a distance `far`, m, from the time `begin`, s, on, facing ahead."""
    share = far * ease((cast.seconds - begin) / max(0.8, far / 0.5))
    ahead = np.stack([np.cos(path[:, 2]), np.sin(path[:, 2])], 1)
    return np.column_stack([path[:, :2] - share[:, None] * ahead, path[:, 2]])


def meeting(cast: Cast, longest: float, *, rng: np.random.Generator) -> tuple[float, float, float]:
    """Return the distance that each person walks, m, and the times at which they meet and part, s; for any clip."""
    last = cast.seconds[-1]
    when = min(rng.uniform(1.2, 2.4), 0.36 * last)
    return min(longest, 0.55 * when), when, max(last - 1.0, 0.75 * last)


def face_to_face(
    cast: Cast, apart: float, aside: float, *, come: float, when: float, rng: np.random.Generator
) -> tuple[tuple[Role, ...], np.ndarray]:
    """Return the roles of two people who walk up to each other.

    Args:
        cast: The two people.
        apart, aside: Distance between them at the end, along and across their walking direction, m.
        come: Distance that each of them walks, m.
        when: Time at which they arrive, s.
        rng: Draws the direction.

    Returns:
        Their roles, in which they look at each other, and the direction (2,) from the first to the second.
    """
    yaw = rng.uniform(0, 2 * np.pi)
    ahead, left = np.array((np.cos(yaw), np.sin(yaw))), np.array((-np.sin(yaw), np.cos(yaw)))
    roles = []
    for person, sign in enumerate((-1, 1)):
        place = sign * (ahead * apart / 2 + left * aside / 2)
        facing = yaw if sign < 0 else yaw + np.pi
        start = np.array((*(place + sign * come * ahead), facing))
        path = approach(cast, start, np.array((*place, facing)), begin=0.0, speed=come / max(when, 0.6))
        roles.append(Role(path, gaze=np.full(len(path), 1 - person)))
    return tuple(roles), ahead
