"""Place props: never in the way of people, and on request between people and cameras."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from synth.motion.path_planning import avoid_collisions
from synth.rooms.footprints import footprints
from synth.rooms.props import PlacedProp, PropSize

_DRAWS = 60
"""Number of positions that are drawn for a prop before it is left out."""
_GAP = (0.3, 0.05, 0.6)
"""Least distance of a prop from people's hips, from other objects, and from cameras, m."""
_EXTRA_RADIUS = 1.5
"""Distance beyond the radius at which props may stand between people and cameras, m."""


def place_props(
    count: int,
    kinds: dict[str, PropSize],
    paths: np.ndarray,
    arena: Path,
    *,
    fps: float,
    middle: Sequence[float],
    radius: float,
    clearance: float,
    occupied: np.ndarray,
    rng: np.random.Generator,
    cameras: Sequence[tuple[float, float]] = (),
) -> list[PlacedProp]:
    """Place up to `count` props where no person walks; fewer if there is no space.

    Args:
        count: Number of props wanted.
        kinds: Kinds to draw from, with their sizes.
        paths: (F, P, 2) hips before people step aside for each other, m.
        arena: MJCF file of the room.
        fps: Frames per second.
        middle: x and y of the middle, m.
        radius: Greatest distance of props from the middle, m.
        clearance: Distance that people keep between their hips, m.
        occupied: (K, 3) x, y and radius of discs where other props stand, m.
        rng: Draws kinds and positions.
        cameras: (x, y) of cameras, m. If there are any, each prop stands between a camera and a person, with its broad
            side across the line of sight, up to 1.5 m beyond the radius. Large kinds are then drawn more often.
    """
    obstacles = footprints(arena)
    walked = (paths + avoid_collisions(paths, fps, clearance=clearance, obstacles=obstacles)).reshape(-1, 2)
    occupied = np.concatenate([obstacles, occupied])
    cameras = np.array(cameras).reshape(-1, 2)
    reach = radius + _EXTRA_RADIUS * bool(len(cameras))
    names = sorted(kinds)
    faces = np.array([kinds[name].face for name in names])
    weights = faces / faces.sum() if len(cameras) else None
    props = []
    for _ in range(count):
        kind = str(rng.choice(names, p=weights))
        for _ in range(_DRAWS):
            at, yaw = _between(walked, cameras, rng=rng) if len(cameras) else _anywhere(middle, radius, rng=rng)
            discs = placed_discs(kinds[kind].discs, at, yaw)
            gaps = [
                np.linalg.norm(points[:, None] - discs[:, :2], axis=-1) - discs[:, 2]
                for points in (walked, occupied[:, :2], cameras)
            ]
            gaps[1] -= occupied[:, 2:]
            free = all(gap.min(initial=np.inf) > least for gap, least in zip(gaps, _GAP, strict=True))
            if free and np.linalg.norm(np.subtract(at, middle)) < reach:
                props.append(PlacedProp(kind, (float(at[0]), float(at[1])), yaw))
                occupied = np.concatenate([occupied, discs])
                break
    return props


def placed_discs(discs: np.ndarray, at: Sequence[float], yaw: float) -> np.ndarray:
    """Return the (K, 3) discs of a prop after a turn by `yaw`, rad, and a shift to `at`, m."""
    turn = np.array([(np.cos(yaw), np.sin(yaw)), (-np.sin(yaw), np.cos(yaw))])
    return np.column_stack([discs[:, :2] @ turn + at, discs[:, 2]])


def _anywhere(middle: Sequence[float], radius: float, *, rng: np.random.Generator) -> tuple[np.ndarray, float]:
    yaw = float(rng.uniform(-np.pi, np.pi))
    return middle + rng.uniform(-radius, radius, 2), yaw


def _between(walked: np.ndarray, cameras: np.ndarray, *, rng: np.random.Generator) -> tuple[np.ndarray, float]:
    """Return a position between a camera and a point of a person's path, m, and a heading across that line, rad."""
    person, camera = walked[rng.integers(len(walked))], cameras[rng.integers(len(cameras))]
    sight = camera - person
    yaw = float(np.arctan2(sight[1], sight[0]) + np.pi / 2 + rng.normal(0, 0.25))
    return person + rng.uniform(0.1, 0.8) * sight, yaw
