"""Rays cast through a MuJoCo scene."""

import copy
from typing import NamedTuple

import mujoco
import numpy as np

EVERY_GROUP = tuple(range(6))
"""The groups of all geoms, for `cast_rays`."""
# Directions to the corners, edges and faces of a cube.
_AROUND = np.array([d for d in np.ndindex(3, 3, 3) if d != (1, 1, 1)]) - 1.0
_AROUND /= np.linalg.norm(_AROUND, axis=1, keepdims=True)


def at_rest(model: mujoco.MjModel) -> mujoco.MjData:
    """Return the state of a model as it was built, with the positions of its bodies and geoms."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    return data


def opaque_model(model: mujoco.MjModel, geom_ids: np.ndarray) -> mujoco.MjModel:
    """Return a copy of a model in which rays stop only at opaque geoms with an id, group 0; others are in group 5."""
    opaque = copy.copy(model)
    opaque.geom_group = np.where(np.asarray(geom_ids) > 0, 0, 5)
    return opaque


class Hits(NamedTuple):
    """What R rays meet first."""

    geom: np.ndarray  # (R,) index of the geom, -1 for none
    distance: np.ndarray  # (R,) m, -1 for none
    outward: np.ndarray  # (R, 3) outward unit normal of the surface, world; zero for none


def cast_rays(
    model: mujoco.MjModel, data: mujoco.MjData, center: np.ndarray, directions: np.ndarray, groups: tuple = (0,)
) -> Hits:
    """Find the first geom, in groups, that each ray from a point (3,) m, world, meets, with kinematics up to date.

    Args:
        directions: (R, 3) unit vectors, world.
    """
    count = len(directions)
    geom, distance, normal = np.full(count, -1, np.int32), np.full(count, -1.0), np.zeros(3 * count)
    stops = np.zeros(6, np.uint8)
    stops[list(groups)] = 1
    if count:
        mujoco.mj_multiRay(
            model, data, center, np.ascontiguousarray(directions).ravel(),
            stops, 1, -1, geom, distance, normal, count, mujoco.mjMAXVAL,
        )  # fmt: skip
    return Hits(geom, distance, normal.reshape(count, 3))


def geom_around(model: mujoco.MjModel, data: mujoco.MjData, point: np.ndarray, solid: np.ndarray | None = None) -> int:
    """Return the index of a geom around a point (3,) m, world; -1 for none.

    With `solid` (ngeom,), only geoms count for which it is True. Planes have no inside.
    """
    geom, _, outward = cast_rays(model, data, point, _AROUND, EVERY_GROUP)
    # A ray meets a surface from behind only if it starts inside.
    behind = (geom >= 0) & (np.einsum("rx,rx->r", outward, _AROUND) > 1e-3)
    if solid is not None:
        behind &= solid[geom]
    return int(geom[behind][0]) if behind.any() else -1
