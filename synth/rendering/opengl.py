"""Paint images of a scene by OpenGL."""

import copy

import mujoco
import numpy as np

from synth.rendering.backend import make_context
from synth.rigs.lenses import camera_name

_UNDRAWN = 5
"""A group of geoms that MuJoCo does not draw."""
_PLAIN = (
    mujoco.mjtRndFlag.mjRND_SHADOW, mujoco.mjtRndFlag.mjRND_REFLECTION, mujoco.mjtRndFlag.mjRND_SKYBOX,
    mujoco.mjtRndFlag.mjRND_FOG, mujoco.mjtRndFlag.mjRND_HAZE,
)  # fmt: skip
"""Effects without which images of normals are painted."""


class OpenGLPainter:
    """Paint images by MuJoCo's OpenGL renderer; the same interface as `synth.rendering.raycasting.RayPainter`.

    Args:
        model: The scene, with the rig's cameras in it.
        geom_ids: (ngeom,) uint16 id of each geom.
        rig: V pinhole cameras.
        backend: As `find_backend` returns it.
        settings: Shadow map size, samples a pixel, slices, stacks and quads of round shapes.
    """

    def __init__(self, model, geom_ids, rig, backend, settings):
        self._model = copy.copy(model)
        quality = self._model.vis.quality
        quality.shadowsize, quality.offsamples, quality.numslices, quality.numstacks, quality.numquads = settings
        self._ids = geom_ids
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
        self._scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = settings[0] > 0
        self._colouring = self._drawing()
        # Ids must not be mixed at edges, and a buffer of one sample a pixel is drawn and read faster.
        quality.shadowsize = quality.offsamples = 0
        self._identifying = self._drawing() if settings[1] else self._colouring
        self._options = mujoco.MjvOption()
        self._options.sitegroup[:] = self._options.tendongroup[:] = self._options.actuatorgroup[:] = 0

    def _drawing(self) -> mujoco.MjrContext:
        """Return buffers to draw into, at the quality that the model states at present."""
        drawing = mujoco.MjrContext(self._model, mujoco.mjtFontScale.mjFONTSCALE_100.value)
        drawing.readDepthMap = mujoco.mjtDepthMap.mjDEPTH_ZEROFAR.value
        return drawing

    def paint(self, data: mujoco.MjData, view: int, kinds: tuple[str, ...]) -> tuple[np.ndarray | None, ...]:
        self._look(data, view)
        rgb = depth = geoms = normals = None
        if "rgb" in kinds:
            rgb, _ = self._read(view, self._colouring)
        if set(kinds) - {"rgb"}:
            deep = bool({"depth", "flow"} & set(kinds))
            colours, nearness = self._read(view, self._identifying, identify=True, deep=deep)
            geoms, depth = self._geoms(colours), self._metres(nearness) if deep else None
        if "normals" in kinds:
            normals = self._normals(view)
            normals[geoms == 0] = np.nan
        return rgb, depth, geoms, normals

    def paint_alone(self, data: mujoco.MjData, view: int, owner: int) -> np.ndarray:
        groups = self._model.geom_group.copy()
        self._model.geom_group = np.where(self._ids == owner, groups, _UNDRAWN)
        self._look(data, view)
        self._model.geom_group = groups
        # Every geom drawn is the owner's.
        red, green, blue = np.moveaxis(self._read(view, self._identifying, identify=True)[0], -1, 0)
        return (red | green | blue) > 0

    def _look(self, data: mujoco.MjData, view: int) -> None:
        camera = mujoco.MjvCamera()
        camera.type, camera.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED.value, self._cameras[view]
        everything = mujoco.mjtCatBit.mjCAT_ALL.value
        # Rays pass planes from behind. Images have to agree, so that cameras outside a room look into it.
        outward = data.geom_xmat[self._planes, 2::3]
        behind = ((data.cam_xpos[camera.fixedcamid] - data.geom_xpos[self._planes]) * outward).sum(1) < 0
        groups = self._model.geom_group.copy()
        self._model.geom_group[self._planes[behind]] = _UNDRAWN
        mujoco.mjv_updateScene(self._model, data, self._options, None, camera, everything, self._scene)
        self._model.geom_group = groups
        self._gl.make_current()

    def _read(self, view: int, drawing: mujoco.MjrContext, *, identify: bool = False, deep: bool = False):
        """Draw the scene; return colours (H, W, 3), or the numbers of segments in their place, and nearness (H, W)."""
        rect = self._rects[view]
        colours = np.empty((rect.height, rect.width, 3), np.uint8)
        nearness = np.empty((rect.height, rect.width), np.float32) if deep else None
        for flag in (mujoco.mjtRndFlag.mjRND_SEGMENT, mujoco.mjtRndFlag.mjRND_IDCOLOR):
            self._scene.flags[flag] = identify
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, drawing)
        mujoco.mjr_render(rect, self._scene, drawing)
        # OpenGL's first row is the lowest.
        mujoco.mjr_readPixels(colours, nearness, rect, drawing)
        return colours[::-1], nearness[::-1] if deep else None

    def _geoms(self, colours: np.ndarray) -> np.ndarray:
        """Return (H, W) uint16 1 + index of the geom of an image of segment numbers, 0 for none."""
        geoms = np.zeros(self._scene.ngeom + 1, np.uint16)
        for geom in self._scene.geoms[: self._scene.ngeom]:
            if geom.segid >= 0 and geom.objtype == mujoco.mjtObj.mjOBJ_GEOM.value:
                geoms[geom.segid + 1] = 1 + geom.objid
        # Numbers are spread over the channels, lowest first; two are enough for all geoms of a scene.
        return np.take(geoms, colours[..., 0] | colours[..., 1].astype(np.uint16) << 8)

    def _normals(self, view: int) -> np.ndarray:
        """Return (H, W, 3) float32 unit normals, world, from the light that white surfaces return.

        Lights of pure colours shine along the three axes, once from the front and once from behind. What a surface
        returns of each is the cosine of its angle. It is kept in 8 bits a colour: normals are within half a degree.
        """
        scene, effects = self._scene, self._scene.flags.copy()
        for geom in scene.geoms[: scene.ngeom]:
            geom.matid, geom.emission, geom.specular, geom.reflectance = -1, 0, 0, 0
            geom.rgba[:] = 1
        for effect in _PLAIN:
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

    def _metres(self, nearness: np.ndarray) -> np.ndarray:
        """Return depth, m, from a reversed depth buffer: 1 at the near plane, 0 at the far one, linear in 1/depth."""
        near = self._model.vis.map.znear * self._model.stat.extent
        far = self._model.vis.map.zfar * self._model.stat.extent
        # Single precision, in place, is faster; its error is some micrometres.
        depth = nearness * np.float32(far - near) + np.float32(near)
        np.divide(np.float32(near * far), depth, out=depth)
        depth[nearness == 0] = np.nan
        return depth

    def close(self) -> None:
        self._gl.make_current()
        for drawing in {self._colouring, self._identifying}:
            drawing.free()
        self._gl.free()
