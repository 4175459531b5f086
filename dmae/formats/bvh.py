"""BVH, Biovision's text format of joint angles: y up, facing z in the rest pose, one file per person.

A BVH cannot state that a joint is absent or was not measured. A table next to each file states it
(`dmae.formats.poses`).

Joints are a tree of nodes with fixed offsets from their parents. A node with several children has the rotation that
brings its children nearest to their measured positions (Kabsch 1976). A node with one child has the rotation of its
parent, turned by the smallest angle that points the bone at the child, so that limbs do not twist.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import chain
from math import ceil
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from dmae.data.clip import Clip, Poses3D, Source, person_name
from dmae.files.contents import write_atomic, written
from dmae.files.mapped import by_frames, column_blocks, empty, frame_blocks
from dmae.formats.config import METRES, LengthUnit
from dmae.formats.poses import person_paths
from dmae.formats.registry import pose_writer
from dmae.numerics.body import bone_lengths, rotate_z, smooth_heading
from dmae.numerics.filling import fill_body_frame
from dmae.numerics.paths import linear, pchip

_LIMBS = {"elbow": (0, 1, 0), "wrist": (0, 1, 0), "knee": (0, 0, -1), "ankle": (0, 0, -1)}
"""Directions of limbs in the rest pose, a T-pose that faces x, for the left side. y points outwards."""
_HEADING_SMOOTHING = 0.4
"""s; standard deviation of the Gaussian weights that smooth the heading."""
_MARGIN, _PART_FRAMES = 10.0, 4096
"""Long recordings are filled in parts: seconds before and after a part that are also used, and frames in a part."""


@dataclass(frozen=True)
class JointRotations:
    """The motion of one person. Its J joints are ordered so that parents come before children.

    Attributes:
        joints: Names of the joints.
        parents: (J,) index of the parent; -1 for the root. The only root is the first joint.
        offsets: (J, 3) m from the parent, in the rest pose: a T-pose that faces x, z up. Zero for the root.
        root: (F, 3) position of the root, m, world.
        rotations: (F, J, 3, 3) from the axes of each joint to the axes of its parent; for the root, to the world.
        order: (J,) index of each joint in the skeleton of the poses.
    """

    joints: tuple[str, ...]
    parents: tuple[int, ...]
    offsets: np.ndarray
    root: np.ndarray
    rotations: np.ndarray
    order: tuple[int, ...]

    @property
    def xyz(self) -> np.ndarray:
        """(F, J, 3) positions of the joints, m, world."""
        turned, xyz = self.rotations.copy(), np.repeat(self.root[:, None], len(self.joints), 1)
        for joint, parent in enumerate(self.parents):
            if parent >= 0:
                xyz[:, joint] = xyz[:, parent] + turned[:, parent] @ self.offsets[joint]
                turned[:, joint] = turned[:, parent] @ self.rotations[:, joint]
        return xyz


def joint_rotations(poses: Poses3D, fps: float, person: int) -> JointRotations:
    """Return the motion of one person as rotations. Bones have their median lengths.

    Joints that are absent in some frames are interpolated. Before the first and after the last known frame they do not
    move. Joints that are absent in all frames are left out.

    Args:
        poses: Poses in F frames.
        fps: Frames per second.
        person: Index of the person.

    Raises:
        ValueError: the person, or its root joint, is absent in all frames.
    """
    skeleton = poses.skeleton
    one = Poses3D(skeleton, *(by_frames(lambda all: all[:, [person]], each) for each in (poses.xyz, poses.source)))
    known = (one.source != Source.ABSENT).any((0, 1))
    root = skeleton.parents.index(-1)
    if not known[root]:
        raise ValueError(
            f"{person_name(person)}: joint {skeleton.joints[root]!r}, the root of {skeleton.name}, is never known; "
            "without it there is no tree of joints"
        )
    order, parents = _tree(skeleton.parents, known, root)
    xyz, heading = empty((len(one.xyz), len(order), 3), np.float64), np.empty(len(one.xyz))
    reach = ceil(_MARGIN * fps)
    step = max(_PART_FRAMES, 2 * reach)
    for start in range(0, len(xyz), step):
        part, around = slice(start, start + step), slice(max(start - reach, 0), start + step + reach)
        inside, given = slice(start - around.start, start - around.start + step), one.select(around)
        xyz[part] = fill_body_frame(given, fps, pchip).xyz[inside, 0][:, order]
        heading[part] = smooth_heading(given.xyz.astype(np.float64), skeleton, _HEADING_SMOOTHING * fps)[inside, 0]
    for joint, path in column_blocks(xyz):
        xyz[:, joint] = linear(path)
    names = tuple(skeleton.joints[joint] for joint in order)
    offsets = _rest(one.xyz[:, :, order], xyz, names, parents, heading)
    rotations = by_frames(lambda xyz: _rotations(xyz, offsets, parents), xyz)
    return JointRotations(names, parents, offsets, xyz[:, 0].copy(), rotations, order)


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
    """Return offsets (J, 3) from the parents in the rest pose, m.

    Limbs point as in a T-pose. Other offsets have the mean direction relative to the heading of the person.

    Args:
        measured: (F, 1, J, 3) m; NaN where absent.
        xyz: (F, J, 3) m, without gaps.
        heading: (F,) rad.
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


Y_UP = np.array([[0.0, 1, 0], [0, 0, 1], [1, 0, 0]])
"""Rotation from our world to a world with y up. A person that faces x in our world faces z there."""
_END_LENGTH = 0.05
"""m; length of the bone after the last joint of a limb. The format requires such a bone."""
_ORDER = "ZXY"


@pose_writer("bvh", table=True)
def write_bvh(poses: Poses3D, clip: Clip, path: Path, *, unit: LengthUnit = LengthUnit.m) -> list[Path]:
    """Biovision BVH: joint angles on a T-pose, a file for each person."""
    files = person_paths(path, poses.xyz.shape[1])
    for person, file in enumerate(files):
        motion = joint_rotations(poses, clip.fps, person)
        write_atomic(file, written(chain(_hierarchy(motion, METRES[unit]), _motion(motion, clip.fps, METRES[unit]))))
    return files


def _hierarchy(motion: JointRotations, metre: float) -> list[str]:
    lines = ["HIERARCHY"]
    offsets = motion.offsets @ Y_UP.T / metre

    def write(joint: int, depth: int) -> None:
        indent, inner = "\t" * depth, "\t" * (depth + 1)
        channels = "6 Xposition Yposition Zposition" if joint == 0 else "3"
        lines.append(f"{indent}{'JOINT' if joint else 'ROOT'} {motion.joints[joint]}")
        lines.append(f"{indent}{{")
        lines.append(f"{inner}OFFSET {_numbers(offsets[joint])}")
        lines.append(f"{inner}CHANNELS {channels} " + " ".join(f"{axis}rotation" for axis in _ORDER))
        children = [child for child, parent in enumerate(motion.parents) if parent == joint]
        for child in children:
            write(child, depth + 1)
        if not children:
            length = max(float(np.linalg.norm(offsets[joint])), 1e-9)
            end = offsets[joint] / length * _END_LENGTH / metre
            lines.extend([f"{inner}End Site", f"{inner}{{", f"{inner}\tOFFSET {_numbers(end)}", f"{inner}}}"])
        lines.append(f"{indent}}}")

    write(0, 0)
    return lines


def _motion(motion: JointRotations, fps: float, metre: float) -> Iterator[str]:
    yield from ("MOTION", f"Frames: {len(motion.root)}", f"Frame Time: {1 / fps:.9g}")
    depth_first, last = _depth_first(motion.parents), None
    for part in frame_blocks(motion.rotations):
        turned = Y_UP @ motion.rotations[part] @ Y_UP.T
        angles = Rotation.from_matrix(turned.reshape(-1, 3, 3)).as_euler(_ORDER, degrees=True, suppress_warnings=True)
        angles = angles.reshape(len(turned), -1, 3)
        # Unwrap angles so that they continue those of the frame before.
        before = angles[:0] if last is None else last[None]
        angles = np.unwrap(np.concatenate([before, angles]), period=360, axis=0)[len(before) :]
        last = angles[-1]
        yield from map(
            _numbers,
            np.concatenate([motion.root[part] @ Y_UP.T / metre, angles[:, depth_first].reshape(len(angles), -1)], 1),
        )


def _depth_first(parents: tuple[int, ...]) -> list[int]:
    """Return the joints in the order of a BVH: each joint is followed by all its descendants."""
    order: list[int] = []

    def visit(joint: int) -> None:
        order.append(joint)
        for child, parent in enumerate(parents):
            if parent == joint:
                visit(child)

    visit(0)
    return order


def _numbers(row: np.ndarray) -> str:
    return " ".join(f"{value:.6f}" for value in row)
