"""Paint images of a scene by OpenGL, without a screen."""

import functools
import os
import subprocess
import sys
import warnings
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from dmae.data.images import FIRST_OBJECT_ID
from synth.rendering.config import ImagingConfig
from synth.rendering.lighting import SUN, ShadowMap, covered, light_reaching, smoothed
from synth.rigs.lenses import camera_name

_OFF = ("disable", "disabled", "off", "false", "0")
_PROBE_SECONDS = 60


@functools.cache
def find_backend() -> str | None:
    """Return the OpenGL backend that works without a screen: `egl`, `osmesa` or the value of MUJOCO_GL; None for none.

    Each candidate is tried in a separate process, because a broken OpenGL may abort. The result is stored in MUJOCO_GL
    for MuJoCo and for later processes. Warns once if there is none.
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
    code = f"from synth.rendering.opengl import make_context; make_context({backend!r}, 16, 16).free()"
    environment = os.environ | {
        "MUJOCO_GL": backend,
        "PYTHONPATH": os.pathsep.join([str(Path(__file__).parents[2]), os.environ.get("PYTHONPATH", "")]),
    }
    try:
        outcome = subprocess.run(
            [sys.executable, "-c", code], env=environment, capture_output=True, timeout=_PROBE_SECONDS, check=False
        )
    except subprocess.TimeoutExpired:
        return False
    return outcome.returncode == 0


def make_context(backend: str, width: int, height: int):
    """Return a current OpenGL context. `mujoco.Renderer` cannot be used: it is bound to the backend at import time."""
    if backend == "egl":
        from mujoco.egl import GLContext
    elif backend == "osmesa":
        from mujoco.osmesa import GLContext
    else:
        from mujoco.glfw import GLContext
    context = GLContext(width, height)
    context.make_current()
    return context


# The painter

_UNDRAWN, _DRAWN = 5, 3
"""A geom group that MuJoCo does not draw, and the number of geom groups that it draws: 0, 1 and 2."""
_SWITCHED_OFF = (
    mujoco.mjtRndFlag.mjRND_SHADOW, mujoco.mjtRndFlag.mjRND_REFLECTION, mujoco.mjtRndFlag.mjRND_SKYBOX,
    mujoco.mjtRndFlag.mjRND_FOG, mujoco.mjtRndFlag.mjRND_HAZE,
)  # fmt: skip
"""Effects that are switched off for images of normals and of light."""
_MAP = 1024
"""Side of a map of what a lamp sees, px."""
_FAR = 1e3
"""Distance to which geoms are moved that throw no shadow, m."""
_NO_MAP = ShadowMap(np.eye(3), np.zeros(3), 0.0, True, np.zeros(2), np.ones(2), np.empty((0, 0), np.float32))
_LUMA = np.array([0.2126, 0.7152, 0.0722])


class OpenGLPainter:
    """Paint images by MuJoCo's OpenGL renderer; the same interface as `synth.rendering.raycasting.RayPainter`.

    Args:
        model: The scene, with the rig's cameras in it. Its settings of quality change.
        geom_ids: (ngeom,) uint16 id of each geom.
        rig: V pinhole cameras.
        backend: OpenGL backend from `find_backend`.
        settings: Whether there are shadows and ambient occlusion, samples per pixel, slices, stacks and quads of round
            shapes.
        imaging: Light of colour images.
    """

    def __init__(self, model, geom_ids, rig, backend, settings, imaging: ImagingConfig):
        self._model = model
        quality = self._model.vis.quality
        self._shaded, quality.offsamples, quality.numslices, quality.numstacks, quality.numquads = settings
        quality.shadowsize = 0
        self._lenses, self._poses = rig.K, rig.cam_from_world
        self._moving = model.body_weldid[model.geom_bodyid] != 0
        # Each person is drawn separately; all moving objects are drawn together.
        owners = np.where(geom_ids < FIRST_OBJECT_ID, geom_ids, FIRST_OBJECT_ID)
        self._movers = {
            int(owner): self._moving & (owners == owner) & (model.geom_group < _DRAWN)
            for owner in np.unique(owners[self._moving & (model.geom_group < _DRAWN)])
        }
        self._still: Any = None
        self._known: Any = None
        self._alone: dict[int, tuple] = {}
        self._planes = np.flatnonzero(model.geom_type == mujoco.mjtGeom.mjGEOM_PLANE)
        self._cameras = [mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_CAMERA, camera_name(name)) for name in rig.names]
        if -1 in self._cameras:
            raise ValueError(
                f"the scene lacks cameras of the rig {rig.names}; add them with synth.rigs.lenses.add_cameras"
            )
        self._rects = [mujoco.MjrRect(0, 0, *size) for size in rig.size.tolist()]
        width, height = rig.size.max(0).tolist()
        self._gl = make_context(backend, width, height)
        self._scene = mujoco.MjvScene(self._model, maxgeom=10000)
        self._lamp, self._occlusion = imaging.lamp, imaging.ambient_occlusion
        self._scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = False
        self._colouring = self._drawing()
        # Ids must not be mixed at edges. A buffer with one sample per pixel is also drawn and read faster.
        quality.offsamples = 0
        if self._shaded:
            frame = self._model.vis.global_
            frame.offwidth, frame.offheight = max(frame.offwidth, _MAP), max(frame.offheight, _MAP)
        self._identifying = self._drawing() if settings[1] else self._colouring
        self._options = mujoco.MjvOption()
        self._options.sitegroup[:] = self._options.tendongroup[:] = self._options.actuatorgroup[:] = 0

    def _drawing(self) -> mujoco.MjrContext:
        """Return buffers to draw into, with the current quality settings of the model."""
        drawing = mujoco.MjrContext(self._model, mujoco.mjtFontScale.mjFONTSCALE_100.value)
        drawing.readDepthMap = mujoco.mjtDepthMap.mjDEPTH_ZEROFAR.value
        return drawing

    def reshape(self, meshes: np.ndarray) -> None:
        """Take over the vertices of meshes (M,) that changed in the model."""
        self._known = None
        self._gl.make_current()
        for drawing in {self._colouring, self._identifying}:
            for mesh in meshes.tolist():
                mujoco.mjr_uploadMesh(self._model, drawing, mesh)

    def paint(self, data: mujoco.MjData, view: int, kinds: tuple[str, ...]) -> tuple[np.ndarray | None, ...]:
        rgb = depth = geoms = normals = None
        if {"rgb", "normals"} & set(kinds):
            self._look(data, view)
        if "rgb" in kinds:
            rgb, _ = self._read(view, self._colouring)
            if self._shaded:
                rgb = self._lit(rgb, view)
                if "normals" in kinds:
                    self._look(data, view)
        if "normals" in kinds:
            normals = self._normals(view)
        if set(kinds) - {"rgb"}:
            geoms, nearness = self._identify(data, view)
            depth = self._metres(nearness) if {"depth", "flow"} & set(kinds) else None
        if normals is not None:
            normals[geoms == 0] = np.nan
        return rgb, depth, geoms, normals

    def paint_alone(self, data: mujoco.MjData, view: int, owner: int) -> np.ndarray:
        self._identify(data, view)
        alone = np.zeros((self._rects[view].height, self._rects[view].width), bool)
        if owner in self._alone:
            part, covered = self._alone[owner]
            alone[part] = covered
        return alone

    def _identify(self, data: mujoco.MjData, view: int) -> tuple[np.ndarray, np.ndarray]:
        """Return two (H, W) images: 1 + index of the geom at each pixel, 0 for none, and the depth buffer.

        What stands still is drawn once for a view; people one by one, only around them, which gives what each would
        cover alone.
        """
        if self._known is not None and self._known[0] == view and np.array_equal(self._known[1], data.qpos):
            return self._known[2:]
        if self._still is None or self._still[0] != view:
            still = self._drawn(data, view, ~self._moving, (slice(None), slice(None)))
            self._still = (view, *(layer.copy() for layer in still))
        geoms, nearness = self._still[1].copy(), self._still[2].copy()
        around = {owner: self._around(data, view, mask) for owner, mask in self._movers.items()}
        parts = {owner: part for owner, part in around.items() if part}
        self._alone = {}
        for together in _separate_groups(parts):
            mask = np.any([self._movers[owner] for owner in together], axis=0)
            whole = _hull([parts[owner] for owner in together])
            found, near = self._drawn(data, view, mask, whole)
            for owner in together:
                part = parts[owner]
                rows, columns = (slice(p.start - w.start, p.stop - w.start) for p, w in zip(part, whole, strict=True))
                one, its = found[rows, columns], near[rows, columns]
                self._alone[owner] = part, one > 0
                nearer = (one > 0) & (its >= nearness[part])
                np.copyto(geoms[part], one, where=nearer)
                np.copyto(nearness[part], its, where=nearer)
        self._known = (view, data.qpos.copy(), geoms, nearness)
        return geoms, nearness

    def _drawn(self, data: mujoco.MjData, view: int, mask: np.ndarray, part) -> tuple[np.ndarray, np.ndarray]:
        """Draw only the geoms of a mask (ngeom,), and return the two images of `_identify` for a part of the image."""
        self._look(data, view, mask)
        colours, nearness = self._read(view, self._identifying, identify=True, deep=True, part=part)
        return self._geoms(colours), nearness

    def _around(self, data: mujoco.MjData, view: int, mask: np.ndarray) -> tuple[slice, slice] | None:
        """Return rows and columns of the part of the image that geoms of a mask (ngeom,) may cover; None for none."""
        rect, lens, pose = self._rects[view], self._lenses[view], self._poses[view]
        centre = data.geom_xpos[mask] @ pose[:3, :3].T + pose[:3, 3]
        radius = self._model.geom_rbound[mask]
        if (radius <= 0).any() or (centre[:, 2] - radius < 1e-2).any():
            return slice(0, rect.height), slice(0, rect.width)
        ends = []
        for axis in range(2):
            low, high = centre[:, axis] - radius, centre[:, axis] + radius
            near, far = centre[:, 2] - radius, centre[:, 2] + radius
            focal, middle = lens[axis, axis], lens[axis, 2]
            first = (focal * low / np.where(low < 0, near, far)).min() + middle
            last = (focal * high / np.where(high > 0, near, far)).max() + middle
            most = (rect.width, rect.height)[axis]
            ends.append((max(0, int(first) - 3), min(most, int(last) + 4)))
        (left, right), (top, bottom) = ends
        return (slice(top, bottom), slice(left, right)) if left < right and top < bottom else None

    def _look(self, data: mujoco.MjData, view: int, mask: np.ndarray | None = None) -> None:
        """Update the scene for the camera of a view, with the geoms of a mask (ngeom,) or with all geoms."""
        camera = mujoco.MjvCamera()
        camera.type, camera.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED.value, self._cameras[view]
        everything = mujoco.mjtCatBit.mjCAT_ALL.value
        # Rays pass through planes from behind. OpenGL images must do the same, so cameras outside a room see into it.
        outward = data.geom_xmat[self._planes, 2::3]
        behind = ((data.cam_xpos[camera.fixedcamid] - data.geom_xpos[self._planes]) * outward).sum(1) < 0
        groups = self._model.geom_group.copy()
        self._model.geom_group[self._planes[behind]] = _UNDRAWN
        if mask is not None:
            self._model.geom_group[~mask] = _UNDRAWN
        mujoco.mjv_updateScene(self._model, data, self._options, None, camera, everything, self._scene)
        self._model.geom_group = groups
        self._gl.make_current()

    def _read(
        self, view: int, drawing: mujoco.MjrContext, *, identify: bool = False, deep: bool = False, part=None
    ) -> tuple[np.ndarray, Any]:
        """Draw the scene; return colours (H, W, 3), or segment numbers, and the depth buffer (H, W), or a `part` of
        both."""
        rect = self._rects[view]
        rows, columns = (
            each.indices(size)[:2]
            for each, size in zip(part or (slice(None),) * 2, (rect.height, rect.width), strict=True)
        )
        # The first row in OpenGL is the lowest row of the image.
        read = mujoco.MjrRect(columns[0], rect.height - rows[1], columns[1] - columns[0], rows[1] - rows[0])
        colours = np.empty((read.height, read.width, 3), np.uint8)
        nearness = np.empty((read.height, read.width), np.float32) if deep else None
        for flag in (mujoco.mjtRndFlag.mjRND_SEGMENT, mujoco.mjtRndFlag.mjRND_IDCOLOR):
            self._scene.flags[flag] = identify
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, drawing)
        mujoco.mjr_render(rect, self._scene, drawing)
        mujoco.mjr_readPixels(colours, nearness, read, drawing)
        return colours[::-1], None if nearness is None else nearness[::-1]

    def _geoms(self, colours: np.ndarray) -> np.ndarray:
        """Return (H, W) uint16 1 + index of the geom at each pixel of an image of segment numbers, 0 for none."""
        geoms = np.zeros(self._scene.ngeom + 1, np.uint16)
        for geom in self._scene.geoms[: self._scene.ngeom]:
            if geom.segid >= 0 and geom.objtype == mujoco.mjtObj.mjOBJ_GEOM.value:
                geoms[geom.segid + 1] = 1 + geom.objid
        # The bytes of a number are in the channels, lowest first. Two bytes are enough for all geoms of a scene.
        return np.take(geoms, colours[..., 0] | colours[..., 1].astype(np.uint16) << 8)

    def _normals(self, view: int) -> np.ndarray:
        """Return (H, W, 3) float32 unit normals, world, from the light that white surfaces reflect.

        Pure colours shine along the three axes, from the front and from behind; a surface reflects each by the cosine
        of its angle. With 8 bits the error is below half a degree.
        """
        scene, effects = self._scene, self._scene.flags.copy()
        for geom in scene.geoms[: scene.ngeom]:
            geom.matid, geom.emission, geom.specular, geom.reflectance = -1, 0, 0, 0
            geom.rgba[:] = 1
        for effect in _SWITCHED_OFF:
            scene.flags[effect] = False
        scene.nlight = 3
        shades = []
        for sign in (1, -1):
            for axis, light in enumerate(scene.lights[:3]):
                light.type, light.headlight, light.castshadow = mujoco.mjtLightType.mjLIGHT_DIRECTIONAL.value, 0, 0
                light.ambient[:] = light.specular[:] = light.diffuse[:] = light.dir[:] = 0
                light.diffuse[axis], light.dir[axis] = 1, -sign
            shades.append(self._read(view, self._identifying)[0])
        scene.flags[:] = effects
        normals = shades[0].astype(np.float32) - shades[1]
        return normals / np.maximum(np.linalg.norm(normals, axis=-1, keepdims=True), 1)

    def _lit(self, rgb: np.ndarray, view: int) -> np.ndarray:
        """Return an image with shadows and ambient occlusion, from one without. The scene cannot be used again.

        A second pass paints white surfaces lit by the lamp that throws shadows in red, by all others in green.
        """
        scene = self._scene
        lamp, key = None, 0.0
        for light in scene.lights[: scene.nlight]:
            diffuse, ambient = _LUMA @ light.diffuse, _LUMA @ light.ambient
            light.diffuse[:] = light.ambient[:] = light.specular[:] = 0
            light.ambient[1] = ambient
            if light.castshadow and not light.headlight and diffuse > key:
                if lamp is not None:
                    lamp.diffuse[:] = 0, key, 0
                lamp, key = light, diffuse
                light.diffuse[0] = 1
            else:
                light.diffuse[1] = diffuse
        if lamp is None and not self._occlusion:
            return rgb
        for geom in scene.geoms[: scene.ngeom]:
            geom.matid, geom.emission, geom.specular, geom.reflectance = -1, 0, 0, 0
            geom.rgba[:3] = 1
        effects = scene.flags.copy()
        for effect in _SWITCHED_OFF:
            scene.flags[effect] = False
        light, nearness = self._read(view, self._identifying, deep=True)
        depth = self._metres(nearness)
        seen = self._seen_by(lamp, depth, view) if lamp is not None else _NO_MAP
        scene.flags[:] = effects
        share = light_reaching(depth, self._lenses[view], light[..., 0], key, light[..., 1], seen, self._occlusion)
        share = smoothed(share, depth)
        return (rgb * share[..., None] + 0.5).astype(np.uint8)

    def _seen_by(self, lamp: mujoco.MjvLight, depth: np.ndarray, view: int) -> ShadowMap:
        """Return what a lamp of the scene sees of the surfaces of an image, from their depth (H, W), m."""
        pose, K = self._poses[view], self._lenses[view]
        parallel = lamp.type == mujoco.mjtLightType.mjLIGHT_DIRECTIONAL.value
        forward = np.array(lamp.dir, float)
        forward /= np.linalg.norm(forward)
        right = np.cross(forward, np.eye(3)[np.abs(forward).argmin()])
        right /= np.linalg.norm(right)
        axes = np.stack([right, np.cross(forward, right), forward])
        row, column = np.indices(depth.shape)[:, ::8, ::8].reshape(2, -1)
        z = depth[row, column]
        points = np.stack([(column - K[0, 2]) / K[0, 0], (row - K[1, 2]) / K[1, 1], np.ones_like(z)], -1) * z[:, None]
        points = (points[z > 0] - pose[:3, 3]) @ pose[:3, :3]
        if not len(points):
            return _NO_MAP
        away = (points - lamp.pos) @ forward
        near, far = 0.05, float(away.max()) + 0.5
        origin = np.array(lamp.pos, float)
        if parallel:
            origin -= forward * (2 * self._model.stat.extent)
            far += 2 * self._model.stat.extent
        limits = covered(points, axes, origin, parallel)
        if limits is None or far <= near:
            return _NO_MAP
        for camera in self._scene.camera:
            camera.pos[:], camera.forward[:], camera.up[:] = origin, forward, -axes[1]
            middle, half = limits.mean(0), (limits[1] - limits[0]) / 2
            scale = 1.0 if parallel else near
            camera.orthographic = parallel
            camera.frustum_center, camera.frustum_width = scale * middle[0], scale * half[0]
            camera.frustum_bottom, camera.frustum_top = (scale * each for each in (-limits[1, 1], -limits[0, 1]))
            camera.frustum_near, camera.frustum_far = near, far
        for geom in self._scene.geoms[: self._scene.ngeom]:
            if geom.type == mujoco.mjtGeom.mjGEOM_PLANE.value or geom.rgba[3] < 1:
                geom.pos[2] -= _FAR
        rect, drawing = mujoco.MjrRect(0, 0, _MAP, _MAP), self._identifying
        nearness = np.empty((_MAP, _MAP), np.float32)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, drawing)
        mujoco.mjr_render(rect, self._scene, drawing)
        mujoco.mjr_readPixels(None, nearness, rect, drawing)
        if parallel:
            distance = far - nearness * np.float32(far - near)
        else:
            distance = np.float32(near * far) / (nearness * np.float32(far - near) + np.float32(near))
        distance[nearness == 0] = np.inf
        step = (limits[1] - limits[0]) / _MAP
        size = SUN if parallel and self._lamp else self._lamp
        turn = pose[:3, :3]
        return ShadowMap(
            axes @ turn.T, turn @ origin + pose[:3, 3], size, parallel, limits[0] + step / 2, step,
            np.ascontiguousarray(distance[::-1]),
        )  # fmt: skip

    def _metres(self, nearness: np.ndarray) -> np.ndarray:
        """Return depth, m, from a reversed depth buffer: 1 at the near plane, 0 at the far one, linear in 1/depth."""
        near = self._model.vis.map.znear * self._model.stat.extent
        far = self._model.vis.map.zfar * self._model.stat.extent
        # Single precision in place is faster. Its error is a few micrometres.
        depth = nearness * np.float32(far - near) + np.float32(near)
        np.divide(np.float32(near * far), depth, out=depth)
        depth[nearness == 0] = np.nan
        return depth

    def close(self) -> None:
        self._gl.make_current()
        for drawing in {self._colouring, self._identifying}:
            drawing.free()
        self._gl.free()


def _separate_groups(parts: dict[int, tuple[slice, slice]]) -> list[list[int]]:
    """Return groups of owners with parts of the image that do not overlap. Each group is drawn in one pass."""
    groups: list[list[int]] = []
    for owner, part in parts.items():
        for group in groups:
            if not any(_overlap(part, parts[other]) for other in group):
                group.append(owner)
                break
        else:
            groups.append([owner])
    return groups


def _overlap(one: tuple[slice, slice], other: tuple[slice, slice]) -> bool:
    return all(a.start < b.stop and b.start < a.stop for a, b in zip(one, other, strict=True))


def _hull(parts: list[tuple[slice, slice]]) -> tuple[slice, ...]:
    return tuple(slice(min(e.start for e in each), max(e.stop for e in each)) for each in zip(*parts, strict=True))
