"""Pictures of a scene: colour, depth, ids and parts of bodies. The only file that touches OpenGL."""

import copy
import functools
import os
import subprocess
import sys
import warnings
from collections.abc import Iterator
from enum import Enum
from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np

from dmae.cameras import CameraRig
from dmae.images import KINDS, Images, write_depth, write_ids, write_parts, write_video
from synth.lens import LensPainter, camera_name, joined, pinholes
from synth.motion import SEGMENTS
from synth.person import geom_parts
from synth.raycast import RayPainter

_OFF = ("disable", "disabled", "off", "false", "0")
_PROBE_SECONDS = 60
_UNDRAWN = 5
"""A group of geoms that MuJoCo does not draw."""


class Quality(Enum):
    """How much is spent on a picture."""

    draft = "draft"
    """No shadows, jagged edges, coarse round shapes; a ray for four pixels where rays are cast."""
    standard = "standard"
    high = "high"


# Shadow map size, samples a pixel, slices, stacks and quads of round shapes; then the side, in pixels, of the block
# that shares a ray where rays are cast instead.
_SETTINGS = {
    Quality.draft: ((0, 0, 12, 8, 1), 2),
    Quality.standard: ((2048, 4, 20, 12, 2), 1),
    Quality.high: ((4096, 8, 28, 16, 4), 1),
}


class Picture(NamedTuple):
    """One view of one frame; None for what was not asked for.

    Attributes:
        rgb: (H, W, 3) uint8.
        depth: (H, W) float32 m along the optical axis; NaN where nothing is.
        ids: (H, W) uint16: 0 nothing, 1 + p person p, 256 + k object k.
        parts: (H, W) uint8: 1 + index in `synth.motion.SEGMENTS` of the body's segment; 0 for what is no person.
    """

    rgb: np.ndarray | None
    depth: np.ndarray | None
    ids: np.ndarray | None
    parts: np.ndarray | None


@functools.cache
def find_backend() -> str | None:
    """The OpenGL that works here without a screen: `egl`, `osmesa` or what MUJOCO_GL asks for; None for none.

    Candidates are tried in a process of their own, since a broken OpenGL may abort. The outcome is left in
    MUJOCO_GL, where MuJoCo looks for it and processes started later find it. Where there is none it says so, once.
    """
    asked = os.environ.get("MUJOCO_GL", "").lower().strip()
    if asked in _OFF:
        return None
    candidates = (asked,) if asked else ("egl", "osmesa")
    for backend in candidates:
        if _works(backend):
            os.environ["MUJOCO_GL"] = backend
            return backend
    os.environ["MUJOCO_GL"] = "disable"
    warnings.warn(
        f"no OpenGL works here (tried {', '.join(candidates)}); images are ray cast instead, which is slower and "
        "plainer. On Debian or Ubuntu: apt-get install libegl1 libgl1 libosmesa6",
        stacklevel=2,
    )
    return None


def _works(backend: str) -> bool:
    code = f"from synth.render import _context; _context({backend!r}, 16, 16).free()"
    environment = os.environ | {
        "MUJOCO_GL": backend,
        "PYTHONPATH": os.pathsep.join([str(Path(__file__).parents[1]), os.environ.get("PYTHONPATH", "")]),
    }
    try:
        outcome = subprocess.run(
            [sys.executable, "-c", code], env=environment, capture_output=True, timeout=_PROBE_SECONDS, check=False
        )
    except subprocess.TimeoutExpired:
        return False
    return outcome.returncode == 0


def _context(backend: str, width: int, height: int):
    """A current OpenGL context. Made by hand because `mujoco.Renderer` is bound to the one of import time."""
    if backend == "egl":
        from mujoco.egl import GLContext
    elif backend == "osmesa":
        from mujoco.osmesa import GLContext
    else:
        from mujoco.glfw import GLContext
    context = GLContext(width, height)
    context.make_current()
    return context


class _GLPainter:
    """Pictures by MuJoCo's OpenGL renderer; same use as `synth.raycast.RayPainter`."""

    def __init__(self, model, geom_ids, rig, backend, settings):
        self._model = copy.copy(model)
        quality = self._model.vis.quality
        quality.shadowsize, quality.offsamples, quality.numslices, quality.numstacks, quality.numquads = settings
        self._ids, self._parts = geom_ids, geom_parts(model)
        self._planes = np.flatnonzero(model.geom_type == mujoco.mjtGeom.mjGEOM_PLANE)
        self._cameras = [mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_CAMERA, camera_name(name)) for name in rig.names]
        if -1 in self._cameras:
            raise ValueError(f"the scene lacks cameras of the rig {rig.names}; put them there with lens.add_cameras")
        self._rects = [mujoco.MjrRect(0, 0, *size) for size in rig.size.tolist()]
        width, height = rig.size.max(0).tolist()
        self._gl = _context(backend, width, height)
        self._scene = mujoco.MjvScene(self._model, maxgeom=10000)
        self._scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = settings[0] > 0
        self._colouring = self._drawing()
        # Numbers are not mixed at edges, and a buffer of one sample a pixel is drawn and read sooner.
        quality.shadowsize = quality.offsamples = 0
        self._identifying = self._drawing() if settings[1] else self._colouring
        self._options = mujoco.MjvOption()
        self._options.sitegroup[:] = self._options.tendongroup[:] = self._options.actuatorgroup[:] = 0

    def _drawing(self) -> mujoco.MjrContext:
        """Buffers to draw into, and what is drawn, at the quality that the model says by now."""
        drawing = mujoco.MjrContext(self._model, mujoco.mjtFontScale.mjFONTSCALE_100.value)
        drawing.readDepthMap = mujoco.mjtDepthMap.mjDEPTH_ZEROFAR.value
        return drawing

    def paint(self, data: mujoco.MjData, view: int, kinds: tuple[str, ...]) -> tuple[np.ndarray | None, ...]:
        self._look(data, view)
        rgb = depth = ids = parts = None
        if "rgb" in kinds:
            # OpenGL's first row is the lowest.
            rgb = self._read(view, identify=False)[0][::-1]
        if set(kinds) - {"rgb"}:
            colours, nearness = self._read(view, identify=True)
            depth, (ids, parts) = self._metres(nearness[::-1]), self._whose(colours[::-1])
        return rgb, depth, ids, parts

    def paint_alone(self, data: mujoco.MjData, view: int, owner: int) -> np.ndarray:
        groups = self._model.geom_group.copy()
        self._model.geom_group = np.where(self._ids == owner, groups, _UNDRAWN)
        self._look(data, view)
        self._model.geom_group = groups
        # Whatever is there is the owner's.
        red, green, blue = np.moveaxis(self._read(view, identify=True)[0][::-1], -1, 0)
        return (red | green | blue) > 0

    def _look(self, data: mujoco.MjData, view: int) -> None:
        camera = mujoco.MjvCamera()
        camera.type, camera.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED.value, self._cameras[view]
        everything = mujoco.mjtCatBit.mjCAT_ALL.value
        # Rays pass planes from behind, and so that images agree the eye does: rooms may be looked into from outside.
        outward = data.geom_xmat[self._planes, 2::3]
        behind = ((data.cam_xpos[camera.fixedcamid] - data.geom_xpos[self._planes]) * outward).sum(1) < 0
        groups = self._model.geom_group.copy()
        self._model.geom_group[self._planes[behind]] = _UNDRAWN
        mujoco.mjv_updateScene(self._model, data, self._options, None, camera, everything, self._scene)
        self._model.geom_group = groups
        self._gl.make_current()

    def _read(self, view: int, identify: bool) -> tuple[np.ndarray, np.ndarray]:
        rect, drawing = self._rects[view], self._identifying if identify else self._colouring
        colours = np.empty((rect.height, rect.width, 3), np.uint8)
        nearness = np.empty((rect.height, rect.width), np.float32)
        for flag in (mujoco.mjtRndFlag.mjRND_SEGMENT, mujoco.mjtRndFlag.mjRND_IDCOLOR):
            self._scene.flags[flag] = identify
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, drawing)
        mujoco.mjr_render(rect, self._scene, drawing)
        mujoco.mjr_readPixels(colours, nearness if identify else None, rect, drawing)
        return colours, nearness

    def _whose(self, colours: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(H, W) ids and parts of what a picture of segment numbers shows."""
        ids, parts = np.zeros(self._scene.ngeom + 1, np.uint16), np.zeros(self._scene.ngeom + 1, np.uint8)
        for geom in self._scene.geoms[: self._scene.ngeom]:
            if geom.segid >= 0 and geom.objtype == mujoco.mjtObj.mjOBJ_GEOM.value:
                ids[geom.segid + 1], parts[geom.segid + 1] = self._ids[geom.objid], self._parts[geom.objid]
        # Numbers are spread over the channels, lowest first; two hold all that a scene has room for.
        number = colours[..., 0] | colours[..., 1].astype(np.uint16) << 8
        return np.take(ids, number), np.take(parts, number)

    def _metres(self, nearness: np.ndarray) -> np.ndarray:
        """Depth from a reversed depth buffer: 1 at the near plane, 0 at the far one, linear in 1/depth."""
        near = self._model.vis.map.znear * self._model.stat.extent
        far = self._model.vis.map.zfar * self._model.stat.extent
        # Single precision, in place, is off by some micrometres; both take time.
        depth = nearness * np.float32(far - near) + np.float32(near)
        np.divide(np.float32(near * far), depth, out=depth)
        depth[nearness == 0] = np.nan
        return depth

    def close(self) -> None:
        self._gl.make_current()
        for drawing in {self._colouring, self._identifying}:
            drawing.free()
        self._gl.free()


class Renderer:
    """Pictures of one scene from all cameras of a rig; a context manager.

    Without a working OpenGL (`find_backend`) they are ray cast.

    Args:
        model: The scene, with the rig's cameras in it (`synth.lens.add_cameras`).
        geom_ids: (ngeom,) uint16 what each geom belongs to: 0 nothing, 1 + p person p, 256 + k object k.
        rig: V cameras. Pictures that OpenGL paints of distorted ones are warped: colour is interpolated, depth, ids
            and parts are those of the nearest pixel, which may lie half a pixel off.
        quality: How much to spend.
    """

    def __init__(
        self, model: mujoco.MjModel, geom_ids: np.ndarray, rig: CameraRig, quality: Quality = Quality.standard
    ):
        settings, step = _SETTINGS[quality]
        backend = find_backend()
        if backend:
            self._painter = LensPainter(_GLPainter(model, geom_ids, joined(pinholes(rig)), backend, settings), rig)
        else:
            self._painter = RayPainter(model, geom_ids, rig, step)
        self._model, self._data = model, mujoco.MjData(model)

    def picture(self, qpos: np.ndarray, view: int, kinds: tuple[str, ...] = KINDS) -> Picture:
        """One view of the scene in the state `qpos` (nq,). Quickest when views are not alternated.

        Args:
            view: Index into the rig.
            kinds: What is wanted, of `dmae.images.KINDS`; all but colour are had together.
        """
        self._move(qpos)
        return Picture(*self._painter.paint(self._data, view, kinds))

    def alone(self, qpos: np.ndarray, view: int, person: int) -> np.ndarray:
        """(H, W) True for the pixels that a person would cover if nothing and nobody else were there."""
        self._move(qpos)
        return self._painter.paint_alone(self._data, view, 1 + person)

    def _move(self, qpos: np.ndarray) -> None:
        self._data.qpos[:] = qpos
        mujoco.mj_kinematics(self._model, self._data)
        mujoco.mj_comPos(self._model, self._data)
        mujoco.mj_camlight(self._model, self._data)

    def close(self) -> None:
        self._painter.close()

    def __enter__(self) -> "Renderer":
        return self

    def __exit__(self, *failure) -> None:
        self.close()


def render_images(
    renderer: Renderer, qpos: np.ndarray, rig: CameraRig, folder: Path, fps: float, kinds: tuple[str, ...] = KINDS
) -> Images:
    """Write every view of every frame as `dmae.images` lays them out, a picture in memory at a time.

    Args:
        renderer: Of the scene and the rig.
        qpos: (F, nq) states.
        folder: Where the images go.
        kinds: Which to write, of `dmae.images.KINDS`.
    """

    def pictures(view: int) -> Iterator[Picture]:
        for frame, state in enumerate(qpos):
            picture = renderer.picture(state, view, kinds)
            for kind, write in {"depth": write_depth, "ids": write_ids, "parts": write_parts}.items():
                if kind in kinds:
                    write(folder / kind / rig.names[view] / f"{frame:06d}.png", getattr(picture, kind))
            yield picture

    for view, name in enumerate(rig.names):
        if "rgb" in kinds:
            write_video(folder / "rgb" / f"{name}.mp4", (picture.rgb for picture in pictures(view)), fps)
        else:
            for _ in pictures(view):
                pass
    return Images(folder, rig.names, tuple(range(len(qpos))), kinds, SEGMENTS if "parts" in kinds else ())
