"""Cameras at random places with random lenses. Enough of them see every point of the people's area."""

from dataclasses import dataclass, field
from enum import Enum

import numpy as np

from dmae.data.cameras import CameraRig
from synth.rigs.camera_geometry import check_pairs, check_picture, check_views, intrinsics, look_at, pose
from synth.rigs.coverage import Stage, find_faults, views_of_cells
from synth.rigs.lenses import joined

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
