"""The cameras of a clip: read from a file, listed, or placed; jittered, and miscalibrated."""

from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from dmae.data.cameras import CameraRig
from dmae.formats.calibrations import LacksSize, read_calibration
from dmae.formats.config import LengthUnit
from dmae.formats.rig import listed_cameras
from synth.errors import FailedSimulation
from synth.rigs.config import CameraPlacement, JitterConfig, MiscalibrationConfig, RigConfig
from synth.rigs.coverage import Stage, TinyPeople, area, check_rig, shows_people, views_of_cells
from synth.rigs.placement import dome, pose, ring, scatter


def displace(rig: CameraRig, position: float, rotation: float, *, rng: np.random.Generator) -> CameraRig:
    """Return the rig with each camera moved and turned at random, normally distributed, with standard deviations along
    each axis, m, and about each axis, rad."""
    shift, turn = rng.normal(size=(2, len(rig), 3))
    turned = Rotation.from_rotvec(rotation * turn).as_matrix() @ rig.cam_from_world[:, :3, :3]
    return replace(rig, cam_from_world=pose(turned, rig.centers + position * shift))


def miscalibrate(rig: CameraRig, config: MiscalibrationConfig, *, rng: np.random.Generator) -> CameraRig | None:
    """Return a random calibration of a rig; None if all errors are 0."""
    if config == MiscalibrationConfig():
        return None
    reported = displace(rig, config.translation, config.rotation, rng=rng)
    focal, k1, *point = rng.normal(size=(4, len(rig)))
    K, dist = rig.K.copy(), rig.dist.copy()
    # The exponential keeps focal lengths positive.
    K[:, :2, :2] *= np.exp(config.focal * focal)[:, None, None]
    K[:, :2, 2] += config.principal_point * np.transpose(point)
    dist[:, 0] += config.distortion * k1
    return replace(reported, K=K, dist=dist)


def calibration_error(true: CameraRig, reported: CameraRig, stage: Stage) -> list[float]:
    """Return the root mean square reprojection error of each camera over the people's area, px."""
    points = area(stage).reshape(1, -1, 3)
    xy = true.project(points)[0]
    square = np.where(true.inside(xy), ((reported.project(points)[0] - xy) ** 2).sum(-1), np.nan)
    counted = np.isfinite(square[0])
    return np.sqrt(np.nansum(square[0], 1) / counted.sum(1).clip(1)).round(3).tolist()


_MIDDLE = Stage()


def make_rig(config: RigConfig, *, rng: np.random.Generator, stage: Stage = _MIDDLE) -> CameraRig:
    """Make the true cameras of a clip. Rotations are exactly orthonormal. Every camera sees some of the people's area.

    Jitter is drawn from a child stream, so it changes no other draw.

    Raises:
        ValueError: numbers are missing or do not define a camera, or no random cameras see enough; the message names
            the file or rig, the camera and the field.
        FailedSimulation: a camera is under the floor, inside an object of the room, or sees no people. Another seed may
            help if the placement is random.
    """
    (child,) = rng.spawn(1)
    given = config.path or config.cameras
    random = not given and config.placement is CameraPlacement.random
    if given:
        cameras = [vars(camera) for camera in config.cameras]
        rig = _about_origin(_read(config) if config.path else listed_cameras(cameras, config.source), config)
    elif random:
        rig = scatter(config.random, stage, rng=rng)
    elif config.placement is CameraPlacement.dome:
        rig = dome(config.dome, stage)
    else:
        rig = ring(config.ring, stage, rng=rng)
    if config.jitter != JitterConfig():
        rig = displace(rig, config.jitter.position, config.jitter.rotation, rng=child)
    for name in rig.names:
        if name in ("", ".", "..") or not {"/", "\\", "\0"}.isdisjoint(name):
            raise ValueError(
                f"{config.source}, camera {name!r}: its images are called by its name; expected a file's name"
            )
    try:
        check_rig(rig, config.source, stage, origin=config.origin if given else None)
    except TinyPeople as error:
        raise ValueError(f"{error}{_other_unit(config) if config.path else ''}") from None
    if random and views_of_cells(rig, stage).min() < config.random.views_at_least:
        raise FailedSimulation(f"{config.source}: rig.jitter turned cameras away from {stage}; lower it")
    return rig


def _about_origin(rig: CameraRig, config: RigConfig) -> CameraRig:
    # Published rotations are rounded, and MuJoCo stores quaternions: take the nearest exact ones.
    rotation = Rotation.from_matrix(rig.cam_from_world[:, :3, :3]).as_matrix()
    return replace(rig, cam_from_world=pose(rotation, rig.centers - config.origin))


def _other_unit(config: RigConfig) -> str:
    """Return what to say of the unit of a file in which people are tiny."""
    for unit in (LengthUnit.cm, LengthUnit.mm):
        with suppress(ValueError):  # a clip states its own unit
            if shows_people(_about_origin(_read(replace(config, unit=unit)), config)):
                return f", and with rig.unit={unit} people have a usual size"
    return ", and rig.unit=cm or rig.unit=mm states another unit of a file"


def _read(config: RigConfig) -> CameraRig:
    size: Any = tuple(config.size) or None
    try:
        return read_calibration(Path(config.path), size=size, unit=config.unit, up=config.up, inverse=config.inverse)
    except LacksSize as error:
        raise LacksSize(error.what, "rig.size") from None
