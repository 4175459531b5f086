"""512 named points on each person's visible surface, clothes and hair included: who sees them, and what they touch."""

import copy
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import mujoco
import numpy as np

from dmae.data.array_fields import set_array, short_repr
from dmae.data.cameras import CameraRig
from dmae.data.clip import Clip
from dmae.data.images import FIRST_OBJECT_ID
from dmae.data.labels import Visibility
from synth.labels.visibility import point_visibility
from synth.people.body import HEAD_HEIGHT, PARENTS, SEGMENTS, SIDES, Body, side_and_name
from synth.people.skinning import Skin, locate, mesh_triangles
from synth.rooms.rays import at_rest, cast_rays, opaque_model
from synth.scene.build import Scene

# The points

_TRUNK = ("pelvis", "spine", "chest")
_HAND = 0.092
"""Length of the hand, fraction of stature."""
_FOOT = ((-0.037, 0.0, -0.020), (0.106, 0.0, -0.026))
"""Ends of an axis inside the shoe, relative to the ankle, fractions of stature."""
_BESIDE = ("brim", "bag", "strap")
"""Materials of parts that stand off the body: no points are on them."""
_RAY_START = 1.0
"""Distance from an axis at which the rays to the surface begin, m."""


class _Rings(NamedTuple):
    directions: tuple[str, ...]  # Names of the directions around the axis, evenly spaced
    first: Sequence[int]  # (3,); the first direction, in T-pose
    second: Sequence[int]  # (3,); the direction towards which the following ones turn, on the left side of the body
    shares: tuple[float, ...]  # Positions of the rings along the axis: 0 at its beginning, 1 at its end


_X, _Y, _Z = np.eye(3, dtype=int).tolist()
_ROUND = ("front", "front_left", "left", "back_left", "back", "back_right", "right", "front_right")
_ARM, _LEG, _SHOE = (
    ("front", "front_top", "top", "back_top", "back", "back_under", "under", "front_under"),
    ("front", "front_outer", "outer", "back_outer", "back", "back_inner", "inner", "front_inner"),
    ("top", "outer", "sole", "inner"),
)
_RINGS = {
    "pelvis": _Rings(_ROUND, _X, _Y, (-0.2, 0.1, 0.4, 0.75)),
    "spine": _Rings(_ROUND, _X, _Y, (0.1, 0.35, 0.6, 0.85)),
    "chest": _Rings(_ROUND, _X, _Y, (0.1, 0.18, 0.26, 0.34, 0.42, 0.50)),
    "head": _Rings(_ROUND, _X, _Y, (0.27, 0.35, 0.43, 0.51, 0.59, 0.67, 0.75, 0.83)),
    "upper_arm": _Rings(_ARM, _X, _Z, (0.3, 0.48, 0.66, 0.84)),
    "forearm": _Rings(_ARM, _X, _Z, (0.2, 0.4, 0.6, 0.8)),
    "hand": _Rings(_ARM, _X, _Z, (0.25, 0.5)),
    "thigh": _Rings(_LEG, _X, _Y, (0.3, 0.48, 0.66, 0.84)),
    "shin": _Rings(_LEG, _X, _Y, (0.15, 0.38, 0.61, 0.84)),
    "foot": _Rings(_SHOE, _Z, _Y, (0.2, 0.35, 0.5, 0.62, 0.74, 0.85)),
}

NAMES = tuple(
    f"{segment}.{ring}.{direction}"
    for segment in SEGMENTS
    for ring in range(1, 1 + len(_RINGS[side_and_name(segment)[1]].shares))
    for direction in _RINGS[side_and_name(segment)[1]].directions
)
"""The 512 names: `<segment>.<ring>.<direction>`. Rings are counted from the joint of the segment, on a foot from its
heel. Directions refer to a person that faces forward, with arms stretched to the sides and palms down: `outer` is away
from the middle, and `under` of a hand is its palm."""


class SurfacePoints(NamedTuple):
    """Points on P people, each in a triangle of a geom's mesh."""

    geoms: np.ndarray  # (P, 512) index of the geom that each point belongs to
    vertices: np.ndarray  # (P, 512, 3) indices into the model's `mesh_vert` of the corners of the triangle
    shares: np.ndarray  # (P, 512, 3) shares of the corners in the point, sum 1

    def at(self, model: mujoco.MjModel, data: mujoco.MjData) -> tuple[np.ndarray, np.ndarray]:
        """Return points, m, and outward unit normals, (P, 512, 3) each, world.

        Args:
            model, data: A state of the scene, after `synth.people.skinning.Skin` was applied to it.
        """
        turns = data.geom_xmat[self.geoms].reshape(*self.geoms.shape, 3, 3)
        meshes = model.geom_dataid[self.geoms]
        corners = self.vertices + (model.mesh_normaladr - model.mesh_vertadr)[meshes][..., None]
        points, normals = (
            np.einsum("psij,psk,pskj->psi", turns, self.shares, values.astype(float))
            for values in (model.mesh_vert[self.vertices], model.mesh_normal[corners])
        )
        return data.geom_xpos[self.geoms] + points, normals / np.linalg.norm(normals, axis=-1, keepdims=True)


def surface_points(scene: Scene, bodies: list[Body]) -> SurfacePoints:
    """Return the points on the people of a scene, where rays towards the axes of their segments meet them in T-pose.

    Raises ValueError if a ray for a point does not meet the surface of the person.

    Args:
        scene: The scene, with people in T-pose.
        bodies: Proportions of P people.
    """
    model = copy.copy(scene.model)
    data = at_rest(model)
    names = [model.geom(geom).name.rpartition("/")[2].rstrip("0123456789") for geom in range(model.ngeom)]
    on_body = ~np.isin(names, _BESIDE)
    # Before the clip hands are relaxed, whatever shapes they have later.
    Skin(model).apply(data, -np.inf)
    found = [
        _points_of((scene.geom_ids == 1 + person) & on_body, model, data, person, body)
        for person, body in enumerate(bodies)
    ]
    return SurfacePoints(*(np.stack(part) for part in zip(*found, strict=True)))


def _points_of(surface: np.ndarray, model: mujoco.MjModel, data: mujoco.MjData, person: int, body: Body) -> tuple:
    """Return the fields of `SurfacePoints` for one person in T-pose, on the geoms of a surface (ngeom,)."""
    ids = model.body(f"person{person}/{SEGMENTS[0]}").id + np.arange(len(SEGMENTS))
    found = []
    for number, segment in enumerate(SEGMENTS):
        side, name = side_and_name(segment)
        # The surface near a joint may belong to either of its segments. Rays pass through the others' surfaces.
        own = [SEGMENTS.index(each) for each in _TRUNK] if name in _TRUNK else [number]
        near = [i for i, parent in enumerate(PARENTS) if parent in own or i in (*own, PARENTS[number])]
        groups = [np.where(surface & np.isin(model.geom_bodyid, ids[which]), 0, 5) for which in (own, near)]
        rings = _RINGS[name]
        start, end = (data.xpos[ids[number]] + point for point in _axis(body, number))
        angles = 2 * np.pi * np.arange(len(rings.directions)) / len(rings.directions)
        second = np.array(rings.second) * (1, SIDES.get(side, 1.0), 1)
        for share in rings.shares:
            for angle in angles:
                outward = np.cos(angle) * np.array(rings.first) + np.sin(angle) * second
                for model.geom_group in groups:
                    met = _meet(model, data, start + share * (end - start), outward)
                    if met[0] >= 0:
                        break
                found.append(met)
    geoms, points = (np.array(part) for part in zip(*found, strict=True))
    if (geoms < 0).any():
        raise ValueError(f"person {person} has no surface at {NAMES[int(np.argmin(geoms))]}")
    vertices, shares = np.empty((len(geoms), 3), int), np.empty((len(geoms), 3))
    for geom in np.unique(geoms):
        mesh, own = model.geom_dataid[geom], geoms == geom
        places = (points[own] - data.geom_xpos[geom]) @ data.geom_xmat[geom].reshape(3, 3)
        triangles, shares[own] = locate(mesh_triangles(model, geom), places)
        vertices[own] = model.mesh_vertadr[mesh] + model.mesh_face[model.mesh_faceadr[mesh] + triangles]
    return geoms, vertices, shares


def _axis(body: Body, number: int) -> tuple[np.ndarray, np.ndarray]:
    """Return both ends of the axis of a segment, relative to its joint, in T-pose, m."""
    side, name = side_and_name(SEGMENTS[number])
    if name == "foot":
        heel, toe = (np.array(end) * body.stature for end in _FOOT)
        return heel, toe
    if name == "head":
        end = np.array((0, 0, HEAD_HEIGHT * body.head)) * body.stature
    elif name == "hand":
        end = np.array((0, SIDES[side] * _HAND * body.arms, 0)) * body.stature
    else:
        end = body.offsets[PARENTS.index(number)]
    return np.zeros(3), end


def _meet(model: mujoco.MjModel, data: mujoco.MjData, middle: np.ndarray, outward: np.ndarray) -> tuple:
    """Return the geom and the point where a ray from outside towards `middle` first meets a surface."""
    geom, distance, _ = cast_rays(model, data, middle + _RAY_START * outward, -outward[None])
    return geom[0], middle + (_RAY_START - distance[0]) * outward


# Their positions, and their visibility in each camera; no images are needed

_FOLD = 0.005
"""Distance below which a surface of the same person in front of a point does not hide it, m: cloth overlaps."""
_TOUCH, _OVERLAP = 0.01, 0.04
"""Greatest distance from a point to a surface that it touches, and greatest overlap of the two, m."""


@dataclass(frozen=True)
class SurfaceLabels:
    """S named points on P people, seen by V cameras in F frames."""

    names: tuple[str, ...]  # (S,) names of the points, see `synth.labels.surfaces.NAMES`
    xyz: np.ndarray  # (F, P, S, 3) float32 m, world
    normals: np.ndarray  # (F, P, S, 3) float32 outward unit normals, world
    # (F, V, P, S) uint8 `dmae.data.labels.Visibility`. As for joints, the first object on the ray from the camera
    # counts. A point on a surface that faces away is hidden at least by the person's own body.
    visibility: np.ndarray
    hidden_by: np.ndarray  # (F, V, P, S) int16 index of the person or object in front, -1 for none
    # (F, P, S) uint16 what a point touches, as in id images: 0 nothing, 1 + p another person p, 256 + k object k. A
    # point touches what is nearer than 10 mm along its normal, or overlaps it by up to 40 mm. Floor and walls are
    # objects.
    touches: np.ndarray

    __repr__ = short_repr

    def __post_init__(self):
        set_array(self, "xyz", np.float32, ("F", "P", len(self.names), 3))
        frames, *points = self.xyz.shape[:3]
        set_array(self, "normals", np.float32, self.xyz.shape)
        set_array(self, "visibility", np.uint8, (frames, "V", *points))
        set_array(self, "hidden_by", np.int16, self.visibility.shape)
        set_array(self, "touches", np.uint16, (frames, *points))


def surface_labels(
    scene: Scene, points: SurfacePoints, qpos: np.ndarray, rig: CameraRig, seconds: np.ndarray | None = None
) -> SurfaceLabels:
    """Label points on people's surfaces: where they are, who sees them, and what they touch.

    Args:
        points: (P, S) points on its people.
        qpos: (F, nq) states of the scene.
        rig: V cameras.
        seconds: (F,) times of the states in the clip, s, which shapes of hands follow; by default all are 0.
    """
    opaque = opaque_model(scene.model, scene.geom_ids)
    data, skin, shape = mujoco.MjData(opaque), Skin(opaque), points.geoms.shape
    xyz, normals = (np.empty((len(qpos), *shape, 3)) for _ in range(2))
    visibility = np.empty((len(qpos), len(rig), *shape), np.uint8)
    hidden_by = np.full(visibility.shape, -1, np.int16)
    touches = np.zeros(xyz.shape[:3], np.uint16)
    for frame, (state, now) in enumerate(zip(qpos, np.zeros(len(qpos)) if seconds is None else seconds, strict=True)):
        data.qpos[:] = state
        mujoco.mj_kinematics(opaque, data)
        skin.apply(data, now)
        xyz[frame], normals[frame] = points.at(opaque, data)
        touches[frame] = _touched(opaque, data, scene.geom_ids, xyz[frame], normals[frame])
        xy, along = rig.project(xyz[frame][None])
        codes = visibility[frame]
        codes[:] = np.where(rig.inside(xy)[0], Visibility.VISIBLE, Visibility.OUTSIDE_IMAGE)
        codes[along[0] <= 0] = Visibility.BEHIND_CAMERA
        for view, centre in enumerate(rig.centers):
            sought = np.nonzero(codes[view] == Visibility.VISIBLE)
            rays = xyz[frame][sought] - centre
            averted = (rays * normals[frame][sought]).sum(-1) >= 0
            reach = np.linalg.norm(rays, axis=-1)
            rays /= np.maximum(reach, 1e-9)[:, None]
            hits = cast_rays(opaque, data, centre, rays)
            codes[view][sought], hidden_by[frame, view][sought], _ = point_visibility(
                hits, rays, reach, sought[0], scene.geom_ids, _FOLD, averted
            )
    return SurfaceLabels(NAMES, xyz, normals, visibility, hidden_by, touches)


def _touched(
    opaque: mujoco.MjModel, data: mujoco.MjData, ids: np.ndarray, points: np.ndarray, normals: np.ndarray
) -> np.ndarray:
    """Return the ids (P, S) of what points (P, S, 3) touch, 0 for nothing.

    A ray along each normal leaves the person, and ends at a surface that faces the point.
    """
    found, geom, facing = np.zeros(points.shape[:2], np.uint16), np.zeros(1, np.int32), np.zeros(3)
    groups, stops = opaque.geom_group.copy(), np.array([1, 0, 0, 0, 0, 0], np.uint8)
    # Geoms whose bounding spheres are far from all points of a person cannot touch any.
    planes = opaque.geom_rbound <= 0
    for person, (places, outward) in enumerate(zip(points, normals, strict=True)):
        low, high = places.min(0) - _TOUCH, places.max(0) + _TOUCH
        gap = np.maximum(np.maximum(low - data.geom_xpos, data.geom_xpos - high), 0)
        near = planes | ((gap**2).sum(-1) <= opaque.geom_rbound**2)
        opaque.geom_group = np.where((ids != 1 + person) & near, groups, 5)
        for number, (place, normal) in enumerate(zip(places, outward, strict=True)):
            start = place - _OVERLAP * normal
            reach = mujoco.mj_ray(opaque, data, start, normal, stops, 1, -1, geom, facing)
            if 0 <= reach <= _OVERLAP + _TOUCH and facing @ normal < 0:
                found[person, number] = ids[geom[0]]
    opaque.geom_group = groups
    return found


# Comparison of visibility labels with id images


class PixelAgreement(NamedTuple):
    """The agreement between the labels of joints and the pixels at their projections."""

    # (4,) number of compared joints: visible, hidden by their own person, by another person, by an object
    compared: np.ndarray
    agreeing: np.ndarray  # (4,) number of these joints with a pixel that agrees


def agreement(clip: Clip, surface: SurfaceLabels | None = None) -> PixelAgreement:
    """Compare visibility labels with id images: the pixel of a joint must show its person or its occluder.

    Points outside the image are left out, and those nearer to any silhouette than 5 px, or 2 px for points on the
    surface, because their pixels are ambiguous. The top of the head is left out as well, because Shelf's annotators put
    it into the air in front of the brow.

    Args:
        clip: A clip with truth, visibility and id images. Its true cameras are used.
        surface: Its surface points, which are then compared instead of joints.
    """
    if surface:
        points, visibility, hidden_by, margin = surface.xyz, surface.visibility, surface.hidden_by, 2
        which = np.ones(len(surface.names), bool)
    else:
        assert clip.truth is not None and clip.occlusion is not None and clip.occlusion.occluder is not None
        points, visibility, hidden_by, margin = clip.truth.xyz, clip.occlusion.visibility, clip.occlusion.occluder, 5
        which = np.array([not name.endswith("top_head") for name in clip.truth.skeleton.joints])
    assert clip.images is not None
    rig = clip.actual_rig
    xy, _ = rig.project(points)
    neighbourhood = np.ones((2 * margin + 1, 2 * margin + 1), np.uint8)
    compared, agreeing = np.zeros(4, int), np.zeros(4, int)
    for view, name in enumerate(clip.rig.names):
        for frame, ids in enumerate(clip.images.read("ids", name)):
            codes, owner = visibility[frame, view], hidden_by[frame, view].astype(int)
            judged = (codes <= Visibility.HIDDEN_BY_OBJECT) & which & np.isfinite(xy[frame, view]).all(-1)
            person, joint = np.nonzero(judged)
            column, row = np.clip(np.round(xy[frame, view, person, joint]).astype(int), 0, rig.size[view] - 1).T
            clear = cv2.dilate(ids, neighbourhood)[row, column] == cv2.erode(ids, neighbourhood)[row, column]
            code, by = codes[person, joint], owner[person, joint]
            expected = np.where(
                code == Visibility.HIDDEN_BY_OBJECT,
                FIRST_OBJECT_ID + by,
                1 + np.where(code == Visibility.HIDDEN_BY_PERSON, by, person),
            )
            compared += np.bincount(code[clear], minlength=4)
            agreeing += np.bincount(code[clear & (expected == ids[row, column])], minlength=4)
    return PixelAgreement(compared, agreeing)
