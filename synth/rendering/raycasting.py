"""Paint images of a scene without OpenGL: one ray for every pixel, with simple shading."""

import copy

import mujoco
import numpy as np

from dmae.data.cameras import CameraRig
from synth.rooms.rays import cast_rays

_STATIC, _MOVING, _ALONE, _UNSEEN = 0, 1, 2, 5
_BLOCK = 8
_LARGER = 1.5
"""Enlargement of the boxes around bodies and surfaces. MuJoCo tries no rays outside these boxes."""
_SKY = np.array([0.55, 0.65, 0.75])
_SUN = np.array([0.3, 0.2, 0.93])


class RayPainter:
    """Paint images of a scene by ray casting.

    Rays to still geoms are cast once for each camera, rays to moving geoms only where these may be visible.

    Args:
        geom_ids: (ngeom,) uint16 id of each geom. Geoms with an id are painted, and geoms that MuJoCo draws.
        rig: V cameras. Rays follow the distortion of their lenses, so images need no warping.
        step: One ray is cast for each block of `step` x `step` pixels.
    """

    def __init__(self, model: mujoco.MjModel, geom_ids: np.ndarray, rig: CameraRig, step: int):
        drawn = (geom_ids > 0) | (model.geom_group < 3)
        moves = model.body_weldid[model.geom_bodyid] > 0
        self._given, self._model = model, copy.copy(model)
        self._model.geom_group = np.where(drawn, np.where(moves, _MOVING, _STATIC), _UNSEEN)
        # MuJoCo skips rays outside the angles of a box's corners. Near a camera, edges extend beyond these angles.
        self._model.bvh_aabb[:, 3:] *= _LARGER
        self._moving = np.flatnonzero(drawn & moves)
        self._colour, self._ids = _colours(model), geom_ids
        self._rig, self._step = rig, step
        self._view: int | None = None

    def paint(self, data: mujoco.MjData, view: int, kinds: tuple[str, ...]) -> tuple[np.ndarray, ...]:
        """Return colour (H, W, 3) uint8, depth (H, W) m, geoms (H, W) and normals (H, W, 3) from the same rays.

        Geoms are uint16, 1 + index of the geom, or 0 for none. Normals are unit vectors, world, NaN for none.

        Args:
            data: State of the scene, positions up to date.
            view: Index into the rig.
            kinds: Ignored.
        """
        if view != self._view:
            self._set_view(view, data)
        geom, distance, normal = (array.copy() for array in self._background)
        near = np.flatnonzero(self._may_be_visible(data, view, self._moving))
        hit, reach, outward = cast_rays(self._model, data, self._center, self._rays[near], (_MOVING,))
        first = (hit >= 0) & ((geom[near] < 0) | (reach < distance[near]))
        geom[near[first]], distance[near[first]], normal[near[first]] = hit[first], reach[first], outward[first]
        return self._shade(geom, distance, normal)

    def paint_alone(self, data: mujoco.MjData, view: int, owner: int) -> np.ndarray:
        """Return (H, W) True for the pixels that geoms with the id `owner` would cover if nothing else were there."""
        if view != self._view:
            self._set_view(view, data)
        groups, own = self._model.geom_group.copy(), self._ids == owner
        self._model.geom_group = np.where(own, _ALONE, groups)
        near = np.flatnonzero(self._may_be_visible(data, view, np.flatnonzero(own)))
        hit, _, _ = cast_rays(self._model, data, self._center, self._rays[near], (_ALONE,))
        self._model.geom_group = groups
        covered = np.zeros(self._shape, bool)
        covered.ravel()[near] = hit >= 0
        return self._enlarge(covered)

    def reshape(self, meshes: np.ndarray) -> None:
        """Take over the vertices of meshes (M,) that changed in the model."""
        for name in ("mesh_vert", "mesh_normal", "geom_aabb", "geom_size", "geom_rbound", "bvh_aabb"):
            getattr(self._model, name)[:] = getattr(self._given, name)
        self._model.bvh_aabb[:, 3:] *= _LARGER

    def close(self) -> None:
        """Do nothing. This is the counterpart of `OpenGLPainter.close`."""

    def _set_view(self, view: int, data: mujoco.MjData) -> None:
        camera, middle = self._rig[view : view + 1], (self._step - 1) / 2
        grid = np.meshgrid(*(np.arange(-(-n // self._step)) * self._step + middle for n in camera.size[0]))
        self._shape = grid[0].shape
        self._center = camera.centers[0]
        self._rays = camera.rays(np.stack(grid, -1)[None, None]).reshape(-1, 3)
        # Corners of the image may be outside the view of the lens: they have no rays and stay dark.
        self._lit = np.isfinite(self._rays[:, 0])
        self._bounds = _block_bounds(self._rays.reshape(*self._shape, 3) @ camera.cam_from_world[0, :3, :3].T)
        geom, distance, normal = (
            np.full(len(self._rays), -1, np.int32),
            np.full(len(self._rays), -1.0),
            np.zeros_like(self._rays),
        )
        found = cast_rays(self._model, data, self._center, self._rays[self._lit], (_STATIC,))
        geom[self._lit], distance[self._lit], normal[self._lit] = found
        self._background = geom, distance, normal
        self._view = view

    def _may_be_visible(self, data: mujoco.MjData, view: int, geoms: np.ndarray) -> np.ndarray:
        """Return (R,) True for rays through blocks of pixels that overlap the bounding spheres of geoms."""
        pose = self._rig.cam_from_world[view]
        centers = data.geom_xpos[geoms] @ pose[:3, :3].T + pose[:3, 3]
        radius = self._model.geom_rbound[geoms]
        x0, x1 = _silhouette(centers[:, 0], centers[:, 2], radius)
        y0, y1 = _silhouette(centers[:, 1], centers[:, 2], radius)
        low_x, high_x, low_y, high_y = self._bounds
        show = np.zeros(low_x.shape, bool)
        for left, right, top, bottom in zip(x0, x1, y0, y1, strict=True):
            show |= (high_x >= left) & (low_x <= right) & (high_y >= top) & (low_y <= bottom)
        rows, columns = self._shape
        return show.repeat(_BLOCK, 0).repeat(_BLOCK, 1)[:rows, :columns].ravel() & self._lit

    def _shade(self, geom, distance, normal) -> tuple[np.ndarray, ...]:
        hit = geom >= 0
        facing = -np.einsum("rx,rx->r", normal, self._rays)
        light = 0.25 + 0.4 * np.abs(facing) + 0.35 * np.clip(normal @ _SUN, 0, 1)
        colour = np.where(hit[:, None], self._colour[geom] * light[:, None], _SKY)
        colour[~self._lit] = 0
        axis = self._rig.cam_from_world[self._view, 2, :3]
        images = (
            (255 * np.clip(colour, 0, 1)).round().astype(np.uint8),
            np.where(hit, distance * (self._rays @ axis), np.nan).astype(np.float32),
            np.where(hit, geom + 1, 0).astype(np.uint16),
            np.where(hit[:, None], normal, np.nan).astype(np.float32),
        )
        return tuple(self._enlarge(image.reshape(*self._shape, *image.shape[1:])) for image in images)

    def _enlarge(self, image: np.ndarray) -> np.ndarray:
        width, height = self._rig.size[self._view]
        return image.repeat(self._step, 0).repeat(self._step, 1)[:height, :width]


def _colours(model: mujoco.MjModel) -> np.ndarray:
    """Return (ngeom, 3) RGB 0..1 of the geoms: the colour of the material times the mean colour of its texture."""
    materials = model.mat_rgba[:, :3].astype(np.float64)
    for material, texture in enumerate(model.mat_texid[:, mujoco.mjtTextureRole.mjTEXROLE_RGB]):
        if texture >= 0:
            start, channels = model.tex_adr[texture], model.tex_nchannel[texture]
            pixels = model.tex_data[start : start + model.tex_width[texture] * model.tex_height[texture] * channels]
            materials[material] *= pixels.reshape(-1, channels)[:, :3].mean(0) / 255
    colours = model.geom_rgba[:, :3].astype(np.float64)
    painted = model.geom_matid >= 0
    colours[painted] = materials[model.geom_matid[painted]]
    return colours


def _silhouette(across: np.ndarray, along: np.ndarray, radius: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return least and greatest tangents of the directions to spheres, in a plane through the optical axis."""
    middle = np.arctan2(across, along)
    distance = np.hypot(across, along)
    half = np.arcsin(np.minimum(radius / np.maximum(distance, 1e-9), 1))
    low, high = middle - half, middle + half
    steep = np.pi / 2 - 1e-3
    tangents = np.tan(np.clip(low, -steep, steep)), np.tan(np.clip(high, -steep, steep))
    # A sphere around the camera, or one that extends behind it on both sides, may appear anywhere.
    anywhere = distance <= radius
    behind = ~anywhere & ((low >= steep) | (high <= -steep))
    return (
        np.where(anywhere, -np.inf, np.where(behind, 0.0, tangents[0])),
        np.where(anywhere, np.inf, np.where(behind, -np.inf, tangents[1])),
    )


def _block_bounds(rays: np.ndarray) -> np.ndarray:
    """Return (4, h, w) least and greatest x/z and y/z of rays (H, W, 3), camera frame, by block; NaN where all rays
    are."""
    height, width = rays.shape[:2]
    tangents = rays[..., :2] / rays[..., 2:]
    padding = ((0, -height % _BLOCK), (0, -width % _BLOCK), (0, 0))
    blocks = np.pad(tangents, padding, constant_values=np.nan)
    blocks = blocks.reshape(len(blocks) // _BLOCK, _BLOCK, -1, _BLOCK, 2)
    low, high = np.fmin.reduce(blocks, (1, 3)), np.fmax.reduce(blocks, (1, 3))
    return np.stack([low[..., 0], high[..., 0], low[..., 1], high[..., 1]])
