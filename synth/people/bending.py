"""Pieces of cloth between two segments, which follow a share of the rotation of the joint between them."""

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation


class Bending:
    """Put the pieces of people's trunks in place after `mujoco.mj_kinematics`, which moves each with one segment.

    Args:
        model: A scene with people, or one without.
    """

    def __init__(self, model: mujoco.MjModel):
        share = model.geom_user[:, 0] if model.nuser_geom else np.zeros(model.ngeom)
        self._geoms = np.flatnonzero((share > 0) & (share < 1))
        self._share = share[self._geoms, None]
        self._bodies = model.geom_bodyid[self._geoms]
        self._parents = model.body_parentid[self._bodies]
        self._places = model.geom_pos[self._geoms]
        quats = model.geom_quat[self._geoms]
        self._axes = Rotation.from_quat(quats, scalar_first=True).as_matrix() if len(quats) else quats

    def apply(self, data: mujoco.MjData) -> None:
        """Set `geom_xpos` and `geom_xmat` of the pieces from the orientations of both segments."""
        if not len(self._geoms):
            return
        above, below = (data.xmat[bodies].reshape(-1, 3, 3) for bodies in (self._bodies, self._parents))
        bend = Rotation.from_matrix(below.swapaxes(1, 2) @ above).as_rotvec()
        turned = below @ Rotation.from_rotvec(self._share * bend).as_matrix()
        data.geom_xpos[self._geoms] = data.xpos[self._bodies] + (turned @ self._places[..., None])[..., 0]
        data.geom_xmat[self._geoms] = (turned @ self._axes).reshape(-1, 9)
