"""The floor space that rooms and props cover, as discs."""

from functools import lru_cache
from pathlib import Path

import mujoco
import numpy as np

from synth.rooms.mjcf import compile_mjcf

_TALLEST = 2.2
"""Height above which objects do not restrict people, m."""


@lru_cache(maxsize=32)
def footprints(path: Path) -> np.ndarray:
    """Return the (K, 3) `discs` of the obstacles in an MJCF file, m."""
    return discs(compile_mjcf(path))


def discs(model: mujoco.MjModel) -> np.ndarray:
    """Return (K, 3) x, y and radius of discs that cover the obstacles of a model, m.

    Each body counts as a rectangle along its own axes. A row of discs along the longer side covers it.
    """
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    found = [np.empty((0, 3))]
    obstacles = (model.geom_type != mujoco.mjtGeom.mjGEOM_PLANE) & (model.geom_contype | model.geom_conaffinity > 0)
    for body in range(model.nbody):
        geoms = np.flatnonzero((model.geom_bodyid == body) & obstacles)
        if body and len(geoms):
            found.append(_cover(model, data, body, geoms))
        else:
            found += [_cover(model, data, body, geoms[i : i + 1]) for i in range(len(geoms))]
    return np.concatenate(found)


def geom_corners(model: mujoco.MjModel, data: mujoco.MjData, geoms: np.ndarray) -> np.ndarray:
    """Return (G, 8, 3) corners of boxes around geoms (G,), m, world. The kinematics of `data` must be up to date."""
    corners = np.array(np.meshgrid(*[(-1, 1)] * 3)).reshape(3, -1).T
    boxes = model.geom_aabb[geoms]
    local = boxes[:, None, :3] + corners * boxes[:, None, 3:]
    return data.geom_xpos[geoms][:, None] + local @ data.geom_xmat[geoms].reshape(-1, 3, 3).transpose(0, 2, 1)


def _cover(model: mujoco.MjModel, data: mujoco.MjData, body: int, geoms: np.ndarray) -> np.ndarray:
    world = geom_corners(model, data, geoms)
    if world[..., 2].min() > _TALLEST:
        return np.empty((0, 3))
    axes = data.xmat[body].reshape(3, 3)[:2, :2]
    flat = world[..., :2].reshape(-1, 2) @ axes
    low, high = flat.min(0), flat.max(0)
    half = (high - low) / 2
    long, short = (0, 1) if half[0] >= half[1] else (1, 0)
    count = int(np.clip(np.ceil(half[long] / max(half[short], 0.05)), 1, 12))
    centres = np.tile((low + high) / 2, (count, 1))
    centres[:, long] = low[long] + (np.arange(count) + 0.5) * 2 * half[long] / count
    radius = np.hypot(half[short], half[long] / count)
    return np.column_stack([centres @ axes.T, np.full(count, radius)])
