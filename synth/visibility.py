"""What each camera sees of each joint, and what hides it: rays cast through the scene, no images needed."""

import copy
from itertools import pairwise
from typing import NamedTuple

import mujoco
import numpy as np

from dmae.cameras import CameraRig
from dmae.clip import Visibility
from dmae.images import FIRST_OBJECT_ID

_TOUCHING = 0.025
"""A limb that lies this near before another one's joint touches it rather than hides it, m."""
_RAYS_AT_ONCE = 100_000
"""As many are judged together: enough to be quick, few enough to fit in memory."""


class Sight(NamedTuple):
    """What cameras see of joints.

    Attributes:
        visibility: (F, V, P, J) uint8 `Visibility`. What is outside the image or behind the camera is not asked
            what hides it.
        hidden_by: (F, V, P, J) int16 index of the person (its own with `HIDDEN_BY_SELF`) or the object; -1 for none.
        depth_margin: (F, V, P, J) float32 how far before the joint, on the ray to it, what hides it begins, m; the
            joint's distance where the camera itself is within that; NaN where nothing hides it.
    """

    visibility: np.ndarray
    hidden_by: np.ndarray
    depth_margin: np.ndarray


def opaque_model(model: mujoco.MjModel, geom_ids: np.ndarray) -> mujoco.MjModel:
    """A copy in which exactly the geoms with an id stop rays: they are in group 0, and the others in group 5.

    MuJoCo lets rays through whatever is fully transparent, with an id or without.
    """
    opaque = copy.copy(model)
    opaque.geom_group = np.where(np.asarray(geom_ids) > 0, 0, 5)
    return opaque


def joint_visibility(
    model: mujoco.MjModel,
    qpos: np.ndarray,
    joints: np.ndarray,
    depth: np.ndarray,
    geom_ids: np.ndarray,
    rig: CameraRig,
    bodies: np.ndarray | None = None,
) -> Sight:
    """Visibility of every joint in every view.

    A joint lies under the surface. It is visible where the ray to it meets nothing, or first meets the limb that the
    joint lies in, no farther than `depth` in front of it. Another limb of the same person hides it unless it touches
    it. A camera that sits within a thing or another person sees nothing through it.

    Args:
        model: The scene.
        qpos: (F, nq) its state.
        joints: (F, P, J, 3) m, world; NaN where a person is not in the scene.
        depth: (P, J) how far under the surface of its limb a joint may lie, m.
        geom_ids: (ngeom,) what each geom belongs to: 0 nothing, 1 + p person p, 256 + k object k.
        rig: V cameras.
        bodies: (P, J) index of the body that each joint moves with. Its limb is that body with those that are jointed
            to it. By default a person is all one limb.
    """
    xy, along = rig.project(joints)
    visibility = np.full(xy.shape[:-1], Visibility.VISIBLE, np.uint8)
    visibility[~rig.inside(xy)] = Visibility.OUTSIDE_IMAGE
    visibility[along <= 0] = Visibility.BEHIND_CAMERA
    visibility[np.isnan(along)] = Visibility.ABSENT
    hidden_by = np.full(visibility.shape, -1, np.int16)
    margin = np.full(visibility.shape, np.nan, np.float32)
    limbs = _limbs(model, bodies, depth.shape)

    opaque = opaque_model(model, geom_ids)
    data = mujoco.MjData(opaque)
    some = max(1, _RAYS_AT_ONCE // max(1, visibility[:1].size))
    for first in range(0, len(qpos), some):
        block = slice(first, first + some)
        sought = np.nonzero(visibility[block] == Visibility.VISIBLE)
        found = _first_hits(opaque, data, qpos[block], rig.centers, joints[block], sought, depth, limbs, geom_ids)
        for label, value in zip((visibility, hidden_by, margin), found, strict=True):
            label[block][sought] = value
    return Sight(visibility, hidden_by, margin)


def _limbs(model: mujoco.MjModel, bodies: np.ndarray | None, shape: tuple[int, int]) -> np.ndarray:
    """(P, J, nbody) True for the bodies that make up the limb a joint lies in."""
    if bodies is None:
        return np.ones((*shape, model.nbody), bool)
    jointed = np.eye(model.nbody, dtype=bool)
    jointed[np.arange(model.nbody), model.body_parentid] = True
    return (jointed | jointed.T)[bodies]


def _first_hits(opaque, data, qpos, centers, joints, sought, depth, limbs, geom_ids) -> tuple[np.ndarray, ...]:
    """Visibility, owner and margin of what hides them, of joints sought: (R,) frames, views, persons and joints."""
    frame, view, person, joint = sought
    rays = joints[frame, person, joint] - centers[view]
    reach = np.linalg.norm(rays, axis=-1)
    # Skeletons share elbows, wrists, knees and ankles: joints at one place take one ray.
    first = _first_at_place(joints)[person, joint]
    ray = np.full((len(qpos), len(centers), *joints.shape[1:3]), -1)
    ray[sought] = 0
    first = np.where(ray[frame, view, person, first] < 0, joint, first)
    own = np.flatnonzero(first == joint)
    ray[tuple(index[own] for index in sought)] = np.arange(len(own))
    hits = _cast_all(opaque, data, qpos, centers, rays[own] / reach[own, None], frame[own], view[own])
    geom, distance, outward = (hit[ray[frame, view, person, first]] for hit in hits)
    ids = np.where(geom >= 0, geom_ids[geom], 0).astype(int)
    own = ids == person + 1
    # A ray that meets a surface from behind started within it.
    within = np.einsum("rx,rx->r", outward, rays) > 0
    depth = depth[person, joint]
    same_limb = limbs[person, joint, opaque.geom_bodyid[geom]]
    allowed = np.where(same_limb, depth, np.minimum(depth, _TOUCHING))
    hidden = (ids > 0) & np.where(own, distance < reach - allowed, (distance < reach) | within)
    is_object = ids >= FIRST_OBJECT_ID
    code = np.select(
        [~hidden, own, is_object],
        [Visibility.VISIBLE, Visibility.HIDDEN_BY_SELF, Visibility.HIDDEN_BY_OBJECT],
        Visibility.HIDDEN_BY_PERSON,
    )
    owner = np.where(hidden, np.where(is_object, ids - FIRST_OBJECT_ID, ids - 1), -1)
    return code, owner, np.where(hidden, np.where(within, reach, reach - distance), np.nan)


def _first_at_place(joints: np.ndarray) -> np.ndarray:
    """(P, J) first of the joints that are at the same place as a joint in all frames of (F, P, J, 3)."""
    same = (joints[:, :, :, None] == joints[:, :, None]).all((0, -1))
    return (same | np.eye(joints.shape[2], dtype=bool)).argmax(-1)


def _cast_all(opaque, data, qpos, centers, directions, frame, view) -> tuple[np.ndarray, ...]:
    """As `cast`, of rays from the centres of views, in the states of frames; sorted by frame, then by view."""
    hits = np.empty(len(directions), np.int32), np.empty(len(directions)), np.empty_like(directions)
    views = len(centers)
    ends = np.searchsorted(frame * views + view, np.arange(len(qpos) * views), side="right").tolist()
    for number, (start, stop) in enumerate(pairwise([0, *ends])):
        at, seer = divmod(number, views)
        if seer == 0:
            data.qpos[:] = qpos[at]
            mujoco.mj_kinematics(opaque, data)
        for all_hits, some in zip(hits, cast(opaque, data, centers[seer], directions[start:stop]), strict=True):
            all_hits[start:stop] = some
    return hits


def cast(
    model: mujoco.MjModel, data: mujoco.MjData, center: np.ndarray, directions: np.ndarray, groups: tuple = (0,)
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """What rays from one point meet first.

    Args:
        model, data: A scene whose positions are up to date.
        center: (3,) m, world.
        directions: (R, 3) unit vectors, world.
        groups: Which geom groups stop rays.

    Returns:
        geom: (R,) index of the geom met, -1 for none.
        distance: (R,) m, -1 for none.
        outward: (R, 3) the surface's normal; zero for none.
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
    return geom, distance, normal.reshape(count, 3)
