"""Cameras in a ring and on a dome."""

from dataclasses import dataclass, field, replace

import numpy as np

from dmae.data.cameras import CameraRig
from synth.rigs.camera_geometry import check_pairs, check_picture, check_views, intrinsics, look_at, pose
from synth.rigs.coverage import Stage, find_faults

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
