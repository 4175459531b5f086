"""Where cameras stand: listed, in a ring, on a dome, or at random."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from enum import Enum

import numpy as np

from dmae.data.cameras import CameraRig
from synth.rigs.coverage import Stage, find_faults, views_of_cells
from synth.rigs.lenses import joined


def intrinsics(focal: float, size: list[int]) -> np.ndarray:
    """Return the (3, 3) K of a camera with its principal point in the middle of the image, px."""
    width, rows = size
    return np.array([[focal, 0, (width - 1) / 2], [0, focal, (rows - 1) / 2], [0, 0, 1]])


def look_at(centers: np.ndarray, target: np.ndarray) -> np.ndarray:
    """Return (V, 3, 3) rotations cam_from_world of upright cameras.

    Args:
        centers: (V, 3) centres of the cameras, m, world.
        target: (3,) or (V, 3) points that they look at, m, world.
    """
    forward = target - centers
    forward /= np.linalg.norm(forward, axis=-1, keepdims=True)
    right = np.cross(forward, [0, 0, 1])
    # For cameras that look straight up or down, the world's x axis points to the right of the image.
    right[np.linalg.norm(right, axis=-1) < 1e-9] = (1, 0, 0)
    right /= np.linalg.norm(right, axis=-1, keepdims=True)
    return np.stack([right, np.cross(forward, right), forward], 1)


def pose(rotation: np.ndarray, centers: np.ndarray) -> np.ndarray:
    """Return (V, 4, 4) cam_from_world of cameras with (V, 3, 3) rotations cam_from_world and (V, 3) centres, m."""
    matrix = np.tile(np.eye(4), (len(rotation), 1, 1))
    matrix[:, :3, :3] = rotation
    matrix[:, :3, 3] = -np.einsum("vij,vj->vi", rotation, centers)
    return matrix


def check_pairs(group: str, config, names: tuple[str, ...]) -> None:
    """Raise ValueError if a field is not an ascending pair of numbers above 0; the message names the field."""
    for name in names:
        pair = getattr(config, name)
        if len(pair) != 2 or not 0 < pair[0] <= pair[1] < np.inf:
            raise ValueError(f"{group}.{name}: expected [least, greatest], more than 0, got {list(pair)}")


def check_views(group: str, views: int) -> None:
    """Raise ValueError if there is no camera."""
    if views < 1:
        raise ValueError(f"{group}.views: expected at least one camera, found {views}")


def check_picture(group: str, focal: float, size: list[int]) -> None:
    """Raise ValueError if these are not a focal length, px, and an image size, px; the message names the field."""
    if not 0 < focal < np.inf:
        raise ValueError(f"{group}.focal: expected more than 0 px, got {focal}")
    if len(size) != 2 or min(size) < 1:
        raise ValueError(f"{group}.size: expected [width, height], at least 1 px each, got {list(size)}")


# Listed cameras


@dataclass(frozen=True)
class CameraConfig:
    """One camera, by its matrices or by its position and target.

    Attributes:
        name: Name, unique in its rig.
        size: Image width and height, px.
        K: Intrinsic matrix: 9 numbers, row major, px; or give `focal`.
        cam_from_world: Pose [R | t]: 12 numbers, row major, t in m; or give `position` and `target`.
        dist: OpenCV distortion: 5 to 8 coefficients; for a fisheye its four, and zeros.
        fisheye: Whether the lens follows OpenCV's fisheye model.
        focal: Focal length, px; the principal point is the middle of the image.
        position: Centre of an upright camera: x, y, z, m.
        target: Point that the camera looks at: x, y, z, m.
    """

    name: str
    size: list[int]
    K: list[float] = field(default_factory=list)
    cam_from_world: list[float] = field(default_factory=list)
    dist: list[float] = field(default_factory=lambda: [0.0] * 5)
    fisheye: bool = False
    focal: float | None = None
    position: list[float] = field(default_factory=list)
    target: list[float] = field(default_factory=list)


def listed_cameras(cameras: Sequence[CameraConfig], source: str) -> CameraRig:
    """Return the rig of listed cameras.

    Args:
        cameras: At least one.
        source: Name of the rig, for messages.

    Raises:
        ValueError: numbers are missing or do not define a camera; the message names the rig, the camera and the field.
    """
    parts = [_numbers(camera, f"{source}, camera {camera.name!r}") for camera in cameras]
    longest = max(len(camera.dist) for camera in cameras)
    try:
        return CameraRig(
            tuple(camera.name for camera in cameras),
            [K for K, _ in parts],
            [np.pad(camera.dist, (0, longest - len(camera.dist))) for camera in cameras],
            [cam_from_world for _, cam_from_world in parts],
            [camera.size for camera in cameras],
            [camera.fisheye for camera in cameras],
        )
    except ValueError as error:
        raise ValueError(f"{source}: {error}") from None


def _numbers(camera: CameraConfig, where: str) -> tuple[np.ndarray, np.ndarray]:
    """Return K (3, 3), px, and cam_from_world (4, 4), m, of a listed camera."""
    placed = bool(camera.position or camera.target)
    expected = {"size": (2,), "dist": range(5, 9)}
    expected |= {"position": (3,), "target": (3,)} if placed else {"cam_from_world": (12,)}
    expected |= {"K": (9,)} if camera.focal is None else {}
    for name, lengths in expected.items():
        found = len(getattr(camera, name))
        if found not in lengths:
            raise ValueError(f"{where}: expected {' or '.join(map(str, lengths))} numbers of {name}, found {found}")
    for first, second, both in (
        ("K", "focal", camera.K and camera.focal is not None),
        ("cam_from_world", "position and target", camera.cam_from_world and placed),
    ):
        if both:
            raise ValueError(f"{where}: expected either {first} or {second}, found both")
    if camera.focal is None:
        K = np.reshape(camera.K, (3, 3))
    else:
        check_picture(where, camera.focal, camera.size)
        K = intrinsics(camera.focal, camera.size)
    if not placed:
        return K, np.vstack([np.reshape(camera.cam_from_world, (3, 4)), (0, 0, 0, 1)])
    center, target = np.array([camera.position], float), np.array(camera.target, float)
    if np.allclose(center, target):
        raise ValueError(f"{where}: expected a target that is not the position, found both at {camera.target}")
    return K, pose(look_at(center, target), center)[0]


# A ring, and a dome

_DISTANCE_FRACTIONS = np.linspace(0.95, 0.5, 10)
"""Fractions of the distance to the target that are tried if a camera is at an impossible place."""


@dataclass(frozen=True)
class RingConfig:
    """Cameras evenly around the vertical through the origin, looking at it; the ring's phase is random.

    Attributes:
        views: Number of cameras.
        radius: Least and greatest distance of a camera from the vertical, m.
        height: Least and greatest height of a camera, m.
        target_height: Height of the point that they look at, m.
        focal: Focal length, px.
        size: Image width and height, px.
    """

    views: int = 5
    radius: list[float] = field(default_factory=lambda: [3.5, 4.5])
    height: list[float] = field(default_factory=lambda: [1.0, 2.7])
    target_height: float = 0.9
    focal: float = 1080.0
    size: list[int] = field(default_factory=lambda: [1032, 776])

    def __post_init__(self):
        check_views("rig.ring", self.views)
        check_pairs("rig.ring", self, ("radius", "height"))
        check_picture("rig.ring", self.focal, self.size)


@dataclass(frozen=True)
class DomeConfig:
    """Cameras spread evenly over a band of a sphere, looking at its middle; nothing is random.

    Attributes:
        views: Number of cameras.
        radius: Radius of the sphere, m.
        elevation: Least and greatest angle of a camera above the horizontal through the middle, rad.
        target_height: Height of the middle of the sphere, m.
        focal: Focal length, px.
        size: Image width and height, px.
    """

    views: int = 31
    radius: float = 3.8
    elevation: list[float] = field(default_factory=lambda: [0.02, 0.9])
    target_height: float = 0.9
    focal: float = 1000.0
    size: list[int] = field(default_factory=lambda: [1280, 960])

    def __post_init__(self):
        check_views("rig.dome", self.views)
        check_pairs("rig.dome", self, ("elevation",))
        if not 0 < self.radius < np.inf:
            raise ValueError(f"rig.dome.radius: expected more than 0 m, got {self.radius}")
        if self.elevation[1] > np.pi / 2:
            raise ValueError(f"rig.dome.elevation: expected at most a right angle, in rad, got {list(self.elevation)}")
        check_picture("rig.dome", self.focal, self.size)


def ring(config: RingConfig, stage: Stage, *, rng: np.random.Generator) -> CameraRig:
    """Return the cameras of a ring. A camera at an impossible place is moved nearer to its target."""
    angle = 2 * np.pi * (np.arange(config.views) + rng.uniform()) / config.views
    radius = rng.uniform(*config.radius, config.views)
    height = rng.uniform(*config.height, config.views)
    centers = np.stack([radius * np.cos(angle), radius * np.sin(angle), height], -1)
    return _around("ring", config, centers, stage)


def dome(config: DomeConfig, stage: Stage) -> CameraRig:
    """Return the cameras of a dome, spaced by the golden angle. A camera at an impossible place is moved nearer."""
    low, high = np.sin(config.elevation)
    # Equal steps of height cut a sphere into bands of equal area.
    up = low + (np.arange(config.views) + 0.5) / config.views * (high - low)
    angle = np.pi * (3 - np.sqrt(5)) * np.arange(config.views)
    flat = np.sqrt(1 - up**2)
    directions = np.stack([flat * np.cos(angle), flat * np.sin(angle), up], -1)
    return _around("dome", config, config.radius * directions + [0, 0, config.target_height], stage)


def _around(name: str, config: RingConfig | DomeConfig, centers: np.ndarray, stage: Stage) -> CameraRig:
    """Return pinhole cameras at (V, 3) centres, m, that look at the middle."""
    target, views = np.array([0, 0, config.target_height]), len(centers)
    rig = CameraRig(
        tuple(f"{name}{view}" for view in range(views)),
        np.tile(intrinsics(config.focal, config.size), (views, 1, 1)),
        np.zeros((views, 5)),
        pose(look_at(centers, target), centers),
        np.tile(config.size, (views, 1)),
    )
    for view in find_faults(rig, stage):
        for share in _DISTANCE_FRACTIONS:
            centers[view] = target + share * (centers[view] - target)
            rig = replace(rig, cam_from_world=pose(rig.cam_from_world[:, :3, :3], centers))
            if not find_faults(rig[view : view + 1], stage):
                break
    return rig


# Random places with random lenses; enough cameras see every point of the people's area

_DRAWS = 1000
"""Number of cameras that are drawn before the rig fails."""


class Lens(Enum):
    """Kind of lens."""

    pinhole = "pinhole"
    """No distortion."""
    radial = "radial"
    """Barrel distortion, radial and a little tangential."""
    fisheye = "fisheye"


@dataclass(frozen=True)
class RandomConfig:
    """Cameras anywhere around the middle, such that enough of them see every point of the people's area.

    Pairs are the least and the greatest value that is drawn for each camera.

    Attributes:
        views: Number of cameras.
        views_at_least: Number of cameras that have each point in their image, ignoring walls and people: all points
            within `scene.radius` of the middle, from the floor to a height of 2 m.
        radius: Distance of a camera from the vertical through the origin, m.
        height: Height of a camera, m.
        target_height: Height of the point on that vertical that it looks at, m.
        focal: Focal length, px.
        lenses: Kinds of lenses that are drawn from.
        size: Image width and height, px.
    """

    views: int = 6
    views_at_least: int = 3
    radius: list[float] = field(default_factory=lambda: [3.0, 4.8])
    height: list[float] = field(default_factory=lambda: [0.8, 2.8])
    target_height: list[float] = field(default_factory=lambda: [0.7, 1.2])
    focal: list[float] = field(default_factory=lambda: [450.0, 1000.0])
    lenses: list[Lens] = field(default_factory=lambda: list(Lens))
    size: list[int] = field(default_factory=lambda: [1032, 776])

    def __post_init__(self):
        check_views("rig.random", self.views)
        check_pairs("rig.random", self, ("radius", "height", "target_height", "focal"))
        check_picture("rig.random", self.focal[0], self.size)
        if not 0 <= self.views_at_least <= self.views:
            raise ValueError(
                f"rig.random.views_at_least: expected 0 to rig.random.views, which is {self.views}; "
                f"got {self.views_at_least}"
            )
        if not self.lenses:
            raise ValueError(f"rig.random.lenses: expected at least one of {[lens.value for lens in Lens]}")


def scatter(config: RandomConfig, stage: Stage, *, rng: np.random.Generator) -> CameraRig:
    """Return random cameras at possible places that together see enough of the people's area.

    Raises:
        ValueError: no such cameras were found; the message says what to change.
    """
    cameras = [_draw(config, view, stage, rng=rng) for view in range(config.views)]
    counts = [views_of_cells(camera, stage) for camera in cameras]
    missing = _missing(counts, config.views_at_least)
    for _ in range(_DRAWS):
        if not missing.any():
            return joined(cameras)
        view = int(rng.integers(config.views))
        camera = _draw(config, view, stage, rng=rng)
        count = views_of_cells(camera, stage)
        changed = _missing([*counts[:view], count, *counts[view + 1 :]], config.views_at_least)
        if changed.sum() <= missing.sum():
            cameras[view], counts[view], missing = camera, count, changed
    if not missing.any():
        return joined(cameras)
    raise ValueError(
        f"rig.random: in {_DRAWS} draws no {config.views} cameras were found such that {config.views_at_least} "
        f"see every point of {stage}: fewer see {(missing > 0).mean():.0%} of it. Lower rig.random.views_at_least, "
        "rig.random.focal or scene.radius, or raise rig.random.views or rig.random.radius"
    )


def _missing(counts: list[np.ndarray], least: int) -> np.ndarray:
    """Return the number of cameras that each cell lacks."""
    return np.maximum(0, least - np.sum(counts, axis=0))


def _draw(config: RandomConfig, view: int, stage: Stage, *, rng: np.random.Generator) -> CameraRig:
    """Return one camera at a possible place. The number of random draws does not depend on the lens."""
    for _ in range(_DRAWS):
        angle, radius, height = rng.uniform(-np.pi, np.pi), rng.uniform(*config.radius), rng.uniform(*config.height)
        target = np.array([0, 0, rng.uniform(*config.target_height)])
        focal, lens = rng.uniform(*config.focal), config.lenses[rng.integers(len(config.lenses))]
        center = np.array([[radius * np.cos(angle), radius * np.sin(angle), height]])
        camera = CameraRig(
            (f"random{view}",),
            intrinsics(focal, config.size)[None],
            _distortion(lens, focal, config.size, rng=rng)[None],
            pose(look_at(center, target), center),
            [config.size],
            [lens is Lens.fisheye],
        )
        faults = find_faults(camera, stage)
        if not faults:
            return camera
    raise ValueError(
        f"rig.random: no place for a camera in {_DRAWS} draws; the last: {faults[0]}. "
        "Widen rig.random.radius and rig.random.height, or take another scene.arena"
    )


def _distortion(lens: Lens, focal: float, size: list[int], *, rng: np.random.Generator) -> np.ndarray:
    """Return (5,) distortion coefficients of a lens.

    Barrel distortion moves the corner of the image inward by at most an eighth, at any focal length.
    """
    strength, left, right = rng.uniform(0.02, 0.12), *rng.normal(0, 5e-4, 2)
    corner = np.hypot(*size) / 2 / focal
    if lens is Lens.radial:
        k1 = -strength / corner**2
        return np.array([k1, 0.15 * k1**2, left, right, 0])
    if lens is Lens.fisheye:
        return np.array([-0.4 * strength, 0.02 * strength, left, right, 0])
    return np.zeros(5)
