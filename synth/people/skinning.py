"""How a person's surface follows the skeleton in a MuJoCo model: linear blend skinning of the meshes of its geoms.

MuJoCo's meshes are rigid. `Skin` moves their vertices in the model itself after `mujoco.mj_kinematics`, and mends the
boxes by which rays find triangles. Images, rays, ids and body parts then see one and the same surface.

A vertex follows up to four bones. Each segment has, apart from the segment itself, a bone that turns half as far at
its joint, so that elbows and knees keep their volume. Upper arms, forearms and thighs also have bones that twist by
none, a third and two thirds, so that a twist spreads along the limb. Fingers of hands that move have three bones each.
"""

from dataclasses import dataclass
from typing import NamedTuple

import mujoco
import numpy as np
import trimesh
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from dmae.numerics.compiled import compiled
from synth.people.body import PARENTS, SEGMENTS, side_and_name
from synth.people.draping import Drape, swings
from synth.people.hands import FINGER_BONES, MovingHands

_TWISTED = ("upper_arm", "forearm", "thigh")
_NAMES = [side_and_name(segment)[1] for segment in SEGMENTS]
_HALF = np.array([len(SEGMENTS) - 1 + i for i in range(len(SEGMENTS))])
"""Number of the bone of each segment that turns half as far; none for the pelvis."""
_TWISTS = {
    i: 2 * len(SEGMENTS) - 1 + 3 * number
    for number, i in enumerate(i for i, name in enumerate(_NAMES) if name in _TWISTED)
}
"""Number of the first of a segment's three bones that twist less."""
# Segment of each bone, and the shares of swing and twist that it follows.
_TABLE = (
    [(i, 1.0, 1.0) for i in range(len(SEGMENTS))]
    + [(i, 0.5, 0.0 if name in _TWISTED else 0.5) for i, name in enumerate(_NAMES) if i]
    + [(i, 1.0, twist / 3) for i in _TWISTS for twist in range(3)]
    + [(SEGMENTS.index(bone.partition(" ")[0]), 1.0, 1.0) for bone in FINGER_BONES]
)
_FINGERS = (len(_TABLE) - len(FINGER_BONES), len(_TABLE) - len(FINGER_BONES) // 2)
"""Number of the first bone of the fingers of the left and of the right hand."""
_SEGMENT = np.array([row[0] for row in _TABLE])
_PALMS = _SEGMENT[list(_FINGERS)]
_SHARES = np.array([row[1:] for row in _TABLE])
_LENGTHWISE = np.array([1 if name in ("upper_arm", "forearm", "hand") else 2 for name in _NAMES])
"""Axis of each segment about which it twists."""
_PARENTS = np.array(PARENTS)
BONE_NAMES = (
    *SEGMENTS,
    *(f"{segment} half" for segment in SEGMENTS[1:]),
    *(f"{SEGMENTS[i]} twist {step}" for i in _TWISTS for step in range(3)),
    *FINGER_BONES,
)
"""Names of bones: segments, their halves, the bones that twist by none, a third and two thirds, and fingers."""
FIRST_NODE = len(BONE_NAMES)
"""Number of the first node of hanging cloth (`synth.people.draping`) among the bones of a person."""
MOST_BONES = 4
"""Greatest number of bones that a vertex follows; all readers of glTF support four."""
_ROW = 2 * MOST_BONES + 6
SKINNED = 1.0
"""User value of geoms whose mesh is skinned."""


def blend(weights: np.ndarray, along: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return bones (N, 4) and weights (N, 4) from the weights of segments.

    Args:
        weights: (N, 16) weights of `SEGMENTS`, sum 1, or (N, 46), as of `synth.people.surface.BareBody`.
        along: (N, 16) position of each vertex along each segment, 0 at its joint, 1 at the next.
    """
    # A column is contiguous.
    rest, bones = weights[:, : len(SEGMENTS)].copy(order="F"), np.zeros((len(weights), len(_TABLE)), order="F")
    for i, parent in enumerate(PARENTS[1:], start=1):
        shared = np.minimum(rest[:, i], rest[:, parent])
        rest[:, [i, parent]] -= shared[:, None]
        bones[:, _HALF[i]] += 2 * shared
    for i in range(len(SEGMENTS)):
        if i not in _TWISTS:
            bones[:, i] += rest[:, i]
            continue
        place = 3 * np.clip(along[:, i], 0, 1)
        for step, bone in enumerate([*range(_TWISTS[i], _TWISTS[i] + 3), i]):
            bones[:, bone] += rest[:, i] * np.clip(1 - np.abs(place - step), 0, 1)
    if weights.shape[1] > len(SEGMENTS):
        for first, part in zip(_FINGERS, np.split(weights[:, len(SEGMENTS) :], 2, axis=1), strict=True):
            hand, own = _SEGMENT[first], slice(first, first + part.shape[1])
            bones[:, own] = part
            # A half of the hand may already have a part of its weight.
            bones[:, own] *= np.minimum(1, bones[:, hand] / np.maximum(bones[:, own].sum(1), 1e-12))[:, None]
            bones[:, hand] -= bones[:, own].sum(1)
    order = np.argsort(-np.ascontiguousarray(bones), axis=1, kind="stable")[:, :MOST_BONES]
    kept = np.take_along_axis(bones, order, 1)
    return order, kept / kept.sum(1, keepdims=True)


def pack(rotations: np.ndarray, origins: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Return the numbers that the model holds for a person: the bind pose, and a row for each vertex.

    Args:
        rotations, origins: (16, 3, 3) and (16, 3) m, the segments in the bind pose.
        rows: (N, 14) four bones, their weights, place (m) and normal in the bind pose.
    """
    quats = Rotation.from_matrix(rotations).as_quat(scalar_first=True)
    return np.concatenate([quats.ravel(), origins.ravel(), rows.ravel()])


@dataclass(frozen=True)
class SkinOfPerson:
    """N vertices, and the bones that they follow."""

    name: str  # The person's name in the model
    segments: np.ndarray  # (16,) indices of the bodies of the segments
    # Indices of the geoms that bend. The vertices of their meshes, one mesh after the other, are the N.
    geoms: np.ndarray
    # (B, 3, 4) rotation and origin, m, of each of `BONE_NAMES` in the bind pose, and of the nodes of hanging cloth
    bind: np.ndarray
    # which, weights: (N, 4) bones and their weights, largest first, sum 1
    which: np.ndarray
    weights: np.ndarray
    rest: np.ndarray  # (N, 6) place, m, and normal in the bind pose
    hands: MovingHands | None  # None for hands that keep their shapes
    drapes: tuple[Drape, ...]  # Cloth that hangs
    swing: np.ndarray  # (F, 2) displacement of their hems, m, world, see `let_swing`
    fps: float  # Frames per second of the swing

    @property
    def bone_names(self) -> tuple[str, ...]:
        """(B,) names of the bones."""
        nodes = ((number, node) for number, drape in enumerate(self.drapes) for node in range(drape.nodes))
        return BONE_NAMES + tuple(f"cloth {number} {node}" for number, node in nodes)

    def bones(self, data: mujoco.MjData, seconds: float) -> np.ndarray:
        """Return the (B, 3, 4) rotation and origin of each bone, m, world, for a state at a time in the clip, s."""
        bones, own = np.empty((len(_TABLE), 3, 4)), self.segments
        quats, places = data.xquat[own], data.xpos[own]
        _place_bones(quats, places, _PARENTS, _SEGMENT, _SHARES, _LENGTHWISE, bones)
        if self.hands:
            turns, begins = (each.reshape(2, -1, *each.shape[3:]) for each in self.hands.at(seconds))
            palms, fingers = bones[_PALMS], bones[_FINGERS[0] :].reshape(2, -1, 3, 4)
            rest, at = self.bind[_PALMS, :, :3], self.bind[_PALMS, None, :, 3]
            move = palms[..., :3] @ rest.swapaxes(1, 2)
            fingers[..., :3] = move[:, None] @ turns @ rest[:, None]
            fingers[..., 3] = (begins - at) @ move.swapaxes(1, 2) + palms[:, None, :, 3]
        if not self.drapes:
            return bones
        frame = min(max(seconds * self.fps, 0.0), len(self.swing) - 1.0)
        first = int(frame)
        before, after = self.swing[first], self.swing[min(first + 1, len(self.swing) - 1)]
        swing = before + (frame - first) * (after - before)
        return np.concatenate([bones, *(drape.bones(quats, places, swing) for drape in self.drapes)])


class Skin:
    """Moves the surfaces of people in a model. It changes the model's meshes: give it a model of your own, a copy.

    Args:
        model: A scene with people, or one without.
        normals: Whether vertex normals follow, which images need; rays take the triangles' own.

    Attributes:
        persons: The skin of each person.
        geoms, meshes: Indices of the geoms that bend, and of their meshes.
    """

    def __init__(self, model: mujoco.MjModel, normals: bool = True):
        self._model, self._normals, self.persons = model, normals, []
        skinned = model.geom_user[:, 0] == SKINNED if model.nuser_geom else np.zeros(model.ngeom, bool)
        held = _numbers(model)
        for name in [key.removesuffix("/skin") for key in held if key.endswith("/skin")]:
            segments = model.body(f"{name}/{SEGMENTS[0]}").id + np.arange(len(SEGMENTS))
            geoms = np.flatnonzero(skinned & np.isin(model.geom_bodyid, segments))
            quats, origins, rows = np.split(held[f"{name}/skin"], [64, 112])
            bind = np.empty((len(_TABLE), 3, 4))
            _place_bones(quats.reshape(16, 4), origins.reshape(16, 3), _PARENTS, _SEGMENT, _SHARES, _LENGTHWISE, bind)
            drapes = tuple(Drape.unpack(data) for key, data in held.items() if key.startswith(f"{name}/drape"))
            bind = np.concatenate([bind, *(drape.at_rest() for drape in drapes)])
            which, weights, rest = np.split(rows.reshape(-1, _ROW), [MOST_BONES, 2 * MOST_BONES], axis=1)
            hands = None
            if f"{name}/hands" in held:
                hands = MovingHands.unpack(held[f"{name}/hands"])
                bind[_FINGERS[0] : FIRST_NODE, :, 3] = hands.fingers.joints.reshape(-1, 3)
            swing = held.get(f"{name}/swing", np.zeros(3)).copy()
            skin = bind, which.astype(np.int32), weights.copy(), rest.copy(), hands, drapes
            swung = swing[1:].reshape(-1, 2), float(swing[0])
            self.persons.append(SkinOfPerson(name, segments, geoms, *skin, *swung))
        self.geoms = np.concatenate([np.empty(0, int), *(person.geoms for person in self.persons)])
        self.meshes = model.geom_dataid[self.geoms]
        # MuJoCo tests rays against boxes of bodies, which leave out geoms without contacts.
        bodies = np.unique(model.geom_bodyid[self.geoms])
        self._roots, self._boxes = model.body_bvhadr[bodies], model.bvh_aabb[model.body_bvhadr[bodies]].copy()
        meshes = model.geom_type == mujoco.mjtGeom.mjGEOM_MESH
        self._drawn = np.flatnonzero(meshes & np.isin(model.geom_bodyid, bodies))
        own = model.geom_bodyid[self._drawn]
        self._within = np.searchsorted(bodies, own)
        if len(own):
            inner = Rotation.from_quat(model.body_iquat[own], scalar_first=True).inv()
            outer = Rotation.from_quat(model.geom_quat[self._drawn], scalar_first=True)
            self._turns = (inner * outer).as_matrix()
            self._offsets = inner.apply(model.geom_pos[self._drawn] - model.body_ipos[own])

    def apply(self, data: mujoco.MjData, seconds: float = 0.0) -> None:
        """Put the vertices in place for a state whose kinematics is up to date, at a time in the clip, s.

        The state has all but the shapes of hands, which follow time.
        """
        model = self._model
        if not self.persons:
            return
        for person in self.persons:
            geoms = person.geoms
            _bend(
                _moves(person.bones(data, seconds), person.bind), person.which, person.weights, person.rest,
                data.geom_xpos[geoms], data.geom_xmat[geoms].reshape(-1, 3, 3), _Meshes.of(model, geoms), self._normals,
            )  # fmt: skip
        _refit(_Meshes.of(model, self.geoms), _Boxes.of(model, self.geoms))
        model.bvh_aabb[self._roots] = self._boxes
        _enclose(self._roots[self._within], self._drawn, self._turns, self._offsets, model.geom_aabb, model.bvh_aabb)


def let_swing(model: mujoco.MjModel, qpos: np.ndarray, fps: float) -> None:
    """Write into a model how cloth swings in a whole clip, for every `Skin` of it and of its later copies.

    A model that `synth.scene.build.build_scene` made has room for the clip; cloth of others hangs at rest.

    Args:
        qpos: (F, nq) states of all frames of the clip.
        fps: Frames per second.
    """
    held = _numbers(model)
    for person in Skin(model).persons:
        if f"{person.name}/swing" in held:
            hips = model.jnt_qposadr[model.body_jntadr[person.segments[0]]]
            away = swings(max(drape.length for drape in person.drapes), qpos[:, hips : hips + 2], fps)
            held[f"{person.name}/swing"][:] = [fps, *away.ravel()]


def _numbers(model: mujoco.MjModel) -> dict[str, np.ndarray]:
    """Return the numbers that a model holds, by name. What is written into them is written into the model."""
    return {each.name: each.data for each in map(model.numeric, range(model.nnumeric))}


def mesh_triangles(model: mujoco.MjModel, geom: int) -> np.ndarray:
    """Return the (T, 3, 3) corners of the triangles of a geom's mesh, m, in the frame of the geom."""
    mesh = model.geom_dataid[geom]
    faces = slice(model.mesh_faceadr[mesh], model.mesh_faceadr[mesh] + model.mesh_facenum[mesh])
    return model.mesh_vert[model.mesh_vertadr[mesh] :][model.mesh_face[faces]].astype(float)


def locate(triangles: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the triangle (R,) nearest to each point (R, 3), and the shares (R, 3) of its corners in the point."""
    candidates = min(len(triangles), 8)
    near = cKDTree(triangles.mean(1)).query(points, candidates)[1].reshape(-1, candidates)
    some = triangles[near.ravel()]
    closest = trimesh.triangles.closest_point(some, points.repeat(candidates, 0))
    best = np.linalg.norm(closest - points.repeat(candidates, 0), axis=1).reshape(-1, candidates).argmin(1)
    rows = np.arange(len(points))
    shares = trimesh.triangles.points_to_barycentric(triangles[near[rows, best]], points)
    return near[rows, best], shares


@compiled()
def _times(a, b):
    """Return the product of two quaternions."""
    return (
        a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
        a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
        a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
        a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
    )


@compiled()
def _share_of(q, share):
    """Return the quaternion of a share of a rotation."""
    length = np.sqrt(q[1] ** 2 + q[2] ** 2 + q[3] ** 2)
    if length < 1e-9:
        return (1.0, 0.0, 0.0, 0.0)
    sign = 1.0 if q[0] >= 0 else -1.0
    half = share * np.arctan2(length, sign * q[0])
    factor = sign * np.sin(half) / length
    return (np.cos(half), factor * q[1], factor * q[2], factor * q[3])


@compiled()
def _place_bones(quats, origins, parents, segment, shares, lengthwise, bones):
    """Fill `bones` (B, 3, 4) with the rotation and origin of each bone, from the 16 segments."""
    for bone in range(len(segment)):
        i = segment[bone]
        q = (quats[i, 0], quats[i, 1], quats[i, 2], quats[i, 3])
        if shares[bone, 0] < 1 or shares[bone, 1] < 1:
            p = quats[parents[i]]
            above = (p[0], p[1], p[2], p[3])
            r = _times((p[0], -p[1], -p[2], -p[3]), q)
            along = r[2] if lengthwise[i] == 1 else r[3]
            length = np.sqrt(r[0] ** 2 + along**2) + 1e-12
            cosine, sine = r[0] / length, along / length
            twist = (cosine, 0.0, sine, 0.0) if lengthwise[i] == 1 else (cosine, 0.0, 0.0, sine)
            swing = _times(r, (twist[0], -twist[1], -twist[2], -twist[3]))
            q = _times(above, _times(_share_of(swing, shares[bone, 0]), _share_of(twist, shares[bone, 1])))
        w, x, y, z = q
        bones[bone, 0, 0], bones[bone, 0, 1], bones[bone, 0, 2] = (
            1 - 2 * (y * y + z * z),
            2 * (x * y - w * z),
            2 * (x * z + w * y),
        )
        bones[bone, 1, 0], bones[bone, 1, 1], bones[bone, 1, 2] = (
            2 * (x * y + w * z),
            1 - 2 * (x * x + z * z),
            2 * (y * z - w * x),
        )
        bones[bone, 2, 0], bones[bone, 2, 1], bones[bone, 2, 2] = (
            2 * (x * z - w * y),
            2 * (y * z + w * x),
            1 - 2 * (x * x + y * y),
        )
        for k in range(3):
            bones[bone, k, 3] = origins[i, k]


class _Meshes(NamedTuple):
    """Meshes of M geoms in the model's arrays. Kernels write into those."""

    geoms: np.ndarray  # (M,) indices of the geoms
    # first_vertex, first_normal, first_face: (M,) where a mesh begins in the array; counts: (M,) number of its vertices
    first_vertex: np.ndarray
    counts: np.ndarray
    first_normal: np.ndarray
    first_face: np.ndarray
    # vertices, normals: of all meshes, (n, 3) m and (n, 3), in the frames of their geoms
    vertices: np.ndarray
    normals: np.ndarray
    faces: np.ndarray  # (n, 3) vertices of the triangles of all meshes, counted from the mesh's first

    @classmethod
    def of(cls, model: mujoco.MjModel, geoms: np.ndarray) -> "_Meshes":
        mesh = model.geom_dataid[geoms]
        return cls(
            geoms, model.mesh_vertadr[mesh], model.mesh_vertnum[mesh], model.mesh_normaladr[mesh],
            model.mesh_faceadr[mesh], model.mesh_vert, model.mesh_normal, model.mesh_face,
        )  # fmt: skip


@compiled()
def _moves(bones, bind):
    """Return how each bone moves a vertex from the bind pose to now: (B, 3, 4) rotation and shift, m, in the world."""
    count = len(bones)
    move = np.empty((count, 3, 4))
    for b in range(count):
        for i in range(3):
            for j in range(3):
                move[b, i, j] = (
                    bones[b, i, 0] * bind[b, j, 0] + bones[b, i, 1] * bind[b, j, 1] + bones[b, i, 2] * bind[b, j, 2]
                )
            move[b, i, 3] = bones[b, i, 3] - (
                move[b, i, 0] * bind[b, 0, 3] + move[b, i, 1] * bind[b, 1, 3] + move[b, i, 2] * bind[b, 2, 3]
            )
    return move


@compiled()
def _bend(move, which, weights, rest, places, turns, meshes, normals):
    """Write the vertices of the meshes of a person, and their normals if wanted, into the model.

    Args:
        move: Of each bone, see `_moves`.
        which, weights, rest: (N, 4), (N, 4) and (N, 6) of `SkinOfPerson`.
        places, turns: (M, 3) m and (M, 3, 3) of the geoms in the world.
        normals: Whether normals are wanted.
    """
    blended, world, outward = np.empty((3, 4)), np.empty(3), np.empty(3)
    row = 0
    for mesh in range(len(meshes.geoms)):
        for vertex in range(meshes.counts[mesh]):
            blended[:] = 0
            for k in range(which.shape[1]):
                weight = weights[row, k]
                if weight <= 0:
                    break
                for i in range(3):
                    for j in range(4):
                        blended[i, j] += weight * move[which[row, k], i, j]
            for i in range(3):
                world[i] = blended[i, 3] - places[mesh, i]
                for j in range(3):
                    world[i] += blended[i, j] * rest[row, j]
            for j in range(3):
                meshes.vertices[meshes.first_vertex[mesh] + vertex, j] = (
                    turns[mesh, 0, j] * world[0] + turns[mesh, 1, j] * world[1] + turns[mesh, 2, j] * world[2]
                )
            row += 1
            if not normals:
                continue
            for i in range(3):
                outward[i] = 0
                for j in range(3):
                    outward[i] += blended[i, j] * rest[row - 1, 3 + j]
            size = np.sqrt(outward[0] ** 2 + outward[1] ** 2 + outward[2] ** 2) + 1e-12
            for j in range(3):
                meshes.normals[meshes.first_normal[mesh] + vertex, j] = (
                    turns[mesh, 0, j] * outward[0] + turns[mesh, 1, j] * outward[1] + turns[mesh, 2, j] * outward[2]
                ) / size


@compiled()
def _merge_boxes(aabb, node, one, other):
    """Set a box, centre and half size, to the box around two others."""
    for k in range(3):
        low = min(aabb[one, k] - aabb[one, 3 + k], aabb[other, k] - aabb[other, 3 + k])
        high = max(aabb[one, k] + aabb[one, 3 + k], aabb[other, k] + aabb[other, 3 + k])
        aabb[node, k], aabb[node, 3 + k] = (low + high) / 2, (high - low) / 2


class _Boxes(NamedTuple):
    """Boxes in the model's arrays, each (6,) centre and half size, m. Kernels write into those."""

    # first_node, nodes: (M,) first node, and number of nodes, of the tree of each mesh
    first_node: np.ndarray
    nodes: np.ndarray
    child: np.ndarray  # (n, 2) children of nodes, counted from the first of their tree; -1 for none
    triangle: np.ndarray  # (n,) the triangle of a node without children, counted from the first of its mesh
    trees: np.ndarray  # (n, 6) of nodes
    geoms: np.ndarray  # (G, 6) of geoms
    sizes: np.ndarray  # (G, 3) m, largest distances from a geom's origin along its axes
    radii: np.ndarray  # (G,) m, of spheres around geoms

    @classmethod
    def of(cls, model: mujoco.MjModel, geoms: np.ndarray) -> "_Boxes":
        mesh = model.geom_dataid[geoms]
        return cls(
            model.mesh_bvhadr[mesh], model.mesh_bvhnum[mesh], model.bvh_child, model.bvh_nodeid, model.bvh_aabb,
            model.geom_aabb, model.geom_size, model.geom_rbound,
        )  # fmt: skip


@compiled()
def _refit(meshes, boxes):
    """Fit the boxes of the trees of meshes, in which children follow their parents, and of geoms, to moved vertices."""
    aabb = boxes.trees
    for mesh, geom in enumerate(meshes.geoms):
        start, first_vertex = boxes.first_node[mesh], meshes.first_vertex[mesh]
        for number in range(boxes.nodes[mesh] - 1, -1, -1):
            node = start + number
            child = boxes.child[node]
            if child[0] >= 0:
                _merge_boxes(aabb, node, start + child[0], start + child[1])
                continue
            face = meshes.faces[meshes.first_face[mesh] + boxes.triangle[node]]
            for k in range(3):
                a = meshes.vertices[first_vertex + face[0], k]
                b = meshes.vertices[first_vertex + face[1], k]
                c = meshes.vertices[first_vertex + face[2], k]
                low, high = min(a, b, c), max(a, b, c)
                aabb[node, k], aabb[node, 3 + k] = (low + high) / 2, (high - low) / 2 + 1e-6
        square = 0.0
        for k in range(3):
            boxes.geoms[geom, k], boxes.geoms[geom, 3 + k] = aabb[start, k], aabb[start, 3 + k]
            reach = abs(aabb[start, k]) + aabb[start, 3 + k]
            boxes.sizes[geom, k] = reach
            square += reach**2
        boxes.radii[geom] = np.sqrt(square)


@compiled()
def _enclose(roots, geoms, turns, offsets, geom_aabb, aabb):
    """Widen the boxes of bodies so that they hold the boxes of their geoms.

    Args:
        roots: (n,) the row in `aabb` of the body of each geom.
        geoms: (n,) rows in `geom_aabb`.
        turns, offsets: (n, 3, 3) and (n, 3) m, of geoms in the frames of the boxes of their bodies.
        geom_aabb, aabb: (G, 6) and (B, 6) centre and half size, m.
    """
    for g in range(len(geoms)):
        box = roots[g]
        for i in range(3):
            middle, half = offsets[g, i], 0.0
            for j in range(3):
                middle += turns[g, i, j] * geom_aabb[geoms[g], j]
                half += abs(turns[g, i, j]) * geom_aabb[geoms[g], 3 + j]
            low = min(aabb[box, i] - aabb[box, 3 + i], middle - half)
            high = max(aabb[box, i] + aabb[box, 3 + i], middle + half)
            aabb[box, i], aabb[box, 3 + i] = (low + high) / 2, (high - low) / 2
