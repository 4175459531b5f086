"""Trees of joints with fixed offsets and a T-pose at rest, for animation formats.

People (`dmae.numerics.kinematics`) are trees rooted at the pelvis. Their nodes are the joints of the skeleton, and the
joints of the body that it lacks: `mid_hip`, `spine`, `head`, `l_clavicle`, `r_clavicle`. Gaps are interpolated first,
because a file of animation cannot state that a joint is absent; a table next to the files states it.

Your own skeletons keep their tree. A node with several children has the rotation that brings its children nearest to
their measured positions (Kabsch 1976). A node with one child has the rotation of its parent, turned by the smallest
angle that points the bone at the child, so that limbs do not twist.
"""

import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from math import ceil
from typing import TypeVar

import numpy as np

from dmae.data.clip import Poses3D, Source, person_name
from dmae.files.mapped import by_frames, column_blocks, empty
from dmae.numerics.body import bone_lengths, rotate_z, smooth_heading
from dmae.numerics.filling import fill_body_frame
from dmae.numerics.kinematics import ADVICE, ISB, NoBody, body_motion, can_move
from dmae.numerics.paths import linear, pchip
from dmae.progress import progress

T = TypeVar("T")

Y_UP = np.array([[0.0, 1, 0], [0, 0, 1], [1, 0, 0]])
"""Rotation from our axes to the axes of OpenSim and of rest poses: people who face x in ours face z there."""
WORLD_Y_UP = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
"""Rotation from our world to the world of BVH and glTF. Programs with z up turn it back when they import a file."""
_LIMBS = {"elbow": (0, 1, 0), "wrist": (0, 1, 0), "knee": (0, 0, -1), "ankle": (0, 0, -1)}
"""Directions of limbs of your own skeletons in the rest pose, a T-pose that faces x, for the left side."""
_HEADING_SMOOTHING = 0.4  # s; standard deviation of the Gaussian weights that smooth the heading
_MARGIN, _PART_FRAMES = 10.0, 4096
"""Long recordings are filled in parts: seconds before and after a part that are also used, and frames in a part."""
_NODES = {"pelvis": "mid_hip", "torso": "spine", "head": "head", "clavicle": "clavicle", "upper_arm": "shoulder",
          "forearm": "elbow", "hand": "wrist", "thigh": "hip", "shank": "knee", "foot": "ankle"}  # fmt: skip
"""Names of nodes by segment, without the side."""
_RAISED = {"upper_arm", "forearm", "hand"}  # Segments that a T-pose raises sideways


@dataclass(frozen=True)
class JointRotations:
    """The motion of one person. Its N nodes are ordered so that parents come before children."""

    joints: tuple[str, ...]  # Names of the nodes
    parents: tuple[int, ...]  # (N,) index of the parent; -1 for the root. The only root is the first node.
    offsets: np.ndarray  # (N, 3) m from the parent, in the rest pose: a T-pose that faces x, z up. Zero for the root.
    root: np.ndarray  # (F, 3) position of the root, m, world
    # (F, N, 3, 3) from the axes of each node to the axes of its parent; for the root, to the world
    rotations: np.ndarray
    placed: int = 0  # The node at `root`. Nodes before it stand at the origin of the world.

    @property
    def rest(self) -> np.ndarray:
        """(N, 3) positions of the nodes in the rest pose, m from the root."""
        rest = self.offsets.copy()
        for joint, parent in enumerate(self.parents):
            if parent >= 0:
                rest[joint] += rest[parent]
        return rest

    @property
    def turned(self) -> np.ndarray:
        """(F, N, 3, 3) rotations from the axes of the nodes to the world."""
        turned = self.rotations.copy()
        for joint, parent in enumerate(self.parents):
            if parent >= 0:
                turned[:, joint] = turned[:, parent] @ turned[:, joint]
        return turned

    @property
    def xyz(self) -> np.ndarray:
        """(F, N, 3) positions of the nodes, m, world."""
        turned, xyz = self.turned, np.zeros((len(self.root), len(self.joints), 3))
        xyz[:, self.placed] = self.root
        for joint, parent in enumerate(self.parents):
            if joint > self.placed:
                xyz[:, joint] = xyz[:, parent] + turned[:, parent] @ self.offsets[joint]
        return xyz

    def y_up(self, part: slice = slice(None)) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return `offsets`, `root` and `rotations` of a part of the frames in axes with y up: z ahead at rest."""
        turned = Y_UP @ self.rotations[part] @ Y_UP.T
        turned[:, self.placed] = WORLD_Y_UP @ self.rotations[part, self.placed] @ Y_UP.T
        return self.offsets @ Y_UP.T, self.root[part] @ WORLD_Y_UP.T, turned


def joint_rotations(poses: Poses3D, fps: float, person: int) -> JointRotations:
    """Return the motion of one person as rotations, with bones of constant length.

    Joints that are absent in some frames are interpolated. Before the first and after the last known frame they do not
    move. Joints that are absent in all frames are left out.

    Raises NoBody if hips and shoulders of the person, or the root of your own skeleton, are never known.
    """
    skeleton = poses.skeleton
    one = Poses3D(skeleton, *(by_frames(lambda all: all[:, [person]], each) for each in (poses.xyz, poses.source)))
    known = (one.source != Source.ABSENT).any((0, 1))
    if can_move(skeleton) and not skeleton.defined:
        cov = by_frames(lambda all: all[:, [person]], poses.cov)
        return _of_a_person(_filled(replace(one, cov=cov), fps), known, person)
    root = skeleton.parents.index(-1)
    if not known[root]:
        raise NoBody(
            f"{person_name(person)}: joint {skeleton.joints[root]!r}, the root of {skeleton.name}, is never known; "
            "without it there is no tree of joints"
        )
    order, parents = _tree(skeleton.parents, known, root)
    xyz = _filled(one, fps).xyz[:, 0][:, order].astype(np.float64)
    heading = smooth_heading(one.xyz.astype(np.float64), skeleton, _HEADING_SMOOTHING * fps)[:, 0]
    names = tuple(skeleton.joints[joint] for joint in order)
    offsets = _rest(one.xyz[:, :, order], xyz, names, parents, heading)
    rotations = by_frames(lambda xyz: _rotations(xyz, offsets, parents), xyz)
    return JointRotations(names, parents, offsets, xyz[:, 0].copy(), rotations)


def with_bodies(persons: int, motion: Callable[[int], T]) -> Iterator[tuple[int, T | None]]:
    """Yield each person with its motion, None if it has no body, and say on stderr who is left out, and why.

    Raises NoBody if nobody has a body.
    """
    lacking = []
    for person in progress(range(persons), "fitting bodies"):
        try:
            found = motion(person)
        except NoBody as error:
            lacking.append(error)
            found = None
        yield person, found
    if len(lacking) == persons:
        raise NoBody(f"{lacking[0]}; {ADVICE}")
    for each in lacking:
        print(f"{each}; this person is left out", file=sys.stderr)


def _filled(one: Poses3D, fps: float) -> Poses3D:
    """Return one person without gaps, except for joints that are never known."""
    xyz = empty(one.xyz.shape, np.float32)
    reach = ceil(_MARGIN * fps)
    step = max(_PART_FRAMES, 2 * reach)
    for start in range(0, len(xyz), step):
        part, around = slice(start, start + step), slice(max(start - reach, 0), start + step + reach)
        inside = slice(start - around.start, start - around.start + step)
        xyz[part] = fill_body_frame(one.select(around), fps, pchip).xyz[inside]
    for joint, path in column_blocks(xyz[:, 0]):
        xyz[:, 0, joint] = linear(path)
    lacking = one.source == Source.ABSENT
    source = np.where(lacking & ~np.isnan(xyz).any(-1), Source.COMPLETED, one.source)
    return replace(one, xyz=xyz, source=source)


def _of_a_person(one: Poses3D, known: np.ndarray, person: int) -> JointRotations:
    try:
        motion = body_motion(one, 0)
    except NoBody as error:
        raise NoBody(str(error).replace(person_name(0), person_name(person), 1)) from None
    body = motion.body
    seen = {joint for joint, there in zip(one.skeleton.joints, known, strict=True) if there}
    points = [n for n, joint in enumerate(body.joints) if joint in seen]
    above = {0}
    for point in points:
        segment = body.on[point]
        while segment >= 0:
            above.add(segment)
            segment = body.parents[segment]
    kept, names, parents, offsets = sorted(above), [], [], []
    _, turned = body.place(motion.root, motion.local)
    rest, world = {}, []
    for segment in kept:
        name = body.segments[segment]
        side, bare = (name[:2], name[2:]) if name[:2] in ("l_", "r_") else ("", name)
        angle = {"l_": 1, "r_": -1}.get(side, 0) * np.pi / 2 * (bare in _RAISED)
        cos, sin = np.cos(angle), np.sin(angle)
        rest[segment] = ISB @ np.array([[1, 0, 0], [0, cos, -sin], [0, sin, cos]])
        names.append(side + _NODES[bare])
        parent = body.parents[segment]
        parents.append(kept.index(parent) if parent >= 0 else -1)
        offsets.append(rest[parent] @ body.origins[segment] if parent >= 0 else np.zeros(3))
        world.append(turned[:, segment] @ rest[segment].T)
    for point in points:
        if body.joints[point] not in names:
            names.append(body.joints[point])
            parents.append(kept.index(body.on[point]))
            offsets.append(rest[body.on[point]] @ body.landmarks[point])
            world.append(world[parents[-1]])
    rotations = np.stack(
        [
            turn if above < 0 else world[above].swapaxes(-1, -2) @ turn
            for above, turn in zip(parents, world, strict=True)
        ],
        1,
    )
    return JointRotations(tuple(names), tuple(parents), np.array(offsets), motion.root, rotations)


def _tree(parents: tuple[int, ...], known: np.ndarray, root: int) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Return the known joints, parents first, and for each the index, in this order, of its nearest known ancestor."""
    ancestors = {}
    for joint in np.flatnonzero(known).tolist():
        above = parents[joint]
        while above >= 0 and not known[above]:
            above = parents[above]
        ancestors[joint] = root if above < 0 and joint != root else above
    order = [root]
    for joint in order:
        order += [child for child, parent in ancestors.items() if parent == joint and child != root]
    return tuple(order), tuple(order.index(ancestors[joint]) if joint != root else -1 for joint in order)


def _rest(
    measured: np.ndarray, xyz: np.ndarray, names: tuple[str, ...], parents: tuple[int, ...], heading: np.ndarray
) -> np.ndarray:
    """Return offsets (J, 3) from the parents in the rest pose, m: limbs as in a T-pose, others in their mean direction.

    `measured` (F, 1, J, 3) m has gaps, `xyz` (F, J, 3) m none; `heading` (F,) rad is the person's.
    """
    bones = [(parent, joint) for joint, parent in enumerate(parents) if parent >= 0]
    known = by_frames(lambda measured: bone_lengths(measured, bones)[:, 0], measured)
    # If both ends of a bone are never known in the same frame, its length comes from the interpolated joints.
    known = np.where(np.isnan(known).all(0), bone_lengths(xyz[:, None], bones)[:, 0], known)
    lengths = np.r_[0, np.nanmedian(known, 0)]
    offsets = np.zeros((len(names), 3))
    for parent, joint in bones:
        side, _, part = names[joint].rpartition("_")
        if part in _LIMBS and side in ("l", "r"):
            offsets[joint] = np.array(_LIMBS[part]) * (1, 1 if side == "l" else -1, 1)
        else:
            offsets[joint] = rotate_z(xyz[:, joint] - xyz[:, parent], -heading).mean(0)
    offsets *= lengths[:, None] / np.maximum(np.linalg.norm(offsets, axis=-1, keepdims=True), 1e-9)
    return offsets


def _rotations(xyz: np.ndarray, offsets: np.ndarray, parents: tuple[int, ...]) -> np.ndarray:
    """Return rotations (F, J, 3, 3) from each joint to its parent, given positions (F, J, 3) and offsets (J, 3), m."""
    in_world, local = np.empty((len(xyz), len(parents), 3, 3)), np.empty((len(xyz), len(parents), 3, 3))
    for joint, parent in enumerate(parents):
        children = [child for child, above in enumerate(parents) if above == joint]
        before = in_world[:, parent] if parent >= 0 else np.broadcast_to(np.eye(3), (len(xyz), 3, 3))
        found = xyz[:, children] - xyz[:, joint, None]
        if not children:
            in_world[:, joint] = before
        elif len(children) == 1 or np.linalg.matrix_rank(offsets[children], tol=1e-3) < 2:
            in_world[:, joint] = _swing(before @ offsets[children[0]], found[:, 0]) @ before
        else:
            in_world[:, joint] = _kabsch(offsets[children], found)
        local[:, joint] = before.swapaxes(-1, -2) @ in_world[:, joint]
    return local


def _swing(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Return the smallest rotations (F, 3, 3) that turn vectors `start` (F, 3) towards vectors `end` (F, 3)."""
    start, end = (part / np.maximum(np.linalg.norm(part, axis=-1, keepdims=True), 1e-9) for part in (start, end))
    axis, cosine = np.cross(start, end), (start * end).sum(-1)
    # For opposite directions: half a turn about any perpendicular axis.
    across = np.cross(start, np.eye(3)[np.abs(start).argmin(-1)])
    across /= np.maximum(np.linalg.norm(across, axis=-1, keepdims=True), 1e-9)
    half = 2 * across[:, :, None] * across[:, None] - np.eye(3)
    K = np.zeros((len(start), 3, 3))
    K[:, [2, 0, 1], [1, 2, 0]], K[:, [1, 2, 0], [2, 0, 1]] = axis, -axis
    turned = np.eye(3) + K + K @ K / np.maximum(1 + cosine, 1e-9)[:, None, None]
    return np.where((cosine > -1 + 1e-6)[:, None, None], turned, half)


def _kabsch(offsets: np.ndarray, found: np.ndarray) -> np.ndarray:
    """Return the rotations (F, 3, 3) that bring offsets (n, 3) nearest to vectors (F, n, 3) (Kabsch 1976)."""
    left, _, right = np.linalg.svd(found.swapaxes(-1, -2) @ offsets)
    sign = np.linalg.det(left @ right)
    left[..., -1] *= sign[..., None]
    return left @ right
