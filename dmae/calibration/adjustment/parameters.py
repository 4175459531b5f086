"""Parameters of cameras that are adjusted, and the calibration that they change.

V views; Q parameters per view: rotation (3), centre (3), focal length, k1, k2, time offset, drift.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from dmae.data.cameras import CameraRig

ROTATION, CENTRE = slice(0, 3), slice(3, 6)
FOCAL, K1, K2, OFFSET, DRIFT = range(6, 11)
Q = 11
"""Number of parameters of a camera."""


@dataclass(frozen=True)
class Calibration:
    """Cameras and their clocks.

    Attributes:
        rig: V cameras, m.
        offset: (V,) s by which the images of a camera are later than its frame numbers say: frame (t + offset) fps of
            the camera shows a body at time t.
        drift: (V,) growth of the offset, s/s from the start of the clip.
    """

    rig: CameraRig
    offset: np.ndarray
    drift: np.ndarray

    @classmethod
    def of(cls, rig: CameraRig) -> Calibration:
        """Return synchronised cameras."""
        return cls(rig, np.zeros(len(rig)), np.zeros(len(rig)))

    def __getitem__(self, views: list[int]) -> Calibration:
        return Calibration(self.rig[views], self.offset[views], self.drift[views])

    def changed(self, step: np.ndarray) -> Calibration:
        """Return the calibration changed by a step (V, Q).

        The first entries are a rotation vector in the axes of the world, rad, about the centre of the camera, a
        movement of the centre in the world, m, and a change of the logarithm of the focal length. Offset and drift are
        in s and s/s.
        """
        rig = self.rig
        turned = Rotation.from_rotvec(step[:, ROTATION]).as_matrix()
        R = rig.cam_from_world[:, :3, :3] @ turned.swapaxes(-1, -2)
        pose = rig.cam_from_world.copy()
        pose[:, :3, :3] = R
        pose[:, :3, 3] = -(R @ (rig.centers + step[:, CENTRE])[..., None])[..., 0]
        K, dist = rig.K.copy(), rig.dist.copy()
        K[:, :2, :2] *= np.exp(step[:, FOCAL])[:, None, None]
        dist[:, 0] += step[:, K1]
        dist[:, 1] += step[:, K2]
        changed = replace(rig, K=K, dist=dist, cam_from_world=pose)
        return Calibration(changed, self.offset + step[:, OFFSET], self.drift + step[:, DRIFT])

    def difference(self, other: Calibration) -> np.ndarray:
        """Return the step (V, Q) from this calibration to another one."""
        a, b = self.rig, other.rig
        step = np.zeros((len(a), Q))
        turned = b.cam_from_world[:, :3, :3].swapaxes(-1, -2) @ a.cam_from_world[:, :3, :3]
        step[:, ROTATION] = Rotation.from_matrix(turned).as_rotvec()
        step[:, CENTRE] = b.centers - a.centers
        step[:, FOCAL] = np.log(b.K[:, 0, 0] / a.K[:, 0, 0])
        step[:, [K1, K2]] = b.dist[:, :2] - a.dist[:, :2]
        step[:, OFFSET], step[:, DRIFT] = other.offset - self.offset, other.drift - self.drift
        return step
