"""Rooms and things in MJCF files: where they are, and how much floor they take."""

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
    """(K, 3) x, y and radius of discs that cover what stands in the way in an MJCF file, m.

    A body is taken as a rectangle along its own axes, and that covered by discs along its longer side.
    """
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    discs = [np.empty((0, 3))]
    for body in range(model.nbody):
        geoms = np.flatnonzero((model.geom_bodyid == body) & (model.geom_type != mujoco.mjtGeom.mjGEOM_PLANE))
        if body and len(geoms):
            discs.append(_cover(model, data, body, geoms))
        else:
            discs += [_cover(model, data, body, geoms[i : i + 1]) for i in range(len(geoms))]
    return np.concatenate(discs)


def _cover(model: mujoco.MjModel, data: mujoco.MjData, body: int, geoms: np.ndarray) -> np.ndarray:
    corners = np.array(np.meshgrid(*[(-1, 1)] * 3)).reshape(3, -1).T
    boxes = model.geom_aabb[geoms]
    local = boxes[:, None, :3] + corners * boxes[:, None, 3:]
    world = data.geom_xpos[geoms][:, None] + local @ data.geom_xmat[geoms].reshape(-1, 3, 3).transpose(0, 2, 1)
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
