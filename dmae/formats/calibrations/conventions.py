"""Conventions of calibration files: unit, up axis and direction of extrinsics, and conversion to our convention."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum
from typing import TYPE_CHECKING

import numpy as np

# The help of commands lists units and axes, and must not import heavy modules.
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
    """The convention of a file for lengths, world axes and extrinsics. The default is our convention.

    Attributes:
        unit: Unit of lengths.
        up: Axis of the world that points up.
        inverse: Whether extrinsics are world_from_cam instead of cam_from_world.
    """

    unit: LengthUnit = LengthUnit.m
    up: UpDirection = UpDirection.z
    inverse: bool = False

    def points(self, xyz: np.ndarray) -> np.ndarray:
        """Return points (..., 3), given in the convention of the file, in our world, m."""
        return METRES[self.unit] * np.asarray(xyz, np.float64) @ _Z_UP[self.up].T

    def written_points(self, xyz: np.ndarray) -> np.ndarray:
        """Return points (..., 3), given in our world, m, in the convention of the file: the inverse of `points`."""
        return np.asarray(xyz, np.float64) @ _Z_UP[self.up] / METRES[self.unit]

    def rig(self, written: CameraRig) -> CameraRig:
        """Return cameras, with `cam_from_world` given in the convention of the file, in our convention."""
        pose = np.linalg.inv(written.cam_from_world) if self.inverse else written.cam_from_world.copy()
        pose[:, :3, :3] = pose[:, :3, :3] @ _Z_UP[self.up].T
        pose[:, :3, 3] *= METRES[self.unit]
        return replace(written, cam_from_world=pose)

    def written_rig(self, rig: CameraRig) -> CameraRig:
        """Return cameras, given in our convention, in the convention of the file: the inverse of `rig`."""
        pose = rig.cam_from_world.copy()
        pose[:, :3, :3] = pose[:, :3, :3] @ _Z_UP[self.up]
        pose[:, :3, 3] /= METRES[self.unit]
        return replace(rig, cam_from_world=np.linalg.inv(pose) if self.inverse else pose)


OURS = Convention()
"""Metres, z up, cam_from_world."""
