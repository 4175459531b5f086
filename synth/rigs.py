"""Which cameras a clip has, where they truly are, and what a calibration in error says of them."""

from dataclasses import dataclass, field, replace
from enum import Enum

import numpy as np
from scipy.spatial.transform import Rotation

from dmae.cameras import CameraRig
from dmae.conventions import Unit, Up
from dmae.formats.calibration import read_calibration
from synth.coverage import Stage, area, check_rig, views_of_cells
from synth.quality import FailedSimulation
from synth.stands import (
    DomeConfig,
    RandomConfig,
    RingConfig,
    check_picture,
    dome,
    facing,
    intrinsics,
    pose,
    ring,
    scatter,
)

_MIDDLE = Stage()


@dataclass(frozen=True)
class CameraConfig:
    """One camera, by the numbers of `dmae.cameras.CameraRig` or by where it stands and what it looks at.

    Attributes:
        name: Unique in its rig.
        size: Image width and height, px.
        K: 9 numbers, row major, px; empty for those that `focal` gives.
        cam_from_world: 12 numbers, [R | t] row major, t in m; empty for those of an upright camera at `position` that
            looks at `target`.
        dist: 5 to 8 OpenCV distortion coefficients; of a fisheye its four, and zeros.
        fisheye: Whether the lens is of OpenCV's fisheye model.
        focal: Focal length, px, of a camera whose axis meets the middle of its image.
        position: x, y, z, m.
        target: x, y, z, m.
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


@dataclass(frozen=True)
class JitterConfig:
    """How far a camera is from where the rig has it: as if somebody held it, still for the length of a clip.

    Drawn anew for each clip and camera, normally distributed, standard deviations. Cameras do not move within a clip.

    Attributes:
        position: Along each axis, m.
        rotation: About each axis, rad.
    """

    position: float = 0.0
    rotation: float = 0.0

    def __post_init__(self):
        _check_deviations("rig.jitter", self)


@dataclass(frozen=True)
class ErrorConfig:
    """How far the calibration that a clip hands on is from the cameras that took it.

    Pictures and labels are those of the true cameras, which the clip keeps as `true_rig`. Drawn anew for each clip and
    camera, normally distributed, standard deviations.

    Attributes:
        focal: Relative, of the focal length (of its logarithm).
        principal_point: Along each axis, px.
        distortion: Of k1, of either lens model.
        rotation: About each axis of the camera, rad.
        translation: Of the camera's centre along each axis, m.
    """

    focal: float = 0.0
    principal_point: float = 0.0
    distortion: float = 0.0
    rotation: float = 0.0
    translation: float = 0.0

    def __post_init__(self):
        _check_deviations("rig.error", self)


class Placement(Enum):
    """How cameras are placed that are neither listed nor read from a file."""

    ring = "ring"
    dome = "dome"
    random = "random"


@dataclass(frozen=True)
class RigConfig:
    """Which cameras there are: those of a file, or else those listed, or else those that are placed.

    Attributes:
        name: For people to read.
        path: Calibration file of any format that `dmae.formats.calibration.read_calibration` reads.
        size: Image width and height, px, for files that hold none.
        unit: What lengths in the file are written in; by default what its format prescribes, like `up` and `inverse`.
        up: Which way is up in the file's world.
        inverse: Whether poses in the file are world_from_cam.
        origin: The point of the file's or the listed cameras' world around which the scene is built, m, z up.
        cameras: Calibrated cameras.
        placement: Which of the following is used where there are none.
        ring, dome, random: The placements.
        jitter: How far the cameras are from there.
        error: How far the calibration is from the cameras.
    """

    name: str = "ring"
    path: str = ""
    size: list[int] = field(default_factory=list)
    unit: Unit | None = None
    up: Up | None = None
    inverse: bool | None = None
    origin: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    cameras: list[CameraConfig] = field(default_factory=list)
    placement: Placement = Placement.ring
    ring: RingConfig = field(default_factory=RingConfig)
    dome: DomeConfig = field(default_factory=DomeConfig)
    random: RandomConfig = field(default_factory=RandomConfig)
    jitter: JitterConfig = field(default_factory=JitterConfig)
    error: ErrorConfig = field(default_factory=ErrorConfig)

    def __post_init__(self):
        if len(self.origin) != 3 or not np.isfinite(self.origin).all():
            raise ValueError(f"rig.origin: expected x, y, z in m, got {list(self.origin)}")
        if self.size and (len(self.size) != 2 or min(self.size) < 1):
            raise ValueError(f"rig.size: expected [width, height], at least 1 px each, got {list(self.size)}")

    @property
    def source(self) -> str:
        """Where the cameras come from, for messages."""
        return f"rig {self.path or self.name!r}"


def _check_deviations(group: str, config) -> None:
    for name, value in vars(config).items():
        if not 0 <= value < np.inf:
            raise ValueError(f"{group}.{name}: expected a standard deviation, 0 or more, got {value}")


def make_rig(config: RigConfig, *, rng: np.random.Generator, stage: Stage = _MIDDLE) -> CameraRig:
    """The cameras of a clip, as they truly are. Rotations are exactly orthonormal.

    Args:
        config: The rig.
        rng: What is random; jitter comes from a child of it, so that it changes nothing else.
        stage: Where people are, and among what. Every camera sees some of it.

    Raises:
        ValueError: numbers are missing or make no camera, or no random cameras see enough; the message names the file
            or rig, the camera and the field.
        FailedSimulation: a camera is under the floor, within a thing of the arena, or sees nobody. Where chance has a
            part, another seed may do better.
    """
    (child,) = rng.spawn(1)
    placed = None if config.path or config.cameras else config.placement
    match placed:
        case None:
            rig = _exact(_read(config) if config.path else _listed(config), config.origin)
        case Placement.ring:
            rig = ring(config.ring, stage, rng=rng)
        case Placement.dome:
            rig = dome(config.dome, stage)
        case Placement.random:
            rig = scatter(config.random, stage, rng=rng)
    if config.jitter != JitterConfig():
        rig = _moved(rig, config.jitter.position, config.jitter.rotation, rng=child)
    _check_names(rig, config.source)
    check_rig(rig, config.source, stage)
    if placed is Placement.random and views_of_cells(rig, stage).min() < config.random.views_at_least:
        raise FailedSimulation(f"{config.source}: rig.jitter turned cameras away from {stage}; lower it")
    return rig


def _check_names(rig: CameraRig, source: str) -> None:
    for name in rig.names:
        if name in ("", ".", "..") or not {"/", "\\", "\0"}.isdisjoint(name):
            raise ValueError(f"{source}, camera {name!r}: its images are called by its name; expected a file's name")


def _read(config: RigConfig) -> CameraRig:
    return read_calibration(
        config.path, size=tuple(config.size) or None, unit=config.unit, up=config.up, inverse=config.inverse
    )


def _listed(config: RigConfig) -> CameraRig:
    parts = [_numbers(camera, f"{config.source}, camera {camera.name!r}") for camera in config.cameras]
    longest = max(len(camera.dist) for camera in config.cameras)
    try:
        return CameraRig(
            tuple(camera.name for camera in config.cameras),
            [K for K, _ in parts],
            [np.pad(camera.dist, (0, longest - len(camera.dist))) for camera in config.cameras],
            [cam_from_world for _, cam_from_world in parts],
            [camera.size for camera in config.cameras],
            [camera.fisheye for camera in config.cameras],
        )
    except ValueError as error:
        raise ValueError(f"{config.source}: {error}") from None


def _numbers(camera: CameraConfig, where: str) -> tuple[np.ndarray, np.ndarray]:
    """K (3, 3) and cam_from_world (4, 4) of a listed camera."""
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
    return K, pose(facing(center, target), center)[0]


def _exact(rig: CameraRig, origin: list[float]) -> CameraRig:
    """Published rotations are rounded; MuJoCo's are quaternions. The nearest rotation, about the same centre, is what
    both can hold.
    """
    rotation = Rotation.from_matrix(rig.cam_from_world[:, :3, :3]).as_matrix()
    return replace(rig, cam_from_world=pose(rotation, rig.centers - origin))


def _moved(rig: CameraRig, position: float, rotation: float, *, rng: np.random.Generator) -> CameraRig:
    """A rig whose centres and directions are off by standard deviations of so many m and rad on each axis."""
    shift, turn = rng.normal(size=(2, len(rig), 3))
    turned = Rotation.from_rotvec(rotation * turn).as_matrix() @ rig.cam_from_world[:, :3, :3]
    return replace(rig, cam_from_world=pose(turned, rig.centers + position * shift))


def miscalibrate(rig: CameraRig, config: ErrorConfig, *, rng: np.random.Generator) -> CameraRig | None:
    """What a calibration says of cameras; None where it is without error."""
    if config == ErrorConfig():
        return None
    reported = _moved(rig, config.translation, config.rotation, rng=rng)
    focal, k1, *point = rng.normal(size=(4, len(rig)))
    K, dist = rig.K.copy(), rig.dist.copy()
    # Exponents keep focal lengths positive.
    K[:, :2, :2] *= np.exp(config.focal * focal)[:, None, None]
    K[:, :2, 2] += config.principal_point * np.transpose(point)
    dist[:, 0] += config.distortion * k1
    return replace(reported, K=K, dist=dist)


def calibration_error(true: CameraRig, reported: CameraRig, stage: Stage) -> list[float]:
    """For each camera, by how many pixels (root mean square) a calibration misplaces what is in the image."""
    points = area(stage).reshape(1, -1, 3)
    xy = true.project(points)[0]
    square = np.where(true.inside(xy), ((reported.project(points)[0] - xy) ** 2).sum(-1), np.nan)
    counted = np.isfinite(square[0])
    return np.sqrt(np.nansum(square[0], 1) / counted.sum(1).clip(1)).round(3).tolist()
