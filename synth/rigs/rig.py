"""The cameras of a clip: read from a file, listed, or placed."""

from dataclasses import dataclass, field, replace
from enum import Enum

import numpy as np
from scipy.spatial.transform import Rotation

from dmae.data.cameras import CameraRig
from dmae.formats.calibrations import LacksSize, read_calibration
from dmae.formats.config import LengthUnit, UpDirection
from synth.errors import FailedSimulation
from synth.rigs.camera_geometry import pose
from synth.rigs.coverage import Stage, check_rig, views_of_cells
from synth.rigs.jitter import JitterConfig, jitter
from synth.rigs.listed_cameras import CameraConfig, listed_cameras
from synth.rigs.miscalibration import MiscalibrationConfig
from synth.rigs.placement import DomeConfig, RingConfig, dome, ring
from synth.rigs.random_placement import RandomConfig, scatter

_MIDDLE = Stage()


class CameraPlacement(Enum):
    """Placement of cameras that are neither listed nor read from a file."""

    ring = "ring"
    dome = "dome"
    random = "random"


@dataclass(frozen=True)
class RigConfig:
    """The cameras of a clip: those of a file, otherwise listed cameras, otherwise placed cameras.

    Attributes:
        name: Descriptive name of the rig.
        path: Calibration file of any format of `dmae.formats.calibrations`.
        size: Image width and height, px, for files that do not state them.
        unit: Unit of lengths in the file; by default that of its format, like `up` and `inverse`.
        up: Up direction of the file's world.
        inverse: Whether poses in the file are world_from_cam.
        origin: Point of the file's or the listed cameras' world around which the scene is built, m, z up.
        cameras: Listed cameras.
        placement: Placement that is used without a file or listed cameras.
        ring: Cameras evenly around the middle.
        dome: Cameras evenly on a band of a sphere.
        random: Cameras at random places with random lenses.
        jitter: Displacement of the true cameras.
        error: Errors of the calibration.
    """

    name: str = "ring"
    path: str = ""
    size: list[int] = field(default_factory=list)
    unit: LengthUnit | None = None
    up: UpDirection | None = None
    inverse: bool | None = None
    origin: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    cameras: list[CameraConfig] = field(default_factory=list)
    placement: CameraPlacement = CameraPlacement.ring
    ring: RingConfig = field(default_factory=RingConfig)
    dome: DomeConfig = field(default_factory=DomeConfig)
    random: RandomConfig = field(default_factory=RandomConfig)
    jitter: JitterConfig = field(default_factory=JitterConfig)
    error: MiscalibrationConfig = field(default_factory=MiscalibrationConfig)

    def __post_init__(self):
        if len(self.origin) != 3 or not np.isfinite(self.origin).all():
            raise ValueError(f"rig.origin: expected x, y, z in m, got {list(self.origin)}")
        if self.size and (len(self.size) != 2 or min(self.size) < 1):
            raise ValueError(f"rig.size: expected [width, height], at least 1 px each, got {list(self.size)}")

    @property
    def source(self) -> str:
        """Name of the rig or its file, for messages."""
        return f"rig {self.path or self.name!r}"


def make_rig(config: RigConfig, *, rng: np.random.Generator, stage: Stage = _MIDDLE) -> CameraRig:
    """Make the true cameras of a clip. Rotations are exactly orthonormal.

    Args:
        config: The rig.
        rng: Draws placements. Jitter is drawn from a child stream, so it changes no other draw.
        stage: The people's area and the room. Every camera sees some of the area.

    Raises:
        ValueError: numbers are missing or do not define a camera, or no random cameras see enough; the message names
            the file or rig, the camera and the field.
        FailedSimulation: a camera is under the floor, inside an object of the room, or sees no people. Another seed may
            help if the placement is random.
    """
    (child,) = rng.spawn(1)
    if config.path or config.cameras:
        rig = _exact(_read(config) if config.path else listed_cameras(config.cameras, config.source), config.origin)
        return _checked(jitter(rig, config.jitter, rng=child), config, stage, origin=config.origin)
    match config.placement:
        case CameraPlacement.ring:
            rig = ring(config.ring, stage, rng=rng)
        case CameraPlacement.dome:
            rig = dome(config.dome, stage)
        case CameraPlacement.random:
            rig = scatter(config.random, stage, rng=rng)
    rig = _checked(jitter(rig, config.jitter, rng=child), config, stage)
    random = config.placement is CameraPlacement.random
    if random and views_of_cells(rig, stage).min() < config.random.views_at_least:
        raise FailedSimulation(f"{config.source}: rig.jitter turned cameras away from {stage}; lower it")
    return rig


def _read(config: RigConfig) -> CameraRig:
    try:
        return read_calibration(
            config.path, size=tuple(config.size) or None, unit=config.unit, up=config.up, inverse=config.inverse
        )
    except LacksSize as error:
        raise LacksSize(error.what, "rig.size") from None


def _exact(rig: CameraRig, origin: list[float]) -> CameraRig:
    """Return the rig with the nearest exact rotations about the same centres, and with centres relative to `origin`, m.

    Published rotations are rounded, and MuJoCo stores quaternions.
    """
    rotation = Rotation.from_matrix(rig.cam_from_world[:, :3, :3]).as_matrix()
    return replace(rig, cam_from_world=pose(rotation, rig.centers - origin))


def _checked(rig: CameraRig, config: RigConfig, stage: Stage, origin: list[float] | None = None) -> CameraRig:
    """Return the rig if its names are valid file names and every camera sees people; otherwise raise an error."""
    for name in rig.names:
        if name in ("", ".", "..") or not {"/", "\\", "\0"}.isdisjoint(name):
            raise ValueError(
                f"{config.source}, camera {name!r}: its images are called by its name; expected a file's name"
            )
    check_rig(rig, config.source, stage, origin=origin)
    return rig
