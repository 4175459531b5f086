"""Place props and people: never in each other's way, close enough that people hide each other."""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from dmae.data.clip import person_name
from synth.errors import FailedSimulation
from synth.interactions.script import STOOL, STOOL_BEHIND, Load, Script
from synth.motion.motion import Motion, avoid_collisions, redirect, redirected_path
from synth.rooms.props import PlacedProp, PropSize, footprints, prop_size
from synth.rooms.room import arena_file
from synth.scene.config import SceneConfig

_PROP_DRAWS = 60
"""Number of positions that are drawn for a prop before it is left out."""
_GAP = (0.3, 0.05, 0.6)
"""Least distance of a prop from people's hips, from other objects, and from cameras, m."""
_EXTRA_RADIUS = 1.5
"""Distance beyond the radius at which props may stand between people and cameras, m."""


def place_props(
    count: int,
    kinds: dict[str, PropSize],
    paths: np.ndarray,
    config: SceneConfig,
    *,
    fps: float,
    clearance: float,
    occupied: np.ndarray,
    rng: np.random.Generator,
    cameras: Sequence[tuple[float, float]] = (),
) -> list[PlacedProp]:
    """Place up to `count` props, of kinds with sizes, where no person walks; fewer if there is no space.

    Args:
        paths: (F, P, 2) hips before people step aside for each other, m.
        occupied: (K, 3) x, y and radius of discs where other props stand, m.
        cameras: (x, y) of cameras, m. If there are any, each prop stands between a camera and a person, with its broad
            side across the line of sight, up to 1.5 m beyond the radius. Large kinds are then drawn more often.
    """
    obstacles, middle, radius = footprints(arena_file(config.arena)), config.middle, config.radius
    walked = (paths + avoid_collisions(paths, fps, clearance=clearance, obstacles=obstacles)).reshape(-1, 2)
    occupied = np.concatenate([obstacles, occupied])
    lenses = np.array(cameras).reshape(-1, 2)
    reach = radius + _EXTRA_RADIUS * bool(len(lenses))
    names = sorted(kinds)
    faces = np.array([kinds[name].face for name in names])
    weights = faces / faces.sum() if len(cameras) else None
    props = []
    for _ in range(count):
        kind = str(rng.choice(names, p=weights))
        for _ in range(_PROP_DRAWS):
            if len(lenses):
                at, yaw = _between(walked, lenses, rng=rng)
            else:
                yaw = float(rng.uniform(-np.pi, np.pi))
                at = middle + rng.uniform(-radius, radius, 2)
            discs = placed_discs(kinds[kind].discs, at, yaw)
            gaps = [
                np.linalg.norm(points[:, None] - discs[:, :2], axis=-1) - discs[:, 2]
                for points in (walked, occupied[:, :2], lenses)
            ]
            gaps[1] -= occupied[:, 2:]
            free = all(gap.min(initial=np.inf) > least for gap, least in zip(gaps, _GAP, strict=True))
            if free and np.linalg.norm(np.subtract(at, middle)) < reach:
                props.append(PlacedProp(kind, (float(at[0]), float(at[1])), yaw))
                occupied = np.concatenate([occupied, discs])
                break
    return props


def placed_discs(discs: np.ndarray, at: Sequence[float] | np.ndarray, yaw: float) -> np.ndarray:
    """Return the (K, 3) discs of a prop after a turn by `yaw`, rad, and a shift to `at`, m."""
    turn = np.array([(np.cos(yaw), np.sin(yaw)), (-np.sin(yaw), np.cos(yaw))])
    return np.column_stack([discs[:, :2] @ turn + at, discs[:, 2]])


def _between(walked: np.ndarray, cameras: np.ndarray, *, rng: np.random.Generator) -> tuple[np.ndarray, float]:
    """Return a position between a camera and a point of a person's path, m, and a heading across that line, rad."""
    person, camera = walked[rng.integers(len(walked))], cameras[rng.integers(len(cameras))]
    sight = camera - person
    yaw = float(np.arctan2(sight[1], sight[0]) + np.pi / 2 + rng.normal(0, 0.25))
    return person + rng.uniform(0.1, 0.8) * sight, yaw


# People

_DRAWS = 60
"""Placements drawn for a person before the clip fails."""
_BEND_RATES = (0.0, 0.12, 0.25, 0.4, 0.6, 0.85, 1.15, 1.6, 2.2)
"""Rates at which a path may be bent, rad/s; the first rate that keeps the path within the radius is used."""
_START_DISTANCE = 0.8
"""Least distance between two people's hips in the first frame, m."""
_OBSTACLE_GAP = 0.3
"""Least distance between hips and an obstacle, m."""
_PERSON_RADIUS = 0.25
"""Radius around the hips that a person of an interaction needs, m."""


class Placement(NamedTuple):
    """The place, heading and bend of a motion in the scene."""

    start: tuple[float, float]  # x and y of the hips in the first frame, m
    yaw: float  # Turn of the whole motion about the vertical, rad
    turn: float  # Bend of the motion along a curve, rad/s


def place_persons(
    motions: list[Motion],
    config: SceneConfig,
    *,
    clearance: float,
    rng: np.random.Generator,
    others: np.ndarray | None = None,
    occupied: np.ndarray | None = None,
) -> list[Placement]:
    """Place each motion so that it passes a common meeting point at some time and stays within the radius.

    Several placements are drawn for each person, and the one with the fewest sidesteps is used. People keep clear of
    each other's stools.

    Args:
        others: (F, Q, 2) hips of people who are placed already, m.
        occupied: (K, 3) x, y and radius of discs where furniture stands, m.

    Raises FailedSimulation, which names a motion without space and what to change.
    """
    obstacles, middle, radius = footprints(arena_file(config.arena)), config.middle, config.radius
    if occupied is not None:
        obstacles = np.concatenate([obstacles, occupied])
    meeting = rng.normal(middle, 0.25 * config.gathering, 2)
    placements: list[Placement] = []
    paths, stools = np.empty((len(motions[0]), 0, 2)) if others is None else others, np.empty((0, 3))
    for number, motion in enumerate(motions):
        best, least = None, np.inf
        for attempt in range(_DRAWS):
            # Each failed draw widens the search, so later draws are farther from the middle.
            spread = config.gathering * (1 + attempt / 15)
            placed, path, outside = _draw(motion, meeting + rng.normal(0, spread, 2), middle, radius, rng=rng)
            cost = 10 * outside + _crowding(path, paths, np.concatenate([obstacles, stools]), clearance)
            own = stool_discs(motion, placed)
            if len(own):
                gap = np.linalg.norm(paths[:, :, None] - own[:, :2], axis=-1) - own[:, 2] - _OBSTACLE_GAP
                cost += 3 * np.maximum(0, -gap).max(initial=0.0)
            if cost < least:
                best, least, kept = placed, cost, path
            if least < 0.02:
                break
        reach = np.linalg.norm(kept - middle, axis=1).max()
        apart = np.linalg.norm(paths[:1] - kept[:1, None], axis=-1).min(initial=np.inf)
        if reach > radius + 0.3 or apart < 0.5:
            reason = f"strays {reach:.1f} m from the middle" if apart >= 0.5 else "starts where another person stands"
            raise FailedSimulation(
                f"no room for {person_name(number)} of {len(motions)}, moving as {motion.name!r}: {reason}. "
                f"Fewer people, shorter clips or a larger scene.radius (now {radius} m) would help"
            )
        assert best is not None
        placements.append(best)
        paths = np.concatenate([paths, kept[:, None]], axis=1)
        stools = np.concatenate([stools, stool_discs(motion, best)])
    return placements


def stool_discs(motion: Motion, placed: Placement) -> np.ndarray:
    """Return (K, 3) x, y and radius of the stools of one person whose motion is placed in the room, m."""
    radius = float(prop_size(STOOL).reach[0])
    places: list[np.ndarray] = []
    moved = redirect(motion, *placed) if motion.seats else motion
    for frame in motion.seats:
        ahead = moved.rotations[frame, 0, :2, 0]
        stool = moved.root[frame, :2] - STOOL_BEHIND * ahead / np.linalg.norm(ahead)
        # A person that sits down at the same place again uses the same stool.
        if all(np.linalg.norm(stool - place) > 2 * radius for place in places):
            places.append(stool)
    return np.column_stack([np.reshape(places, (-1, 2)), np.full(len(places), radius)])


def place_script(
    script: Script, motions: list[Motion], config: SceneConfig, *, rng: np.random.Generator
) -> tuple[list[Placement], list[PlacedProp], list[Load]]:
    """Place all people of an interaction together, with their furniture and the objects that are carried.

    `motions`, one for each person, are around the origin. Raises FailedSimulation if there is no space up to half a
    metre beyond the radius; the message says what to change.
    """
    furniture = [placed_discs(prop_size(prop.kind).discs, prop.at, prop.yaw) for prop in script.furniture]
    obstacles, middle, radius = footprints(arena_file(config.arena)), config.middle, config.radius
    paths = np.concatenate([motion.root[:, :2] for motion in motions])
    occupied = np.concatenate([np.column_stack([paths, np.full(len(paths), _PERSON_RADIUS)]), *furniture])
    reach = float(np.linalg.norm(paths, axis=1).max())
    walking = all(role.walks for role in script.roles)
    best, least = None, np.inf
    for attempt in range(_DRAWS):
        at = rng.normal(middle, 0.25 * config.gathering * (1 + attempt / 10), 2)
        yaw = float(rng.uniform(-np.pi, np.pi))
        places = placed_discs(occupied, at, yaw)[:, :2]
        gap = np.linalg.norm(places[:, None] - obstacles[:, :2], axis=-1) - obstacles[:, 2] - occupied[:, 2:]
        blocked = np.maximum(0, -gap).max(1, initial=0.0)
        strays = float(np.linalg.norm(places[: len(paths)] - middle, axis=1).max())
        # Walking people step around obstacles later, so the mean overlap is enough for them.
        cost = float(blocked.mean() if walking else blocked.max()) + max(0.0, strays - max(radius, reach))
        if cost < least:
            best, least = (at, yaw), cost
        if least == 0:
            break
    if reach > radius + 0.5 or least > 0.3:
        reason = f"it strays {reach:.1f} m from the middle" if least <= 0.3 else "objects of the room are in the way"
        raise FailedSimulation(
            f"no room for what {len(motions)} people do together: {reason}. "
            f"Fewer people, shorter clips, another scene or a larger scene.radius (now {radius} m) would help"
        )
    assert best is not None
    yaw = best[1]
    return (
        [Placement(_moved(motion.root[0], *best), yaw, 0.0) for motion in motions],
        [PlacedProp(prop.kind, _moved(prop.at, *best), yaw + prop.yaw) for prop in script.furniture],
        [replace(load, at=(*_moved(load.at, *best), load.at[2]), yaw=yaw + load.yaw) for load in script.loads],
    )


def _draw(
    motion: Motion, passing: np.ndarray, middle: Sequence[float], radius: float, *, rng: np.random.Generator
) -> tuple[Placement, np.ndarray, float]:
    """Return a placement that passes a point in some frame, its path (F, 2) m, and its excess over the radius, m."""
    frame = int(rng.integers(len(motion)))
    yaw, side = float(rng.uniform(-np.pi, np.pi)), float(rng.choice((-1.0, 1.0)))
    best = None
    for turn in _BEND_RATES:
        turn = turn * side
        path = redirected_path(motion, (0.0, 0.0), yaw, turn)
        path = path - path[frame] + passing
        outside = max(0.0, float(np.linalg.norm(path - middle, axis=1).max()) - radius)
        if best is None or outside < best[2]:
            best = Placement((float(path[0, 0]), float(path[0, 1])), yaw, turn), path, outside
        if outside == 0:
            break
    assert best is not None
    return best


def _crowding(path: np.ndarray, others: np.ndarray, obstacles: np.ndarray, clearance: float) -> float:
    """Return the cost of the sidesteps on a path (F, 2) around others (F, P, 2) and obstacles (K, 3), roughly in m."""
    apart = np.linalg.norm(others - path[:, None], axis=-1)
    start = np.maximum(0, max(_START_DISTANCE, clearance) - apart[:1]).sum()
    meeting = np.maximum(0, clearance - apart)
    gap = np.linalg.norm(path[:, None] - obstacles[:, :2], axis=-1) - obstacles[:, 2] - _OBSTACLE_GAP
    blocked = np.maximum(0, -gap).max(initial=0.0)
    return float(5 * start + 3 * blocked + 2 * meeting.mean(0).sum() + 0.2 * meeting.max(initial=0.0))


def _moved(point: Sequence[float] | np.ndarray, at: Sequence[float] | np.ndarray, yaw: float) -> tuple[float, float]:
    """Return x and y, m, of a point (2 or more,) after a turn about the origin by `yaw`, rad, and a shift by `at`."""
    x, y, _ = placed_discs(np.array([(point[0], point[1], 0.0)]), at, yaw)[0]
    return float(x), float(y)
