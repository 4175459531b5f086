"""The cameras of a clip: where they stand, how they are jittered, and how wrong their calibration is."""

from dataclasses import dataclass, field
from enum import Enum
from typing import TYPE_CHECKING, Any

import numpy as np

from dmae.data.typed import Configuration
from dmae.formats.config import LengthUnit, UpDirection
from synth.checks import check_pairs, check_range

if TYPE_CHECKING:
    from dmae.data.cameras import CameraRig


def check_image(group: str, focal: float, size: list[int]) -> None:
    """Raise ValueError if these are not a focal length, px, and an image size, px; the message names the field."""
    if not 0 < focal < np.inf:
        raise ValueError(f"{group}.focal: expected more than 0 px, found {focal}")
    if len(size) != 2 or min(size) < 1:
        raise ValueError(f"{group}.size: expected [width, height], at least 1 px each, found {list(size)}")


@dataclass(frozen=True)
class CameraConfig(Configuration):
    """One camera, by its matrices or by its position and target."""

    name: str
    """Name, unique in its rig."""
    size: list[int]
    """Image width and height, px."""
    K: list[Any] = field(default_factory=list)
    """Intrinsic matrix: its three rows, or 9 numbers row by row, px; or give `focal`."""
    cam_from_world: list[Any] = field(default_factory=list)
    """Pose [R | t]: its three rows, or 12 numbers row by row, with or without the row 0 0 0 1, t in m; or give
    `position` and `target`."""
    dist: list[float] = field(default_factory=lambda: [0.0] * 5)
    """OpenCV distortion: 4 to 8 coefficients; for a fisheye its four, and zeros."""
    fisheye: bool = False
    """Whether the lens follows OpenCV's fisheye model."""
    focal: float | None = None
    """Focal length, px; the principal point is the middle of the image."""
    position: list[float] = field(default_factory=list)
    """Centre of an upright camera: x, y, z, m."""
    target: list[float] = field(default_factory=list)
    """Point that the camera looks at: x, y, z, m."""


@dataclass(frozen=True)
class RingConfig(Configuration):
    """Cameras evenly around the vertical through the origin, looking at it; the ring's phase is random."""

    views: int = 5
    """Number of cameras."""
    radius: list[float] = field(default_factory=lambda: [3.5, 4.5])
    """Least and greatest distance of a camera from the vertical, m."""
    height: list[float] = field(default_factory=lambda: [1.0, 2.7])
    """Least and greatest height of a camera, m."""
    target_height: float = 0.9
    """Height of the point that they look at, m."""
    focal: float = 1080.0
    """Focal length, px."""
    size: list[int] = field(default_factory=lambda: [1032, 776])
    """Image width and height, px."""

    def __post_init__(self):
        super().__post_init__()
        check_range("rig.ring", self, 1, np.inf, "views")
        check_pairs("rig.ring", self, 0, np.inf, "radius", "height", above=True)
        check_image("rig.ring", self.focal, self.size)


@dataclass(frozen=True)
class DomeConfig(Configuration):
    """Cameras spread evenly over a band of a sphere, looking at its middle; nothing is random."""

    views: int = 31
    """Number of cameras."""
    radius: float = 3.8
    """Radius of the sphere, m."""
    elevation: list[float] = field(default_factory=lambda: [0.02, 0.9])
    """Least and greatest angle of a camera above the horizontal through the middle, rad."""
    target_height: float = 0.9
    """Height of the middle of the sphere, m."""
    focal: float = 1000.0
    """Focal length, px."""
    size: list[int] = field(default_factory=lambda: [1280, 960])
    """Image width and height, px."""

    def __post_init__(self):
        super().__post_init__()
        check_range("rig.dome", self, 1, np.inf, "views")
        check_range("rig.dome", self, 0, np.inf, "radius", above=True, unit=" m")
        check_pairs("rig.dome", self, 0, np.pi / 2, "elevation", above=True, unit=" rad")
        check_image("rig.dome", self.focal, self.size)


class Lens(Enum):
    """Kind of lens."""

    pinhole = "pinhole"
    """No distortion."""
    radial = "radial"
    """Barrel distortion, radial and a little tangential."""
    fisheye = "fisheye"


@dataclass(frozen=True)
class RandomConfig(Configuration):
    """Cameras anywhere around the middle, such that enough of them see every point of the people's area.

    Pairs are the least and the greatest value that is drawn for each camera.
    """

    views: int = 6
    """Number of cameras."""
    views_at_least: int = 3
    """Number of cameras that have each point in their image, ignoring walls and people: all points within
    `scene.radius` of the middle, from the floor to a height of 2 m."""
    radius: list[float] = field(default_factory=lambda: [3.0, 4.8])
    """Distance of a camera from the vertical through the origin, m."""
    height: list[float] = field(default_factory=lambda: [0.8, 2.8])
    """Height of a camera, m."""
    target_height: list[float] = field(default_factory=lambda: [0.7, 1.2])
    """Height of the point on that vertical that it looks at, m."""
    focal: list[float] = field(default_factory=lambda: [450.0, 1000.0])
    """Focal length, px."""
    lenses: list[Lens] = field(default_factory=lambda: list(Lens))
    """Kinds of lenses that are drawn from."""
    size: list[int] = field(default_factory=lambda: [1032, 776])
    """Image width and height, px."""

    def __post_init__(self):
        super().__post_init__()
        check_range("rig.random", self, 1, np.inf, "views")
        check_pairs("rig.random", self, 0, np.inf, "radius", "height", "target_height", "focal", above=True)
        check_image("rig.random", self.focal[0], self.size)
        if not 0 <= self.views_at_least <= self.views:
            raise ValueError(
                f"rig.random.views_at_least: expected 0 to rig.random.views, which is {self.views}; "
                f"found {self.views_at_least}"
            )
        if not self.lenses:
            raise ValueError(f"rig.random.lenses: expected at least one of {[lens.value for lens in Lens]}")


@dataclass(frozen=True)
class JitterConfig(Configuration):
    """Displacement of the cameras, as if held by hand, constant within a clip.

    Drawn for each clip and camera, normally distributed; the values are standard deviations.
    """

    position: float = 0.0
    """Along each axis, m."""
    rotation: float = 0.0
    """About each axis, rad."""

    def __post_init__(self):
        super().__post_init__()
        check_range("rig.jitter", self, 0, np.inf, *vars(self))


@dataclass(frozen=True)
class MiscalibrationConfig(Configuration):
    """Errors of the calibration that a clip stores as its rig.

    Images and labels come from the true cameras, which the clip stores as `true_rig`. Drawn for each clip and
    camera, normally distributed; the values are standard deviations.
    """

    focal: float = 0.0
    """Relative error of the focal length (of its logarithm)."""
    principal_point: float = 0.0
    """Along each axis, px."""
    distortion: float = 0.0
    """Of k1, for both lens models."""
    rotation: float = 0.0
    """About each axis of the camera, rad."""
    translation: float = 0.0
    """Of the camera's centre along each axis, m."""

    def __post_init__(self):
        super().__post_init__()
        check_range("rig.error", self, 0, np.inf, *vars(self))


class CameraPlacement(Enum):
    """Placement of cameras that are neither listed nor read from a file."""

    ring = "ring"
    dome = "dome"
    random = "random"


@dataclass(frozen=True)
class RigConfig(Configuration):
    """The cameras of a clip: read from a file, otherwise listed, otherwise placed."""

    name: str = "ring"
    """Descriptive name of the rig."""
    path: str = field(default="", metadata={"reads": "path"})
    """Calibration file of any format of `dmae.formats.calibrations`, or a clip with these cameras."""
    size: list[int] = field(default_factory=list)
    """Image width and height, px, for files that do not state them."""
    unit: LengthUnit | None = None
    """Unit of lengths in the file; by default as in its format, like `up` and `inverse`."""
    up: UpDirection | None = None
    """Up direction of the file's world."""
    inverse: bool | None = None
    """Whether poses in the file are world_from_cam."""
    origin: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    """Point of the file's or the listed cameras' world around which the scene is built, m, z up."""
    cameras: list[CameraConfig] = field(default_factory=list)
    """Listed cameras, each as `{name: left, size: [640, 480], focal: 500, position: [3, 2, 2], target: [0, 0, 1]}`; or
    with `K`, `dist` and `fisheye` instead of `focal`, and `cam_from_world` instead of `position` and `target`."""
    placement: CameraPlacement = CameraPlacement.ring
    """Placement that is used without a file or listed cameras."""
    ring: RingConfig = field(default_factory=RingConfig)
    """Cameras evenly around the middle."""
    dome: DomeConfig = field(default_factory=DomeConfig)
    """Cameras evenly on a band of a sphere."""
    random: RandomConfig = field(default_factory=RandomConfig)
    """Cameras at random places with random lenses."""
    jitter: JitterConfig = field(default_factory=JitterConfig)
    """Displacement of the true cameras."""
    error: MiscalibrationConfig = field(default_factory=MiscalibrationConfig)
    """Errors of the calibration."""

    def __post_init__(self):
        super().__post_init__()
        if len(self.origin) != 3 or not np.isfinite(self.origin).all():
            raise ValueError(f"rig.origin: expected x, y, z in m, found {list(self.origin)}")
        if self.size and (len(self.size) != 2 or min(self.size) < 1):
            raise ValueError(f"rig.size: expected [width, height], at least 1 px each, found {list(self.size)}")

        if self.path or self.cameras:
            for kind, usual in (("ring", RingConfig()), ("dome", DomeConfig()), ("random", RandomConfig())):
                if getattr(self, kind) != usual:
                    given = "rig.path is given" if self.path else f"rig={self.name} lists its cameras"
                    raise ValueError(f"rig.{kind}: has no effect, as {given}; choose rig={kind} instead")

    @property
    def source(self) -> str:
        """Name of the rig or its file, for messages."""
        return f"rig {self.path or self.name!r}"


NO_RIG = RigConfig(name="")
"""The default of commands that need no rig."""


def listed_rig(rig: "CameraRig") -> RigConfig:
    """Return the configuration that lists the cameras of a rig."""
    cameras = [
        CameraConfig(
            name, size.tolist(), K.ravel().tolist(), pose[:3].ravel().tolist(), dist.tolist(), fisheye=bool(fisheye)
        )
        for name, size, K, pose, dist, fisheye in zip(
            rig.names, rig.size, rig.K, rig.cam_from_world, rig.dist, rig.fisheye, strict=True
        )
    ]
    return RigConfig(name="listed", cameras=cameras)
