"""Where cameras stand: in a ring, on a dome, or at random."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dmae.data.cameras import CameraRig
from dmae.formats.rig import intrinsics, look_at
from synth.rigs.config import DomeConfig, Lens, RandomConfig, RingConfig
from synth.rigs.coverage import Stage, find_faults, views_of_cells
from synth.rigs.lenses import joined


def pose(rotation: np.ndarray, centers: np.ndarray) -> np.ndarray:
    """Return (V, 4, 4) cam_from_world of cameras with (V, 3, 3) rotations cam_from_world and (V, 3) centres, m."""
    matrix = np.tile(np.eye(4), (len(rotation), 1, 1))
    matrix[:, :3, :3] = rotation
    matrix[:, :3, 3] = -np.einsum("vij,vj->vi", rotation, centers)
    return matrix


def aimed(
    names: Sequence[str], K: np.ndarray, centers: np.ndarray, target: np.ndarray, size: Sequence[int]
) -> CameraRig:
    """Return upright pinhole cameras of one image size, px, at centres (V, 3) that look at (3,) or (V, 3), m.

    `K` is (3, 3) for all or (V, 3, 3), px.
    """
    views = len(centers)
    return CameraRig(
        tuple(names),
        np.tile(K, (views, 1, 1)) if np.ndim(K) == 2 else K,
        np.zeros((views, 5)),
        pose(look_at(centers, target), centers),
        np.tile(size, (views, 1)),
    )


# A ring, and a dome

_DISTANCE_FRACTIONS = np.linspace(0.95, 0.5, 10)
"""Fractions of the distance to the target that are tried if a camera is at an impossible place."""


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
    target, names = np.array([0, 0, config.target_height]), [f"{name}{view}" for view in range(len(centers))]
    rig = aimed(names, intrinsics(config.focal, config.size), centers, target, config.size)
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


def scatter(config: RandomConfig, stage: Stage, *, rng: np.random.Generator) -> CameraRig:
    """Return random cameras at possible places that together see enough of the people's area.

    Raises ValueError if no such cameras were found; the message says what to change.
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
            np.array([config.size]),
            np.array([lens is Lens.fisheye]),
        )
        faults = find_faults(camera, stage)
        if not faults:
            return camera
    raise ValueError(
        f"rig.random: no place for a camera in {_DRAWS} draws; the last: {faults[0]}. "
        "Widen rig.random.radius and rig.random.height, or take another scene.arena"
    )


def _distortion(lens: Lens, focal: float, size: list[int], *, rng: np.random.Generator) -> np.ndarray:
    """Return (5,) distortion of a lens. Barrel distortion moves the corner inward by an eighth or less."""
    strength, left, right = rng.uniform(0.02, 0.12), *rng.normal(0, 5e-4, 2)
    corner = np.hypot(*size) / 2 / focal
    if lens is Lens.radial:
        k1 = -strength / corner**2
        return np.array([k1, 0.15 * k1**2, left, right, 0])
    if lens is Lens.fisheye:
        return np.array([-0.4 * strength, 0.02 * strength, left, right, 0])
    return np.zeros(5)
