"""Render a scene: colour, depth, ids, body parts, normals, flow and amodal masks of persons."""

from enum import Enum
from typing import NamedTuple

import mujoco
import numpy as np

from dmae.data.cameras import CameraRig
from dmae.data.images import FIRST_OBJECT_ID, KINDS
from synth.people.bending import Bending
from synth.people.mjcf import geom_parts
from synth.rendering.backend import find_backend
from synth.rendering.lens_warp import LensPainter
from synth.rendering.opengl import OpenGLPainter
from synth.rendering.raycasting import RayPainter
from synth.rendering.surface_flow import SurfaceFlow
from synth.rigs.lenses import joined, pinholes


class ImageQuality(Enum):
    """Quality of images, and their cost."""

    draft = "draft"
    """No shadows, jagged edges, coarse round shapes; one ray for four pixels where rays are cast."""
    standard = "standard"
    high = "high"


# Shadow map size, samples per pixel, slices, stacks and quads of round shapes. The last number is for ray casting: the
# side, in pixels, of the block that shares a ray. Coarse shadow maps cause jagged edges and specks in shadows on
# upright surfaces: a size of 4096 has 40 % fewer of them than 2048, and makes an image a fifth more expensive.
_SETTINGS = {
    ImageQuality.draft: ((0, 0, 12, 8, 1), 2),
    ImageQuality.standard: ((4096, 4, 20, 12, 2), 1),
    ImageQuality.high: ((6144, 8, 28, 16, 4), 1),
}


class RenderedView(NamedTuple):
    """Images of one view of one frame; None for kinds that were not requested.

    Attributes:
        rgb: (H, W, 3) uint8.
        depth: (H, W) float32 m along the optical axis; NaN where there is no surface.
        ids: (H, W) uint16: 0 nothing, 1 + p person p, 256 + k object k.
        parts: (H, W) uint8: 1 + index in `synth.people.segments.SEGMENTS`; 0 where there is no person.
        normals: (H, W, 3) float32 unit normals of the surface, world; NaN where there is no surface.
        flow: (H, W, 2) float32 px that the surface at a pixel moves until the next state, even if it is hidden there;
            NaN where there is no surface, or no next state.
        amodal: (H, W) uint32; bit p is 1 where person p would be visible if nothing else were there.
    """

    rgb: np.ndarray | None = None
    depth: np.ndarray | None = None
    ids: np.ndarray | None = None
    parts: np.ndarray | None = None
    normals: np.ndarray | None = None
    flow: np.ndarray | None = None
    amodal: np.ndarray | None = None


class Renderer:
    """Render one scene from all cameras of a rig; a context manager.

    Without a working OpenGL (`find_backend`), images are made by ray casting.

    Args:
        model: The scene, with the rig's cameras in it (`synth.rigs.lenses.add_cameras`).
        geom_ids: (ngeom,) uint16 id of the owner of each geom: 0 nothing, 1 + p person p, 256 + k object k.
        rig: V cameras. OpenGL images of distorted cameras are warped. Colour is interpolated; depth, ids and parts are
            taken from the nearest pixel, with an error of up to half a pixel.
        quality: Quality of the images.
    """

    def __init__(
        self, model: mujoco.MjModel, geom_ids: np.ndarray, rig: CameraRig, quality: ImageQuality = ImageQuality.standard
    ):
        settings, step = _SETTINGS[quality]
        backend = find_backend()
        if backend:
            self._painter = LensPainter(OpenGLPainter(model, geom_ids, joined(pinholes(rig)), backend, settings), rig)
        else:
            self._painter = RayPainter(model, geom_ids, rig, step)
        self._model, self._data = model, mujoco.MjData(model)
        self._moved, self._bending = False, Bending(model)
        # Index 0 means no geom.
        self._ids = np.concatenate([[0], geom_ids]).astype(np.uint16)
        self._parts = np.concatenate([[0], geom_parts(model)]).astype(np.uint8)
        self._flow = SurfaceFlow(model, rig)
        self.persons = int(geom_ids[geom_ids < FIRST_OBJECT_ID].max(initial=0))
        """Number of persons."""

    def picture(
        self, qpos: np.ndarray, view: int, kinds: tuple[str, ...] = KINDS, following: np.ndarray | None = None
    ) -> RenderedView:
        """Render one view of the scene in the state `qpos` (nq,). It is fastest to render all frames of one view first.

        Args:
            view: Index into the rig.
            kinds: Kinds of images, from `dmae.data.images.KINDS`. Depth, ids and parts together cost as much as one of
                them. Normals cost two more passes, amodal one for each person.
            following: (nq,) the next state, which the flow refers to.
        """
        self._move(qpos)
        rgb, depth, geoms, normals = self._painter.paint(self._data, view, kinds)
        flow = None
        if "flow" in kinds:
            flow = self._flow(self._data, following, view, depth, geoms)
        amodal = None
        if "amodal" in kinds:
            amodal = np.zeros(geoms.shape, np.uint32)
            for person in range(self.persons):
                amodal |= self._painter.paint_alone(self._data, view, 1 + person).astype(np.uint32) << person
        return RenderedView(
            rgb=rgb if "rgb" in kinds else None,
            depth=depth if "depth" in kinds else None,
            ids=np.take(self._ids, geoms) if "ids" in kinds else None,
            parts=np.take(self._parts, geoms) if "parts" in kinds else None,
            normals=normals if "normals" in kinds else None,
            flow=flow,
            amodal=amodal,
        )

    def alone(self, qpos: np.ndarray, view: int, person: int) -> np.ndarray:
        """Return (H, W) True for the pixels that a person would cover if nothing else were there."""
        self._move(qpos)
        return self._painter.paint_alone(self._data, view, 1 + person)

    def _move(self, qpos: np.ndarray) -> None:
        if self._moved and np.array_equal(self._data.qpos, qpos):
            return
        self._moved = True
        self._data.qpos[:] = qpos
        mujoco.mj_kinematics(self._model, self._data)
        self._bending.apply(self._data)
        mujoco.mj_comPos(self._model, self._data)
        mujoco.mj_camlight(self._model, self._data)

    def close(self) -> None:
        self._painter.close()

    def __enter__(self) -> "Renderer":
        return self

    def __exit__(self, *failure) -> None:
        self.close()
