"""Where cameras stand that nobody measured: in a ring, on a dome, or anywhere from where enough is seen."""

from dataclasses import dataclass, field, replace
from enum import Enum

import numpy as np

from dmae.cameras import CameraRig
from synth.coverage import Stage, find_faults, views_of_cells
from synth.lens import joined

_NEARER = np.linspace(0.95, 0.5, 10)
_DRAWS = 1000


def _check_pairs(group: str, config, names: tuple[str, ...]) -> None:
    for name in names:
        pair = getattr(config, name)
        if len(pair) != 2 or not 0 < pair[0] <= pair[1] < np.inf:
            raise ValueError(f"{group}.{name}: expected [least, greatest], more than 0, got {list(pair)}")


def _check_views(group: str, views: int) -> None:
    if views < 1:
        raise ValueError(f"{group}.views: expected at least one camera, found {views}")


@dataclass(frozen=True)
class RingConfig:
    """Cameras evenly around the vertical through the origin, looking at it; the ring's phase is random.

    Attributes:
        views: How many.
        radius: Least and greatest distance of a camera from the vertical, m.
        height: Least and greatest height of a camera, m.
        target_height: Height of the point they look at, m.
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
        _check_views("rig.ring", self.views)
        _check_pairs("rig.ring", self, ("radius", "height"))
        check_picture("rig.ring", self.focal, self.size)


@dataclass(frozen=True)
class DomeConfig:
    """Cameras spread evenly over a band of a sphere, looking at its middle; nothing is random.

    Attributes:
        views: How many.
        radius: Of the sphere, m.
        elevation: Least and greatest angle of a camera above the horizontal through the middle, rad.
        target_height: Height of the middle, m.
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
        _check_views("rig.dome", self.views)
        _check_pairs("rig.dome", self, ("elevation",))
        if not 0 < self.radius < np.inf:
            raise ValueError(f"rig.dome.radius: expected more than 0 m, got {self.radius}")
        if self.elevation[1] > np.pi / 2:
            raise ValueError(f"rig.dome.elevation: expected at most a right angle, in rad, got {list(self.elevation)}")
        check_picture("rig.dome", self.focal, self.size)


class Lens(Enum):
    """What bends the image."""

    pinhole = "pinhole"
    """Nothing."""
    radial = "radial"
    """Barrel distortion, radial and a little tangential."""
    fisheye = "fisheye"


@dataclass(frozen=True)
class RandomConfig:
    """Cameras anywhere around the middle, such that enough of them see every point of the people's area.

    Pairs are the least and the greatest of what is drawn for each camera.

    Attributes:
        views: How many.
        views_at_least: How many cameras have each point in their image, walls and people apart: wherever people are
            within `scene.radius` of the middle, from the floor to a height of 2 m.
        radius: Distance from the vertical through the origin, m.
        height: Of the camera, m.
        target_height: Height of the point on that vertical that it looks at, m.
        focal: Focal length, px.
        lenses: Of which kinds lenses are.
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
        _check_views("rig.random", self.views)
        _check_pairs("rig.random", self, ("radius", "height", "target_height", "focal"))
        check_picture("rig.random", self.focal[0], self.size)
        if not 0 <= self.views_at_least <= self.views:
            raise ValueError(
                f"rig.random.views_at_least: expected 0 to rig.random.views, which is {self.views}; "
                f"got {self.views_at_least}"
            )
        if not self.lenses:
            raise ValueError(f"rig.random.lenses: expected at least one of {[lens.value for lens in Lens]}")


def check_picture(group: str, focal: float, size: list[int]) -> None:
    """Raises ValueError, naming the field, unless these are a focal length and an image size."""
    if not 0 < focal < np.inf:
        raise ValueError(f"{group}.focal: expected more than 0 px, got {focal}")
    if len(size) != 2 or min(size) < 1:
        raise ValueError(f"{group}.size: expected [width, height], at least 1 px each, got {list(size)}")


def ring(config: RingConfig, stage: Stage, *, rng: np.random.Generator) -> CameraRig:
    """The cameras of a ring; those that cannot stand where they should are brought nearer to what they look at."""
    angle = 2 * np.pi * (np.arange(config.views) + rng.uniform()) / config.views
    radius = rng.uniform(*config.radius, config.views)
    height = rng.uniform(*config.height, config.views)
    centers = np.stack([radius * np.cos(angle), radius * np.sin(angle), height], -1)
    return _around("ring", config, centers, stage)


def dome(config: DomeConfig, stage: Stage) -> CameraRig:
    """The cameras of a dome, by the golden angle; brought nearer where they cannot stand, as those of a ring."""
    low, high = np.sin(config.elevation)
    # Equal steps of height are equal areas of a sphere.
    up = low + (np.arange(config.views) + 0.5) / config.views * (high - low)
    angle = np.pi * (3 - np.sqrt(5)) * np.arange(config.views)
    flat = np.sqrt(1 - up**2)
    directions = np.stack([flat * np.cos(angle), flat * np.sin(angle), up], -1)
    return _around("dome", config, config.radius * directions + [0, 0, config.target_height], stage)


def _around(name: str, config: RingConfig | DomeConfig, centers: np.ndarray, stage: Stage) -> CameraRig:
    """Pinhole cameras that look at a point from (V, 3) centres."""
    target, views = np.array([0, 0, config.target_height]), len(centers)
    rig = CameraRig(
        tuple(f"{name}{view}" for view in range(views)),
        np.tile(intrinsics(config.focal, config.size), (views, 1, 1)),
        np.zeros((views, 5)),
        pose(facing(centers, target), centers),
        np.tile(config.size, (views, 1)),
    )
    for view in find_faults(rig, stage):
        for share in _NEARER:
            centers[view] = target + share * (centers[view] - target)
            rig = replace(rig, cam_from_world=pose(rig.cam_from_world[:, :3, :3], centers))
            if not find_faults(rig[view : view + 1], stage):
                break
    return rig


def scatter(config: RandomConfig, stage: Stage, *, rng: np.random.Generator) -> CameraRig:
    """Random cameras that stand where cameras can and see what they must.

    Raises:
        ValueError: none were found; the message says what to change.
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
        f"rig.random: in {_DRAWS} draws no {config.views} cameras were found of which {config.views_at_least} see "
        f"every point of {stage}: {(missing > 0).mean():.0%} of it was left to fewer. Lower rig.random.views_at_least, "
        "rig.random.focal or scene.radius, or raise rig.random.views or rig.random.radius"
    )


def _missing(counts: list[np.ndarray], least: int) -> np.ndarray:
    """By how many cameras each cell falls short."""
    return np.maximum(0, least - np.sum(counts, axis=0))


def _draw(config: RandomConfig, view: int, stage: Stage, *, rng: np.random.Generator) -> CameraRig:
    """One camera that stands where it can; as many numbers are drawn whatever the lens."""
    for _ in range(_DRAWS):
        angle, radius, height = rng.uniform(-np.pi, np.pi), rng.uniform(*config.radius), rng.uniform(*config.height)
        target = np.array([0, 0, rng.uniform(*config.target_height)])
        focal, lens = rng.uniform(*config.focal), config.lenses[rng.integers(len(config.lenses))]
        center = np.array([[radius * np.cos(angle), radius * np.sin(angle), height]])
        camera = CameraRig(
            (f"random{view}",),
            intrinsics(focal, config.size)[None],
            _distortion(lens, focal, config.size, rng=rng)[None],
            pose(facing(center, target), center),
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
    """(5,) coefficients of a lens. Barrels pull the image's corner in by up to an eighth, whatever the focal length."""
    strength, left, right = rng.uniform(0.02, 0.12), *rng.normal(0, 5e-4, 2)
    corner = np.hypot(*size) / 2 / focal
    if lens is Lens.radial:
        k1 = -strength / corner**2
        return np.array([k1, 0.15 * k1**2, left, right, 0])
    if lens is Lens.fisheye:
        return np.array([-0.4 * strength, 0.02 * strength, left, right, 0])
    return np.zeros(5)


def intrinsics(focal: float, size: list[int]) -> np.ndarray:
    """(3, 3) K of a camera whose axis meets the middle of its image, px."""
    width, rows = size
    return np.array([[focal, 0, (width - 1) / 2], [0, focal, (rows - 1) / 2], [0, 0, 1]])


def facing(centers: np.ndarray, target: np.ndarray) -> np.ndarray:
    """(V, 3, 3) rotations from the world to cameras at (V, 3) centres that look at (3,) or (V, 3) targets, upright."""
    forward = target - centers
    forward /= np.linalg.norm(forward, axis=-1, keepdims=True)
    right = np.cross(forward, [0, 0, 1])
    # Who looks straight up or down has the world's x on the right.
    right[np.linalg.norm(right, axis=-1) < 1e-9] = (1, 0, 0)
    right /= np.linalg.norm(right, axis=-1, keepdims=True)
    return np.stack([right, np.cross(forward, right), forward], 1)


def pose(rotation: np.ndarray, centers: np.ndarray) -> np.ndarray:
    """(V, 4, 4) cam_from_world of cameras at (V, 3) centres."""
    matrix = np.tile(np.eye(4), (len(rotation), 1, 1))
    matrix[:, :3, :3] = rotation
    matrix[:, :3, 3] = -np.einsum("vij,vj->vi", rotation, centers)
    return matrix
