"""How a foreign file's world and cameras differ from ours, and the way across."""

from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from dmae.cameras import CameraRig


class Up(StrEnum):
    """Which way is up in a world."""

    x = "x"
    y = "y"
    z = "z"
    minus_y = "minus_y"
    """y points down, as in CMU Panoptic."""
    minus_z = "minus_z"


class Unit(StrEnum):
    """What lengths are written in."""

    m = "m"
    cm = "cm"
    mm = "mm"


METRES = {Unit.m: 1.0, Unit.cm: 0.01, Unit.mm: 0.001}

# Right-handed, the least turn that does it.
_Z_UP = {
    Up.x: np.array([[0, 0, -1], [0, 1, 0], [1, 0, 0.0]]),
    Up.y: np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0.0]]),
    Up.z: np.eye(3),
    Up.minus_y: np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0.0]]),
    Up.minus_z: np.array([[1, 0, 0], [0, -1, 0], [0, 0, -1.0]]),
}


@dataclass(frozen=True)
class Convention:
    """How a file writes its world and its extrinsics; ours is the default.

    Attributes:
        unit: Of lengths.
        up: Of the world.
        inverse: Extrinsics are world_from_cam instead of cam_from_world.
    """

    unit: Unit = Unit.m
    up: Up = Up.z
    inverse: bool = False

    def points(self, xyz: np.ndarray) -> np.ndarray:
        """Points (..., 3) as the file writes them, in our world, m."""
        return METRES[self.unit] * np.asarray(xyz, np.float64) @ _Z_UP[self.up].T

    def written_points(self, xyz: np.ndarray) -> np.ndarray:
        """The inverse of `points`."""
        return np.asarray(xyz, np.float64) @ _Z_UP[self.up] / METRES[self.unit]

    def rig(self, written: CameraRig) -> CameraRig:
        """Cameras whose `cam_from_world` holds what the file writes, in our world."""
        pose = np.linalg.inv(written.cam_from_world) if self.inverse else written.cam_from_world.copy()
        pose[:, :3, :3] = pose[:, :3, :3] @ _Z_UP[self.up].T
        pose[:, :3, 3] *= METRES[self.unit]
        return replace(written, cam_from_world=pose)

    def written_rig(self, rig: CameraRig) -> CameraRig:
        """The inverse of `rig`."""
        pose = rig.cam_from_world.copy()
        pose[:, :3, :3] = pose[:, :3, :3] @ _Z_UP[self.up]
        pose[:, :3, 3] /= METRES[self.unit]
        return replace(rig, cam_from_world=np.linalg.inv(pose) if self.inverse else pose)
