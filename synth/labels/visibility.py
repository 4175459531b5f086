"""Label the visibility of joints by rays cast through the scene. No images are needed."""

from itertools import pairwise

import mujoco
import numpy as np

from dmae.data.cameras import CameraRig
from dmae.data.images import FIRST_OBJECT_ID
from dmae.data.labels import OcclusionLabels, Visibility
from synth.people.skinning import Skin
from synth.rooms.rays import Hits, cast_rays, opaque_model

CONTACT = 0.025
"""Distance below which a limb in front of another limb's joint is in contact with it and does not hide it, m."""
_RAYS_AT_ONCE = 100_000
"""Number of rays that are processed together: enough for speed, and few enough for the memory."""


def joint_visibility(
    model: mujoco.MjModel,
    qpos: np.ndarray,
    joints: np.ndarray,
    depth: np.ndarray,
    geom_ids: np.ndarray,
    rig: CameraRig,
    bodies: np.ndarray | None = None,
    objects: tuple[str, ...] = (),
    seconds: np.ndarray | None = None,
) -> OcclusionLabels:
    """Label every joint in every view.

    A joint is under the surface of its limb. It is visible if the ray to it hits nothing, or first hits its limb at
    most `depth` in front of the joint. Another limb of the same person hides the joint, unless that limb is in contact
    with it. A camera inside an object or another person sees nothing.

    Args:
        qpos: (F, nq) states of the scene.
        joints: (F, P, J, 3) m, world; NaN where a person is not in the scene.
        depth: (P, J) greatest depth of a joint under the surface of its limb, m.
        geom_ids: (ngeom,) id of the owner of each geom: 0 none, 1 + p person p, 256 + k object k.
        rig: V cameras.
        bodies: (P, J) index of the body that each joint moves with. Its limb is that body and its neighbours in the
            kinematic tree. By default a whole person is one limb.
        objects: Names of the objects.
        seconds: (F,) times of the states in the clip, s, which shapes of hands follow; by default all are 0.

    Returns:
        `visibility`, `occluder` and `depth_margin`. Joints outside the image or behind the camera have no occluder. If
        the camera is inside the occluder, the margin is the distance from the camera to the joint.
    """
    xy, along = rig.project(joints)
    visibility = np.full(xy.shape[:-1], Visibility.VISIBLE, np.uint8)
    visibility[~rig.inside(xy)] = Visibility.OUTSIDE_IMAGE
    visibility[along <= 0] = Visibility.BEHIND_CAMERA
    visibility[np.isnan(along)] = Visibility.ABSENT
    occluder = np.full(visibility.shape, -1, np.int16)
    margin = np.full(visibility.shape, np.nan, np.float32)
    labels: tuple[np.ndarray, ...] = (visibility, occluder, margin)
    limbs = _limbs(model, bodies, depth.shape)

    opaque = opaque_model(model, geom_ids)
    seconds = np.zeros(len(qpos)) if seconds is None else seconds
    some = max(1, _RAYS_AT_ONCE // max(1, visibility[:1].size))
    for first in range(0, len(qpos), some):
        block = slice(first, first + some)
        sought = np.nonzero(visibility[block] == Visibility.VISIBLE)
        states = qpos[block], seconds[block]
        found = _seen_or_hidden(opaque, states, rig.centers, joints[block], sought, depth, limbs, geom_ids)
        for label, value in zip(labels, found, strict=True):
            label[block][sought] = value
    return OcclusionLabels(visibility, occluder, margin, objects=objects)


def _limbs(model: mujoco.MjModel, bodies: np.ndarray | None, shape: tuple[int, int]) -> np.ndarray:
    """Return (P, J, nbody) True for the bodies of the limb that contains each joint."""
    if bodies is None:
        return np.ones((*shape, model.nbody), bool)
    connected = np.eye(model.nbody, dtype=bool)
    connected[np.arange(model.nbody), model.body_parentid] = True
    return (connected | connected.T)[bodies]


def _seen_or_hidden(
    opaque: mujoco.MjModel,
    states: tuple[np.ndarray, np.ndarray],
    centers: np.ndarray,
    joints: np.ndarray,
    sought: tuple[np.ndarray, ...],
    depth: np.ndarray,
    limbs: np.ndarray,
    geom_ids: np.ndarray,
) -> tuple[np.ndarray, ...]:
    """Return visibility, occluder and margin (R,) of the joints `sought`: (R,) frames, views, persons and joints."""
    frame, view, person, joint = sought
    rays = joints[frame, person, joint] - centers[view]
    reach = np.linalg.norm(rays, axis=-1)
    # The joined skeletons share elbows, wrists, knees and ankles: joints at the same place need only one ray.
    first = _first_at_place(joints)[person, joint]
    ray = np.full((len(joints), len(centers), *joints.shape[1:3]), -1)
    ray[sought] = 0
    first = np.where(ray[frame, view, person, first] < 0, joint, first)
    own = np.flatnonzero(first == joint)
    ray[tuple(index[own] for index in sought)] = np.arange(len(own))
    cast = _cast_all(opaque, states, centers, rays[own] / reach[own, None], frame[own], view[own])
    hits = Hits(*(hit[ray[frame, view, person, first]] for hit in cast))
    depth = depth[person, joint]
    same_limb = limbs[person, joint, opaque.geom_bodyid[hits.geom]]
    allowed = np.where(same_limb, depth, np.minimum(depth, CONTACT))
    return point_visibility(hits, rays, reach, person, geom_ids, allowed)


def point_visibility(
    hits: Hits,
    rays: np.ndarray,
    reach: np.ndarray,
    person: np.ndarray,
    geom_ids: np.ndarray,
    allowed: np.ndarray | float,
    averted: np.ndarray | bool = False,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return `Visibility`, index of the occluder, -1 for none, and its margin in depth, m, (R,) each, of points on
    persons.

    Args:
        hits: What rays from cameras to the points meet first.
        rays: (R, 3) directions of the rays.
        reach: (R,) distance of each point from its camera, m.
        person: (R,) person of each point.
        geom_ids: As for `joint_visibility`.
        allowed: (R,) distance before a point, m, within which its own person does not hide it.
        averted: (R,) whether the surface at a point faces away, so that at least its own person hides it.
    """
    ids = np.where(hits.geom >= 0, geom_ids[hits.geom], 0).astype(int)
    # A ray that hits a surface from behind started inside the object.
    within = np.einsum("rx,rx->r", hits.outward, rays) > 0
    in_front = np.where(ids == person + 1, hits.distance < reach - allowed, (hits.distance < reach) | within)
    before = (ids > 0) & in_front
    margin = np.where(before, np.where(within, reach, reach - hits.distance), np.nan)
    ids, hidden = np.where(before, ids, person + 1), before | averted
    is_object = ids >= FIRST_OBJECT_ID
    codes = np.select(
        [~hidden, ids == person + 1, is_object],
        [Visibility.VISIBLE, Visibility.HIDDEN_BY_SELF, Visibility.HIDDEN_BY_OBJECT],
        Visibility.HIDDEN_BY_PERSON,
    )
    return codes, np.where(hidden, np.where(is_object, ids - FIRST_OBJECT_ID, ids - 1), -1), margin


def _first_at_place(joints: np.ndarray) -> np.ndarray:
    """Return (P, J) for each joint the first joint that is at the same place in all frames of (F, P, J, 3)."""
    same = (joints[:, :, :, None] == joints[:, :, None]).all((0, -1))
    return (same | np.eye(joints.shape[2], dtype=bool)).argmax(-1)


def _cast_all(
    opaque: mujoco.MjModel,
    states: tuple[np.ndarray, np.ndarray],
    centers: np.ndarray,
    directions: np.ndarray,
    frame: np.ndarray,
    view: np.ndarray,
) -> Hits:
    """Cast rays from the camera centres of views in the states of frames, (F, nq), and times, (F,) s. Rays are sorted
    by frame, then by view."""
    hits = Hits(np.empty(len(directions), np.int32), np.empty(len(directions)), np.empty_like(directions))
    data, views, skin, (qpos, seconds) = mujoco.MjData(opaque), len(centers), Skin(opaque, normals=False), states
    ends = np.searchsorted(frame * views + view, np.arange(len(qpos) * views), side="right").tolist()
    for number, (start, stop) in enumerate(pairwise([0, *ends])):
        at, seer = divmod(number, views)
        if seer == 0:
            data.qpos[:] = qpos[at]
            mujoco.mj_kinematics(opaque, data)
            skin.apply(data, seconds[at])
        for all_hits, some in zip(hits, cast_rays(opaque, data, centers[seer], directions[start:stop]), strict=True):
            all_hits[start:stop] = some
    return hits
