"""Rooms and things in MJCF files: where they are, and how much floor they take.

A room has its floor at z = 0 and people about the origin; a material "floor" and a material "wall", which are covered
with the finishes that its custom texts of these names list (`synth.decor`); and lights. Materials called "tint..." take
any colour. Its geoms touch people (contype 0, all bits of conaffinity), but for decoration, which takes no room. Walls
are planes, so that cameras look through them from outside.
"""

from functools import lru_cache
from pathlib import Path

import mujoco
import numpy as np

from dmae.resources import resource_folder

_TALLEST = 2.2
"""Nobody reaches higher, m."""


def arena_file(name: str) -> Path:
    """The MJCF file of a room: one of `scenes/`, or a path to another.

    Raises:
        ValueError: there is neither; the message lists the rooms there are.
    """
    return _find(name, resource_folder("synth", "scenes"), "arena")


def prop_file(name: str) -> Path:
    """The MJCF file of a prop: one of `scenes/props/`, or a path to another. Raises as `arena_file` does."""
    return _find(name, resource_folder("synth", "scenes") / "props", "prop")


def _find(name: str, folder: Path, what: str) -> Path:
    for path in (folder / f"{name}.xml", Path(name)):
        if path.is_file():
            return path
    known = sorted(path.stem for path in folder.glob("*.xml"))
    raise ValueError(f"no {what} {name!r}: expected one of {known}, or the path of an MJCF file")


@lru_cache(maxsize=32)
def footprints(path: Path) -> np.ndarray:
    """`discs` of what stands in the way in an MJCF file."""
    return discs(mujoco.MjModel.from_xml_path(str(path)))


def discs(model: mujoco.MjModel) -> np.ndarray:
    """(K, 3) x, y and radius of discs that cover what stands in the way in a model, m.

    A body is taken as a rectangle along its own axes, and that covered by discs along its longer side.
    """
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    found = [np.empty((0, 3))]
    in_the_way = (model.geom_type != mujoco.mjtGeom.mjGEOM_PLANE) & (model.geom_contype | model.geom_conaffinity > 0)
    for body in range(model.nbody):
        geoms = np.flatnonzero((model.geom_bodyid == body) & in_the_way)
        if body and len(geoms):
            found.append(_cover(model, data, body, geoms))
        else:
            found += [_cover(model, data, body, geoms[i : i + 1]) for i in range(len(geoms))]
    return np.concatenate(found)


def geom_corners(model: mujoco.MjModel, data: mujoco.MjData, geoms: np.ndarray) -> np.ndarray:
    """(G, 8, 3) corners of the boxes around geoms (G,), m, world; kinematics are up to date."""
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
