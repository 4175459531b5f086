"""Positions of the points on people's surfaces, and their visibility in each camera. No images are needed."""

from dataclasses import dataclass

import mujoco
import numpy as np

from dmae.data.array_fields import short_repr
from dmae.data.cameras import CameraRig
from dmae.data.images import FIRST_OBJECT_ID
from dmae.data.labels import Visibility
from synth.labels.shapes import check_shapes
from synth.labels.surface_points import SurfacePoints
from synth.people.bending import Bending
from synth.rooms.rays import cast_rays, opaque_model
from synth.scene.build import Scene

_FOLD = 0.005
"""Distance below which a surface of the same person in front of a point does not hide it, m: cloth overlaps."""


@dataclass(frozen=True)
class SurfaceLabels:
    """S named points on P people, seen by V cameras in F frames.

    Attributes:
        names: (S,) names of the points, see `synth.labels.surface_points.NAMES`.
        xyz: (F, P, S, 3) float32 m, world.
        normals: (F, P, S, 3) float32 outward unit normals, world.
        visibility: (F, V, P, S) uint8 `dmae.data.labels.Visibility`. As for joints, the first object on the ray from
            the camera counts. A point on a surface that faces away is hidden at least by the person's own body.
        hidden_by: (F, V, P, S) int16 index of the person or object in front, -1 for none.
    """

    names: tuple[str, ...]
    xyz: np.ndarray
    normals: np.ndarray
    visibility: np.ndarray
    hidden_by: np.ndarray

    __repr__ = short_repr

    def __post_init__(self):
        frames, persons, points = self.xyz.shape[:3]
        of_views = (frames, *self.visibility.shape[1:2], persons, points)
        shapes = {"xyz": (frames, persons, len(self.names), 3), "visibility": of_views, "hidden_by": of_views}
        check_shapes("surface", self, shapes | {"normals": self.xyz.shape})


def surface_labels(
    scene: Scene, points: SurfacePoints, names: tuple[str, ...], qpos: np.ndarray, rig: CameraRig
) -> SurfaceLabels:
    """Label points on people's surfaces in every view.

    Args:
        scene: The scene.
        points: (P, S) points on its people.
        names: (S,) names of the points.
        qpos: (F, nq) states of the scene.
        rig: V cameras.
    """
    opaque = opaque_model(scene.model, scene.geom_ids)
    data, bending, shape = mujoco.MjData(opaque), Bending(opaque), points.geoms.shape
    xyz, normals = (np.empty((len(qpos), *shape, 3)) for _ in range(2))
    visibility = np.empty((len(qpos), len(rig), *shape), np.uint8)
    hidden_by = np.full(visibility.shape, -1, np.int16)
    for frame, state in enumerate(qpos):
        data.qpos[:] = state
        mujoco.mj_kinematics(opaque, data)
        bending.apply(data)
        xyz[frame], normals[frame] = points.at(data)
        xy, along = rig.project(xyz[frame][None])
        codes = visibility[frame]
        codes[:] = np.where(rig.inside(xy)[0], Visibility.VISIBLE, Visibility.OUTSIDE_IMAGE)
        codes[along[0] <= 0] = Visibility.BEHIND_CAMERA
        for view, centre in enumerate(rig.centers):
            sought = np.nonzero(codes[view] == Visibility.VISIBLE)
            rays = xyz[frame][sought] - centre
            averted = (rays * normals[frame][sought]).sum(-1) >= 0
            codes[view][sought], hidden_by[frame, view][sought] = _seen(
                opaque, data, scene.geom_ids, centre, rays, sought[0], averted
            )
    return SurfaceLabels(names, xyz.astype(np.float32), normals.astype(np.float32), visibility, hidden_by)


def _seen(
    opaque: mujoco.MjModel,
    data: mujoco.MjData,
    ids: np.ndarray,
    centre: np.ndarray,
    rays: np.ndarray,
    persons: np.ndarray,
    averted: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the visibility and the occluder, (R,) each, of points at the ends of rays from a camera.

    Args:
        opaque, data: The scene and its state.
        ids: (ngeom,) ids of the owners of geoms.
        centre: (3,) centre of the camera, m, world.
        rays: (R, 3) vectors from the centre to the points, m.
        persons: (R,) indices of the persons of the points.
        averted: (R,) whether the surface at a point faces away from the camera.
    """
    reach = np.linalg.norm(rays, axis=-1)
    rays = rays / np.maximum(reach, 1e-9)[:, None]
    geom, distance, outward = cast_rays(opaque, data, centre, rays)
    found = np.where(geom >= 0, ids[geom], 0).astype(int)
    own = found == persons + 1
    # A ray that meets a surface from behind began inside the object.
    within = (outward * rays).sum(-1) > 0
    before = (found > 0) & np.where(own, distance < reach - _FOLD, (distance < reach) | within)
    found, hidden = np.where(before, found, persons + 1), before | averted
    own, is_object = found == persons + 1, found >= FIRST_OBJECT_ID
    codes = np.select(
        [~hidden, own, is_object],
        [Visibility.VISIBLE, Visibility.HIDDEN_BY_SELF, Visibility.HIDDEN_BY_OBJECT],
        Visibility.HIDDEN_BY_PERSON,
    )
    return codes, np.where(hidden, np.where(is_object, found - FIRST_OBJECT_ID, found - 1), -1)
