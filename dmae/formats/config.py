"""The recording to read, and the conventions of its calibration: unit, up axis and direction of extrinsics.

Commands list these options in their help, so this module imports nothing heavy.
"""

from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import TYPE_CHECKING

import numpy as np

from dmae.data.typed import REQUIRED, Configuration
from dmae.formats.registry import reader

if TYPE_CHECKING:
    from dmae.data.cameras import CameraRig


class UpDirection(StrEnum):
    """The axis of a world that points up."""

    x = "x"
    y = "y"
    z = "z"
    minus_y = "minus_y"
    """y points down, as in CMU Panoptic."""
    minus_z = "minus_z"


class LengthUnit(StrEnum):
    """Unit of lengths."""

    m = "m"
    cm = "cm"
    mm = "mm"


METRES = {LengthUnit.m: 1.0, LengthUnit.cm: 0.01, LengthUnit.mm: 0.001}

# Right-handed rotations from each up axis to z up, by the smallest angle.
_Z_UP = {
    UpDirection.x: np.array([[0, 0, -1], [0, 1, 0], [1, 0, 0.0]]),
    UpDirection.y: np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0.0]]),
    UpDirection.z: np.eye(3),
    UpDirection.minus_y: np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0.0]]),
    UpDirection.minus_z: np.array([[1, 0, 0], [0, -1, 0], [0, 0, -1.0]]),
}


@dataclass(frozen=True)
class Convention:
    """The convention of a file for lengths, world axes and extrinsics. The default is our convention."""

    unit: LengthUnit = LengthUnit.m  # Unit of lengths
    up: UpDirection = UpDirection.z  # Axis of the world that points up
    inverse: bool = False  # Whether extrinsics are world_from_cam instead of cam_from_world

    def changed(
        self, unit: LengthUnit | None = None, up: UpDirection | None = None, inverse: bool | None = None
    ) -> "Convention":
        """Return the convention with the values that are given."""
        given: dict = {"unit": unit, "up": up, "inverse": inverse}
        return replace(self, **{name: value for name, value in given.items() if value is not None})

    def points(self, xyz: np.ndarray) -> np.ndarray:
        """Return points (..., 3), given in the convention of the file, in our world, m."""
        return METRES[self.unit] * np.asarray(xyz, np.float64) @ _Z_UP[self.up].T

    def written_points(self, xyz: np.ndarray) -> np.ndarray:
        """Return points (..., 3), given in our world, m, in the convention of the file: the inverse of `points`."""
        return np.asarray(xyz, np.float64) @ _Z_UP[self.up] / METRES[self.unit]

    def rig(self, written: "CameraRig") -> "CameraRig":
        """Return cameras, with `cam_from_world` given in the convention of the file, in our convention."""
        pose = np.linalg.inv(written.cam_from_world) if self.inverse else written.cam_from_world.copy()
        pose[:, :3, :3] = pose[:, :3, :3] @ _Z_UP[self.up].T
        pose[:, :3, 3] *= METRES[self.unit]
        return replace(written, cam_from_world=pose)

    def written_rig(self, rig: "CameraRig") -> "CameraRig":
        """Return cameras, given in our convention, in the convention of the file: the inverse of `rig`."""
        pose = rig.cam_from_world.copy()
        pose[:, :3, :3] = pose[:, :3, :3] @ _Z_UP[self.up]
        pose[:, :3, 3] /= METRES[self.unit]
        return replace(rig, cam_from_world=np.linalg.inv(pose) if self.inverse else pose)


OURS = Convention()
"""Metres, z up, cam_from_world."""


@dataclass(frozen=True)
class DataConfig(Configuration):
    """The recording, clip or data set to read."""

    name: str | None = field(default=None, metadata={"choices": reader})
    """Format; by default recognised by the files in `path`."""
    path: str = field(default=REQUIRED, metadata={"reads": "path"})
    """Folder of the recording, of a clip, or of a data set of clips."""
    cameras: list[int | str] | None = None
    """Names of the cameras to use; by default all."""
    frames: list[int] | None = None
    """First frame to use, and the one after the last; by default all."""
    calibration: str | None = field(default=None, metadata={"reads": "path"})
    """Calibration file, a folder with one, or a clip with these cameras; by default the one found in `path`, or the
    cameras that a clip contains."""
    detections: str | None = field(default=None, metadata={"reads": "path"})
    """Folder of the detections, or file of COCO's; by default found in `path`."""
    videos: str | None = field(default=None, metadata={"reads": "path"})
    """Folder of the videos that people were detected in, <camera>.mp4: backgrounds of reports and figures."""
    images: str | None = field(default=None, metadata={"reads": "path"})
    """Folder of the images that people were detected in, a folder of PNG or JPEG files for each camera."""
    truth: str | None = field(default=None, metadata={"reads": "poses"})
    """True poses to score with: a file that `dmae.read_poses` reads (.csv, .npz, .trc, ...), or a folder with one for
    each clip, named as the clip's folder."""
    fps: float | None = None
    """1/s; frame rate, if the files do not state it."""
    size: list[int] | None = None
    """px; image width and height, if the files do not state them."""
    skeleton: str | None = field(default=None, metadata={"reads": "skeleton"})
    """Skeleton of the detections, if the files do not state it or are wrong."""
    unit: LengthUnit | None = None
    """Unit of lengths in the calibration; by default that of its format."""
    up: UpDirection | None = None
    """Axis that points up in the calibration; by default that of its format."""
    inverse: bool | None = None
    """Whether extrinsics of the calibration are world_from_cam; by default as in its format."""
    offsets: list[int | str] | None = None
    """Frames by which cameras started late: a number for each, in the order of the calibration, or [name:frames] for
    some. Frame k of a camera is frame k + offset."""


def clip_range(total: int, first: int, clips: int | None) -> range:
    """Return the numbers that `first=` and `clips=` choose from `total` clips; ValueError if there are none."""
    if not 0 <= first < max(total, 1):
        raise ValueError(f"first={first}: expected the number of a clip, from 0 to {total - 1}")
    if clips is not None and not 1 <= clips <= total - first:
        raise ValueError(f"clips={clips}: expected from 1 to {total - first}, there are {total} clips")
    return range(first, total if clips is None else first + clips)
