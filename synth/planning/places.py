"""Places in a room where cameras can be mounted, and candidate cameras at them."""

from dataclasses import dataclass, replace
from pathlib import Path

import mujoco
import numpy as np

from dmae.data.cameras import CameraRig
from synth.planning.config import LensConfig, MountConfig
from synth.rigs.coverage import Stage, find_faults
from synth.rigs.placement import aimed
from synth.rooms.props import footprints, geom_corners
from synth.rooms.rays import at_rest, cast_rays, geom_around, opaque_model
from synth.rooms.room import compile_mjcf

_DIRECTIONS = 240
"""Number of directions around the people in which walls are searched."""
_WALL_LENGTH, _WALL_HEIGHT = 1.5, 1.8
"""Least length and least top height of a wall, m."""
_WALL_DISTANCE = 0.15
"""Distance of a camera from the wall or the ceiling that it is mounted on, m."""
_WALL_MOUNTS = 1.8, 2.6
"""Least and greatest height of cameras on walls by default, m."""
_GRID = 0.5
"""Distance between places before they are thinned out, m."""
_LEVEL_STEP = 0.6
"""Greatest distance between the levels of one kind of mount, m."""
_TRIPOD_GAP = 0.4
"""Least distance of tripods from the people's area and from furniture, m."""
_LIFT = 1e-3


@dataclass(frozen=True)
class CameraPlaces:
    """Places for cameras."""

    kind: np.ndarray  # (K,) "wall", "ceiling" or "tripod"
    at: np.ndarray  # (K, 3) positions, m, world

    def __len__(self) -> int:
        return len(self.at)


@dataclass(frozen=True)
class _Outline:
    """The walls around the people, seen from the middle of their area."""

    middle: np.ndarray  # (2,) middle of the people's area, m
    reach: np.ndarray  # (N,) distance of the wall in each of N directions, evenly around from +x, m; inf for none
    top: float  # Height of the walls, m; 0 for none

    @property
    def walled(self) -> np.ndarray:
        """(N,) True for directions with a wall."""
        return np.isfinite(self.reach)

    def holds(self, points: np.ndarray, margin: float) -> np.ndarray:
        """Return whether points (n, 2), m, are inside the walls by a margin, m. Where no wall is, none is inside."""
        offset = points - self.middle
        angle = np.arctan2(offset[:, 1], offset[:, 0]) / (2 * np.pi) * len(self.reach)
        reach = np.where(self.walled, self.reach, 0)[np.round(angle).astype(int) % len(self.reach)]
        return np.linalg.norm(offset, axis=1) <= reach - margin


def find_places(config: MountConfig, arena: Path, middle: np.ndarray, radius: float) -> CameraPlaces:
    """Return evenly spread places in a room (an MJCF file) where a camera may be mounted.

    Walls are vertical surfaces that face the people, are at least 1.5 m long, and end at a height of 1.8 m or more. In
    a room without a ceiling, cameras hang at the top of the walls. The people's area is around `middle` (2,), m.

    Raises:
        ValueError: the room has no walls although they are needed, a height is outside the room, or no place is left.
    """
    model = compile_mjcf(arena)
    data = at_rest(model)
    outline = _outline(model, data, np.asarray(middle, float))
    name, walled = arena.name, outline.walled.any()
    if config.walls is None:
        low, high = _WALL_MOUNTS
        config = replace(config, walls=[low, min(high, outline.top) if outline.top > low else high])
    if config.walls and not walled:
        raise ValueError(
            f"{name} has no walls around ({middle[0]:g}, {middle[1]:g}) to mount cameras on (mount.walls="
            f"{list(config.walls)}); set mount.walls=[] and mount.ceiling=false, and mount.area for tripods"
        )
    if (config.ceiling or config.tripods) and not (walled or config.area):
        raise ValueError(
            f"{name} has no walls, so that its extent is unknown; state where cameras may be: mount.area=[...]"
        )
    for kind in ("walls", "tripods"):
        heights = getattr(config, kind)
        if walled and heights and heights[1] > outline.top:
            raise ValueError(
                f"mount.{kind}={list(heights)}: {name} is {outline.top:.2f} m high; expected heights below that"
            )
    grid = _grid(config, outline)
    found = {
        "wall": _on_walls(config, outline) if config.walls else np.empty((0, 3)),
        "ceiling": _under_ceiling(model, data, outline, grid) if config.ceiling else np.empty((0, 3)),
        "tripod": _on_tripods(config, arena, middle, radius, grid) if config.tripods else np.empty((0, 3)),
    }
    kinds = np.concatenate([np.full(len(at), kind) for kind, at in found.items()])
    at = np.concatenate([*found.values()])
    kept = np.array([geom_around(model, data, place) < 0 for place in at], bool)
    if config.area:
        kept &= ((at[:, :2] >= config.area[:2]) & (at[:, :2] <= config.area[2:])).all(1)
    kinds, at = kinds[kept], at[kept]
    if len(at) < 2:
        raise ValueError(
            f"{name}: no places for cameras are left; widen mount.area or the heights of mount.walls or mount.tripods"
        )
    chosen = _spread(at, config.places)
    return CameraPlaces(kinds[chosen], at[chosen])


def _outline(model: mujoco.MjModel, data: mujoco.MjData, middle: np.ndarray) -> _Outline:
    """Return the first wall in each direction, from horizontal rays that start at the middle, at head height."""
    corners = geom_corners(model, data, np.arange(model.ngeom))
    planes = model.geom_type == mujoco.mjtGeom.mjGEOM_PLANE
    # The bounding boxes of planes are of no use here: MuJoCo makes them infinite.
    up = np.abs(data.geom_xmat.reshape(-1, 3, 3)[:, 2, 2])
    long = np.linalg.norm(np.ptp(corners[..., :2], axis=1), axis=1) >= _WALL_LENGTH
    wall = np.where(planes, up < 0.1, long & (corners[..., 2].max(1) >= _WALL_HEIGHT))
    angle = 2 * np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS
    directions = np.stack([np.cos(angle), np.sin(angle), 0 * angle], -1)
    opaque = opaque_model(model, wall.astype(int))
    geom, reach, outward = cast_rays(opaque, data, np.array([*middle, _WALL_HEIGHT - _LIFT]), directions)
    found = (geom >= 0) & (np.abs(outward[:, 2]) < 0.3)
    tops = [_top(opaque, data, middle, direction) for direction in directions[found][:: max(1, _DIRECTIONS // 24)]]
    return _Outline(middle, np.where(found, reach, np.inf), float(np.median(tops)) if tops else 0.0)


def _top(opaque: mujoco.MjModel, data: mujoco.MjData, middle: np.ndarray, direction: np.ndarray) -> float:
    """Return the height of the top of the wall in a direction, to 5 cm, m."""
    low, high = _WALL_HEIGHT - _LIFT, 100.0
    while high - low > 0.05:
        half = (low + high) / 2
        geom, *_ = cast_rays(opaque, data, np.array([*middle, half]), direction[None])
        low, high = (half, high) if geom[0] >= 0 else (low, half)
    return low


def _levels(heights: list[float]) -> np.ndarray:
    """Return the tested heights for one kind of mount, m."""
    low, high = heights
    return np.linspace(low, high, 1 + int(np.ceil((high - low) / _LEVEL_STEP)))


def _on_walls(config: MountConfig, outline: _Outline) -> np.ndarray:
    """Return (K, 3) places in front of the walls, m."""
    assert config.walls is not None
    angle = 2 * np.pi * np.flatnonzero(outline.walled) / _DIRECTIONS
    # The distance is measured along the ray, so that places in corners are in front of the wall as well.
    reach = outline.reach[outline.walled] - _WALL_DISTANCE * np.sqrt(2)
    flat = outline.middle + reach[:, None] * np.stack([np.cos(angle), np.sin(angle)], -1)
    return _stacked(flat[reach > 0], _levels(config.walls))


def _grid(config: MountConfig, outline: _Outline) -> np.ndarray:
    """Return (n, 2) points on the floor inside the walls, or inside `area` if there are no walls, m."""
    if config.area:
        (x0, y0), (x1, y1) = config.area[:2], config.area[2:]
    else:
        most = outline.reach[outline.walled].max()
        (x0, y0), (x1, y1) = outline.middle - most, outline.middle + most
    xs, ys = (np.arange(a, b + 1e-9, max(_GRID, (b - a) / 200)) for a, b in ((x0, x1), (y0, y1)))
    points = np.stack(np.meshgrid(xs, ys, indexing="ij"), -1).reshape(-1, 2)
    return points[outline.holds(points, _WALL_DISTANCE + 0.1)] if outline.walled.any() else points


def _under_ceiling(model: mujoco.MjModel, data: mujoco.MjData, outline: _Outline, grid: np.ndarray) -> np.ndarray:
    """Return (K, 3) places under the ceiling, m, or at the height of the top of the walls where there is no ceiling."""
    places = []
    for x, y in grid:
        # mj_multiRay misses some geoms if a ray is exactly vertical.
        height = mujoco.mj_ray(model, data, (x, y, _WALL_HEIGHT), (0, 0, 1), None, 1, -1, np.zeros(1, np.int32))
        top = _WALL_HEIGHT + height if height > 0 else outline.top
        if top - _WALL_DISTANCE > _WALL_HEIGHT:
            places.append((x, y, top - _WALL_DISTANCE))
    return np.reshape(places, (-1, 3))


def _on_tripods(config: MountConfig, arena: Path, middle: np.ndarray, radius: float, grid: np.ndarray) -> np.ndarray:
    """Return (K, 3) camera positions on tripods, away from people and furniture, m."""
    discs = footprints(arena)
    free = np.linalg.norm(grid - middle, axis=1) >= radius + _TRIPOD_GAP
    free &= (np.linalg.norm(grid[:, None] - discs[:, :2], axis=-1) >= discs[:, 2] + _TRIPOD_GAP).all(1)
    return _stacked(grid[free], _levels(config.tripods))


def _stacked(flat: np.ndarray, levels: np.ndarray) -> np.ndarray:
    """Return (n L, 3) points: each point (n, 2) at each of L heights, m."""
    return np.concatenate([np.column_stack([flat, np.full(len(flat), level)]) for level in levels])


def _spread(at: np.ndarray, count: int) -> np.ndarray:
    """Return the indices of at most `count` places. Each next place is the one farthest from the places before it."""
    chosen, gap = [0], np.linalg.norm(at - at[0], axis=1)
    while len(chosen) < count and gap.max() > 1e-6:
        chosen.append(int(gap.argmax()))
        gap = np.minimum(gap, np.linalg.norm(at - at[chosen[-1]], axis=1))
    return np.sort(chosen)


# Candidate cameras: each place combined with each useful direction and lens.

_TARGET_HEIGHT = 1.0
"""Height of the points that cameras are aimed at, m."""
_AIM_OFFSET = 0.5
"""How far from the middle the other points are that cameras are aimed at, as a share of the radius of people."""


@dataclass(frozen=True)
class CandidateCameras:
    """Cameras that a rig can be chosen from."""

    rig: CameraRig  # C cameras. Cameras at the same place differ in direction or lens.
    place: np.ndarray  # (C,) index of the place of each camera
    kind: np.ndarray  # (C,) "wall", "ceiling", "tripod", or "given" for existing cameras
    view_deg: np.ndarray  # (C,) horizontal field of view, degrees

    def __len__(self) -> int:
        return len(self.rig)

    @property
    def pan_deg(self) -> np.ndarray:
        """(C,) direction of the optical axis about the vertical, degrees from +x towards +y."""
        x, y, _ = self.rig.cam_from_world[:, 2, :3].T
        return np.degrees(np.arctan2(y, x))

    @property
    def tilt_deg(self) -> np.ndarray:
        """(C,) angle of the optical axis above the horizontal, degrees; below 0 for cameras that look down."""
        return np.degrees(np.arcsin(np.clip(self.rig.cam_from_world[:, 2, 2], -1, 1)))


def aimed_cameras(
    places: CameraPlaces, lens: LensConfig, middle: np.ndarray, radius: float, stage: Stage, *, steepest: float = 90.0
) -> CandidateCameras:
    """Return cameras at all places, aimed at the middle (2,), m, of the people's area and at four points around it.

    Places from which no people can be seen are left out (`stage`, see `synth.rigs.coverage`), and cameras that look
    down more than `steepest`, degrees.

    Raises ValueError if people can be seen from fewer than two places.
    """
    centers, aims, numbers, angles = [], [], [], []
    for number, at in enumerate(places.at):
        ahead = np.append(middle, _TARGET_HEIGHT) - at
        ahead = ahead[:2] / max(np.linalg.norm(ahead[:2]), 1e-9)
        aside = np.array([-ahead[1], ahead[0]])
        for offset in (0 * ahead, ahead, -ahead, aside, -aside):
            for angle in lens.view_deg:
                centers.append(at)
                aims.append([*(middle + _AIM_OFFSET * radius * offset), _TARGET_HEIGHT])
                numbers.append(number)
                angles.append(angle)
    place = np.array(numbers)
    names = [f"c{number}" for number in range(len(centers))]
    K = np.array([lens.matrix(angle) for angle in angles])
    rig = aimed(names, K, np.array(centers), np.array(aims), lens.size)
    found = CandidateCameras(rig, place, places.kind[place], np.array(angles))
    faulty = set(find_faults(rig, stage))
    kept = [c for c in range(len(rig)) if c not in faulty and found.tilt_deg[c] >= -steepest]
    if len(set(place[kept].tolist())) < 2:
        raise ValueError(
            "people can be seen from fewer than two of the places for cameras; widen mount.area or the heights of "
            "mount.walls and mount.tripods, lens.view_deg, or mount.steepest_deg"
        )
    return CandidateCameras(rig[kept], place[kept], found.kind[kept], found.view_deg[kept])


def given_cameras(rig: CameraRig) -> CandidateCameras:
    """Return the cameras of an existing rig as candidates."""
    view = 2 * np.degrees(np.arctan(rig.size[:, 0] / 2 / rig.K[:, 0, 0]))
    return CandidateCameras(rig, np.arange(len(rig)), np.full(len(rig), "given"), view)
