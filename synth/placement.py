"""Where people and things go: close enough to hide each other, never inside each other."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from synth.arena import footprints
from synth.interactions.script import Load, Script
from synth.motion import Motion
from synth.plan import give_way, led_path
from synth.props import Space, prop_space
from synth.quality import FailedSimulation

_TRIES = 60
_TURNS = (0.0, 0.12, 0.25, 0.4, 0.6, 0.85, 1.15, 1.6, 2.2)
"""How sharply a path may be bent so that it stays within the radius, rad/s; the least that does is taken."""
_APART = 0.8
"""Least distance of two people's hips in the first frame, m."""

_STOOL = 0.17
"""Radius of `scenes/props/stool.xml`, m."""
_ROOM = (0.3, 0.05, 0.6)
"""Between a thing and who walks by, other things, and cameras, m."""

Placement = tuple[tuple[float, float], float, float]
"""Start (m), yaw (rad) and turn (rad/s), as `synth.plan.lead` takes them."""


def place_persons(
    motions: list[Motion],
    arena: Path,
    *,
    middle: Sequence[float],
    radius: float,
    gathering: float,
    clearance: float,
    rng: np.random.Generator,
) -> list[Placement]:
    """A place for each motion: it passes a common meeting point near the middle at some time, and keeps to the radius.

    Of several draws for a person the one that needs the fewest sidesteps is taken. Nobody passes where another's stool
    stands, see `stools`.

    Raises:
        FailedSimulation: somebody's motion does not fit; the message says whose and what to change.
    """
    obstacles = footprints(arena)
    meeting = rng.normal(middle, 0.25 * gathering, 2)
    placements: list[Placement] = []
    paths, seats = np.empty((len(motions[0]), 0, 2)), np.empty((0, 3))
    for number, motion in enumerate(motions):
        best, least = None, np.inf
        for attempt in range(_TRIES):
            # The longer nothing fits, the farther from the middle.
            spread = gathering * (1 + attempt / 15)
            placed, path, outside = _draw(motion, meeting + rng.normal(0, spread, 2), middle, radius, rng=rng)
            cost = 10 * outside + _crowding(path, paths, np.concatenate([obstacles, seats]), clearance)
            own = stools(motion, path)
            if len(own):
                gap = np.linalg.norm(paths[:, :, None] - own[:, :2], axis=-1) - own[:, 2] - 0.3
                cost += 3 * np.maximum(0, -gap).max(initial=0.0)
            if cost < least:
                best, least, kept = placed, cost, path
            if least < 0.02:
                break
        reach = np.linalg.norm(kept - middle, axis=1).max()
        apart = np.linalg.norm(paths[:1] - kept[:1, None], axis=-1).min(initial=np.inf)
        if reach > radius + 0.3 or apart < 0.5:
            reason = f"strays {reach:.1f} m from the middle" if apart >= 0.5 else "starts where somebody stands"
            raise FailedSimulation(
                f"no room for person {number} of {len(motions)}, moving as {motion.name!r}: {reason}. "
                f"Fewer people, shorter clips or a larger scene.radius (now {radius} m) would help"
            )
        placements.append(best)
        paths = np.concatenate([paths, kept[:, None]], axis=1)
        seats = np.concatenate([seats, stools(motion, kept)])
    return placements


def stools(motion: Motion, path: np.ndarray) -> np.ndarray:
    """(K, 3) x, y and radius of the stools on which somebody sits whose hips go along a path (F, 2), m."""
    places: list[np.ndarray] = []
    for frame in motion.seats:
        # Who sits down once more where they did has the same stool.
        if all(np.linalg.norm(path[frame] - place) > 2 * _STOOL for place in places):
            places.append(path[frame])
    return np.column_stack([np.reshape(places, (-1, 2)), np.full(len(places), _STOOL)])


def place_script(
    script: Script,
    motions: list[Motion],
    arena: Path,
    *,
    middle: Sequence[float],
    radius: float,
    gathering: float,
    rng: np.random.Generator,
) -> tuple[list[Placement], list[tuple[str, tuple[float, float], float]], list[Load]]:
    """One place for all who do something together, with their furniture.

    Args:
        script: What they do.
        motions: Theirs, arranged about the origin.
        arena: MJCF file of the room.
        middle: About which they do it, x and y, m.
        radius: How far hips may stray from there, m; half a metre farther before the clip is given up.
        gathering: How near the middle it all takes place, m (standard deviation).
        rng: Draws places.

    Returns:
        A placement for each motion; each piece of furniture's kind, place (m) and yaw (rad); and what is carried.

    Raises:
        FailedSimulation: there is no room.
    """
    furniture = [placed_discs(prop_space(thing.kind).discs, thing.at, thing.yaw) for thing in script.furniture]
    obstacles = footprints(arena)
    paths = np.concatenate([motion.root[:, :2] for motion in motions])
    taken = np.concatenate([np.column_stack([paths, np.full(len(paths), 0.25)]), *furniture])
    reach = float(np.linalg.norm(paths, axis=1).max())
    walking = all(role.walks for role in script.roles)
    best, least = None, np.inf
    for attempt in range(_TRIES):
        at, yaw = rng.normal(middle, 0.25 * gathering * (1 + attempt / 10), 2), float(rng.uniform(-np.pi, np.pi))
        places = placed_discs(taken, at, yaw)[:, :2]
        gap = np.linalg.norm(places[:, None] - obstacles[:, :2], axis=-1) - obstacles[:, 2] - taken[:, 2:]
        blocked = np.maximum(0, -gap).max(1, initial=0.0)
        strays = float(np.linalg.norm(places[: len(paths)] - middle, axis=1).max())
        # Who walks goes round what is in the way.
        cost = float(blocked.mean() if walking else blocked.max()) + max(0.0, strays - max(radius, reach))
        if cost < least:
            best, least = (at, yaw), cost
        if least == 0:
            break
    if reach > radius + 0.5 or least > 0.3:
        reason = f"it strays {reach:.1f} m from the middle" if least <= 0.3 else "things of the room are in the way"
        raise FailedSimulation(
            f"no room for what {len(motions)} people do together: {reason}. "
            f"Fewer people, shorter clips, another scene or a larger scene.radius (now {radius} m) would help"
        )
    yaw = best[1]
    return (
        [(_moved(motion.root[0], *best), yaw, 0.0) for motion in motions],
        [(thing.kind, _moved(thing.at, *best), yaw + thing.yaw) for thing in script.furniture],
        [replace(load, at=(*_moved(load.at, *best), load.at[2]), yaw=yaw + load.yaw) for load in script.loads],
    )


def _draw(
    motion: Motion, passing: np.ndarray, middle: Sequence[float], radius: float, *, rng: np.random.Generator
) -> tuple[Placement, np.ndarray, float]:
    """A placement that passes a point at some time, its path (F, 2), and how far that leads outside, m."""
    frame = int(rng.integers(len(motion)))
    yaw, side = float(rng.uniform(-np.pi, np.pi)), float(rng.choice((-1.0, 1.0)))
    best = None
    for turn in _TURNS:
        turn = turn * side
        path = led_path(motion, (0.0, 0.0), yaw, turn)
        path = path - path[frame] + passing
        outside = max(0.0, float(np.linalg.norm(path - middle, axis=1).max()) - radius)
        if best is None or outside < best[2]:
            best = ((float(path[0, 0]), float(path[0, 1])), yaw, turn), path, outside
        if outside == 0:
            break
    return best


def _crowding(path: np.ndarray, others: np.ndarray, obstacles: np.ndarray, clearance: float) -> float:
    """How much a path (F, 2) asks others (F, P, 2) and obstacles (K, 3) to make room, about in metres."""
    apart = np.linalg.norm(others - path[:, None], axis=-1)
    start = np.maximum(0, max(_APART, clearance) - apart[:1]).sum()
    meeting = np.maximum(0, clearance - apart)
    gap = np.linalg.norm(path[:, None] - obstacles[:, :2], axis=-1) - obstacles[:, 2] - 0.3
    blocked = np.maximum(0, -gap).max(initial=0.0)
    return float(5 * start + 3 * blocked + 2 * meeting.mean(0).sum() + 0.2 * meeting.max(initial=0.0))


def placed_discs(discs: np.ndarray, at: Sequence[float], yaw: float) -> np.ndarray:
    """(K, 3) discs of a thing that is at a place, m, turned by `yaw`, rad."""
    turn = np.array([(np.cos(yaw), np.sin(yaw)), (-np.sin(yaw), np.cos(yaw))])
    return np.column_stack([discs[:, :2] @ turn + at, discs[:, 2]])


def _moved(point: np.ndarray, at: Sequence[float], yaw: float) -> tuple[float, float]:
    """Where a point (2 or more,) about the origin is once all is placed so, m."""
    x, y, _ = placed_discs(np.array([(point[0], point[1], 0.0)]), at, yaw)[0]
    return float(x), float(y)


def place_props(
    count: int,
    kinds: dict[str, Space],
    paths: np.ndarray,
    arena: Path,
    *,
    fps: float,
    middle: Sequence[float],
    radius: float,
    clearance: float,
    rng: np.random.Generator,
    before: Sequence[tuple[float, float]] = (),
    taken: np.ndarray | None = None,
) -> list[tuple[str, tuple[float, float], float]]:
    """Up to `count` things where nobody walks: kind, place (m) and yaw (rad); fewer if there is no room.

    Args:
        count: How many are wanted.
        kinds: Names to draw from, with the room that each takes.
        paths: (F, P, 2) hips, m, before anybody gives way.
        arena: MJCF file of the room.
        fps: Frames per second.
        middle, radius: Things stand within so much of there, m.
        clearance: Between people, m.
        rng: Draws kinds and places.
        before: (x, y) of cameras, m. If there are any, things stand between one of them and somebody, broadside on,
            and up to 1.5 m beyond the radius; and large things are drawn more often.
        taken: (K, 3) x, y and radius of discs where other things stand, m.
    """
    obstacles = footprints(arena)
    walked = (paths + give_way(paths, fps, clearance=clearance, obstacles=obstacles)).reshape(-1, 2)
    taken = obstacles if taken is None else np.concatenate([obstacles, taken])
    cameras = np.array(before).reshape(-1, 2)
    reach = radius + 1.5 * bool(len(cameras))
    names = sorted(kinds)
    faces = np.array([kinds[name].face for name in names])
    weights = faces / faces.sum() if len(cameras) else None
    props = []
    for _ in range(count):
        kind = str(rng.choice(names, p=weights))
        for _ in range(_TRIES):
            at, yaw = _between(walked, cameras, rng=rng) if len(cameras) else _anywhere(middle, radius, rng=rng)
            discs = placed_discs(kinds[kind].discs, at, yaw)
            gaps = [
                np.linalg.norm(points[:, None] - discs[:, :2], axis=-1) - discs[:, 2]
                for points in (walked, taken[:, :2], cameras)
            ]
            gaps[1] -= taken[:, 2:]
            room = all(gap.min(initial=np.inf) > least for gap, least in zip(gaps, _ROOM, strict=True))
            if room and np.linalg.norm(np.subtract(at, middle)) < reach:
                props.append((kind, (float(at[0]), float(at[1])), yaw))
                taken = np.concatenate([taken, discs])
                break
    return props


def _anywhere(middle: Sequence[float], radius: float, *, rng: np.random.Generator) -> tuple[np.ndarray, float]:
    yaw = float(rng.uniform(-np.pi, np.pi))
    return middle + rng.uniform(-radius, radius, 2), yaw


def _between(walked: np.ndarray, cameras: np.ndarray, *, rng: np.random.Generator) -> tuple[np.ndarray, float]:
    """A place and a heading before a camera, on its way to where somebody walks."""
    somebody, camera = walked[rng.integers(len(walked))], cameras[rng.integers(len(cameras))]
    sight = camera - somebody
    yaw = float(np.arctan2(sight[1], sight[0]) + np.pi / 2 + rng.normal(0, 0.25))
    return somebody + rng.uniform(0.1, 0.8) * sight, yaw
