"""What each camera sees of each joint, and what hides it: rays cast through the scene, no images needed."""

import copy

import mujoco
import numpy as np

from dmae.cameras import CameraRig
from dmae.clip import Visibility
from dmae.images import FIRST_OBJECT_ID


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
) -> tuple[np.ndarray, np.ndarray]:
    """Visibility of every joint in every view.

    A joint lies under the surface. It is visible where the ray to it meets nothing, or meets its own person no
    farther than `depth` in front of it. A camera that sits within a thing or another person sees nothing through it.

    Args:
        model: The scene.
        qpos: (F, nq) its state.
        joints: (F, P, J, 3) m, world; NaN where a person is not in the scene.
        depth: (P, J) how far under its person's surface a joint may lie, m.
        geom_ids: (ngeom,) what each geom belongs to: 0 nothing, 1 + p person p, 256 + k object k.
        rig: V cameras.

    Returns:
        visibility: (F, V, P, J) uint8 `Visibility`. What is outside the image or behind the camera is not asked
            what hides it.
        hidden_by: (F, V, P, J) int16 index of the person (its own with `HIDDEN_BY_SELF`) or the object; -1 for none.
    """
    xy, along = rig.project(joints)
    visibility = np.full(xy.shape[:-1], Visibility.VISIBLE, np.uint8)
    visibility[~rig.inside(xy)] = Visibility.OUTSIDE_IMAGE
    visibility[along <= 0] = Visibility.BEHIND_CAMERA
    visibility[np.isnan(along)] = Visibility.ABSENT
    hidden_by = np.full(visibility.shape, -1, np.int16)

    opaque = opaque_model(model, geom_ids)
    data = mujoco.MjData(opaque)
    for frame, state in enumerate(qpos):
        data.qpos[:] = state
        mujoco.mj_kinematics(opaque, data)
        for view, center in enumerate(rig.centers):
            person, joint = np.nonzero(visibility[frame, view] == Visibility.VISIBLE)
            code, owner = _first_hits(
                opaque, data, center, joints[frame, person, joint], person, depth[person, joint], geom_ids
            )
            visibility[frame, view, person, joint] = code
            hidden_by[frame, view, person, joint] = owner
    return visibility, hidden_by


def _first_hits(opaque, data, center, points, person, depth, geom_ids) -> tuple[np.ndarray, np.ndarray]:
    """Visibility and owner of what hides them, of (R, 3) points of (R,) persons, seen from one place."""
    rays = points - center
    reach = np.linalg.norm(rays, axis=-1)
    geom, distance, outward = cast(opaque, data, center, rays / reach[:, None])
    ids = np.where(geom >= 0, geom_ids[geom], 0).astype(int)
    own = ids == person + 1
    # A ray that meets a surface from behind started within it.
    within = np.einsum("rx,rx->r", outward, rays) > 0
    hidden = (ids > 0) & np.where(own, distance < reach - depth, (distance < reach) | within)
    is_object = ids >= FIRST_OBJECT_ID
    code = np.select(
        [~hidden, own, is_object],
        [Visibility.VISIBLE, Visibility.HIDDEN_BY_SELF, Visibility.HIDDEN_BY_OBJECT],
        Visibility.HIDDEN_BY_PERSON,
    )
    return code, np.where(hidden, np.where(is_object, ids - FIRST_OBJECT_ID, ids - 1), -1)


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
    stops = np.isin(np.arange(6), groups).astype(np.uint8)
    if count:
        mujoco.mj_multiRay(
            model, data, center, np.ascontiguousarray(directions).ravel(),
            stops, 1, -1, geom, distance, normal, count, mujoco.mjMAXVAL,
        )  # fmt: skip
    return geom, distance, normal.reshape(count, 3)
