"""Flow: the displacement in the image, until the next frame, of the surface at each pixel."""

import mujoco
import numpy as np

from dmae.data.cameras import CameraRig
from synth.people.bending import Bending


class SurfaceFlow:
    """The flow of images of a scene of rigid geoms.

    Args:
        model: The scene.
        rig: V static cameras.
    """

    def __init__(self, model: mujoco.MjModel, rig: CameraRig):
        self._model, self._rig, self._next = model, rig, mujoco.MjData(model)
        self._bending = Bending(model)
        self._moves = np.concatenate([[False], model.body_weldid[model.geom_bodyid] > 0])
        self._view, self._rays = None, np.empty(0)

    def __call__(
        self, data: mujoco.MjData, following: np.ndarray | None, view: int, depth: np.ndarray, geoms: np.ndarray
    ) -> np.ndarray:
        """Return the flow (H, W, 2), float32 px; NaN where there is no surface.

        Args:
            data: State of the scene, positions up to date.
            following: (nq,) the next state; None if there is none. Then all flow is NaN.
            view: Index into the rig.
            depth: (H, W) m along the optical axis.
            geoms: (H, W) 1 + index of the geom at each pixel, 0 for none.
        """
        flow = np.full((*depth.shape, 2), np.nan, np.float32)
        if following is None:
            return flow
        flow[geoms > 0] = 0
        row, column = np.nonzero(self._moves[geoms])
        if not len(row):
            return flow
        self._next.qpos[:] = following
        mujoco.mj_kinematics(self._model, self._next)
        self._bending.apply(self._next)
        camera = self._rig[view : view + 1]
        pose, pixels = camera.cam_from_world[0], np.stack([column, row], -1).astype(float)
        rays = self._rays_of(camera, view, depth.shape)[row, column]
        points = camera.centers[0] + rays * (depth[row, column] / (rays @ pose[2, :3]))[:, None]
        geom = geoms[row, column].astype(int) - 1
        turn = self._axes(self._next) @ self._axes(data).transpose(0, 2, 1)
        places = self._next.geom_xpos[geom] + np.einsum(
            "rij,rj->ri", turn[geom], points - data.geom_xpos[geom], optimize=True
        )
        xy, along = camera.project(places[None])
        flow[row, column] = np.where(along[0, 0, :, None] > 0, xy[0, 0] - pixels, np.nan)
        return flow

    def _axes(self, data: mujoco.MjData) -> np.ndarray:
        return data.geom_xmat.reshape(-1, 3, 3)

    def _rays_of(self, camera: CameraRig, view: int, shape: tuple[int, ...]) -> np.ndarray:
        """Return (H, W, 3) unit rays through the pixels of a view, world. They are cached until the view changes."""
        if view != self._view:
            grid = np.stack(np.meshgrid(np.arange(shape[1]), np.arange(shape[0])), -1).astype(float)
            self._view, self._rays = view, camera.rays(grid[None, None]).reshape(*shape, 3)
        return self._rays
