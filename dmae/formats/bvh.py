"""BVH, Biovision's text format of joint angles: y up, facing z in the rest pose, one file per person."""

from collections.abc import Iterator
from itertools import chain
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from dmae.data.clip import Clip, Poses3D, person_names
from dmae.files.contents import write_atomic, written
from dmae.files.mapped import frame_blocks
from dmae.formats.animation import JointRotations, joint_rotations, with_bodies
from dmae.formats.config import METRES, LengthUnit
from dmae.formats.poses import person_paths
from dmae.formats.registry import pose_writer
from dmae.formats.rigs import CENTIMETRES, as_rig

_END_LENGTH = 0.05  # m; length of the bone after the last joint of a limb. The format requires such a bone.
_ORDER, _RIG_ORDER = "ZXY", "ZYX"  # Order of the rotation channels, of our skeletons and of other programs


@pose_writer("bvh", table=True, rigs=["soma", "lafan1"])
def write_bvh(
    poses: Poses3D, clip: Clip, path: Path, *, unit: LengthUnit = LengthUnit.m, rig: str | None = None
) -> list[Path]:
    """Biovision BVH: joint angles on a T-pose, a file for each person."""
    people = person_names(clip, poses.xyz.shape[1])
    files, paths = [], person_paths(path, people)
    metre, order = (METRES[unit], _ORDER) if rig is None else (CENTIMETRES, _RIG_ORDER)

    def motion_of(person: int) -> JointRotations:
        motion = joint_rotations(poses, clip.fps, person)
        return motion if rig is None else as_rig(motion, rig, people[person])

    for person, motion in with_bodies(len(paths), motion_of):
        if motion is None:
            paths[person].unlink(missing_ok=True)
            continue
        lines, joints = _hierarchy(motion, metre, order)
        write_atomic(paths[person], written(chain(lines, _motion(motion, joints, clip.fps, metre, order))))
        files.append(paths[person])
    return files


def _hierarchy(motion: JointRotations, metre: float, order: str) -> tuple[list[str], list[int]]:
    """Return the lines of the tree, and its joints in their order: each is followed by all its descendants."""
    lines, joints = ["HIERARCHY"], []
    offsets = motion.y_up(slice(0))[0] / metre

    def write(joint: int, depth: int) -> None:
        joints.append(joint)
        indent, inner = "\t" * depth, "\t" * (depth + 1)
        channels = "6 Xposition Yposition Zposition" if joint <= motion.placed else "3"
        lines.append(f"{indent}{'JOINT' if joint else 'ROOT'} {'_'.join(motion.joints[joint].split())}")
        lines.append(f"{indent}{{")
        lines.append(f"{inner}OFFSET {_numbers(offsets[joint])}")
        lines.append(f"{inner}CHANNELS {channels} " + " ".join(f"{axis}rotation" for axis in order))
        children = [child for child, parent in enumerate(motion.parents) if parent == joint]
        for child in children:
            write(child, depth + 1)
        if not children:
            length = max(float(np.linalg.norm(offsets[joint])), 1e-9)
            end = offsets[joint] / length * _END_LENGTH / metre
            lines.extend([f"{inner}End Site", f"{inner}{{", f"{inner}\tOFFSET {_numbers(end)}", f"{inner}}}"])
        lines.append(f"{indent}}}")

    write(0, 0)
    return lines, joints


def _motion(motion: JointRotations, joints: list[int], fps: float, metre: float, order: str) -> Iterator[str]:
    yield from ("MOTION", f"Frames: {len(motion.root)}", f"Frame Time: {1 / fps:.9g}")
    last = None
    for part in frame_blocks(motion.rotations):
        _, root, turned = motion.y_up(part)
        angles = Rotation.from_matrix(turned.reshape(-1, 3, 3)).as_euler(order, degrees=True, suppress_warnings=True)
        angles = angles.reshape(len(turned), -1, 3)
        # Angles continue from the frame before, without jumps by 360 degrees.
        before = angles[:0] if last is None else last[None]
        angles = np.unwrap(np.concatenate([before, angles]), period=360, axis=0)[len(before) :]
        last = angles[-1]
        rows = []
        for joint in joints:
            if joint == motion.placed:
                rows.append(root / metre)
            elif joint < motion.placed:
                rows.append(np.zeros((len(angles), 3)))
            rows.append(angles[:, joint])
        yield from map(_numbers, np.concatenate(rows, 1))


def _numbers(row: np.ndarray) -> str:
    return " ".join(f"{value:.6f}" for value in row)
