"""BVH, Biovision's text format of joint angles: y up, facing z in the rest pose, one file per person.

Skeletons of other programs, SOMA and LAFAN1, have the names and axes that their readers expect. Both are in cm. A
person of SOMA stands in a T-pose that faces z if all rotations are zero, with a `Root` on the floor. In LAFAN1, the x
axis of each joint runs along its bone, so zero rotations are no pose of a person; the axes are from the tables of
General Motion Retargeting (GMR, MIT licence). Joints that we do not capture, such as fingers, have usual places and do
not turn.
"""

from collections.abc import Iterator
from itertools import chain
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from dmae.data.clip import Clip, Poses3D, person_names
from dmae.files.contents import write_atomic, written
from dmae.files.mapped import frame_blocks
from dmae.formats.animation import Y_UP, JointRotations, joint_rotations, with_bodies
from dmae.formats.config import METRES, LengthUnit
from dmae.formats.poses import person_paths
from dmae.formats.registry import pose_writer
from dmae.numerics.kinematics import NoBody

_END_LENGTH = 0.05  # m; length of the bone after the last joint of a limb. The format requires such a bone.
_ORDER, _RIG_ORDER = "ZXY", "ZYX"  # Order of the rotation channels, of our skeletons and of other programs


@pose_writer("bvh", table=True, fills="all", rigs=["soma", "lafan1"])
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


# Skeletons of other programs


class _Node(NamedTuple):
    """A node of a rig."""

    name: str  # Name in the rig, without Left or Right
    parent: str  # Name of the parent, without Left or Right
    turns: str  # Our node whose rotation it has
    at: tuple = ()  # Our node at its place, or the place as a share of the way between two; empty for `offset` alone
    # Offset from there in the T-pose, m, of the left side: x forward, y left, z up
    offset: tuple[float, float, float] = (0, 0, 0)


def _trunk(spine: tuple[str, str, str], necks: tuple[str, ...]) -> list[_Node]:
    """Return the nodes from the pelvis to the head; the spine bends at its lowest joint."""
    nodes = [_Node("Hips", "Root", "mid_hip", ("mid_hip",))]
    for number, name in enumerate(spine):
        nodes.append(_Node(name, nodes[-1].name, "spine", ("spine", "head", number / 3)))
    for number, name in enumerate(necks):
        nodes.append(_Node(name, nodes[-1].name, "spine", ("spine", "head", 0.85 + 0.07 * number)))
    return [*nodes, _Node("Head", nodes[-1].name, "head", ("head",))]


def _limbs(chest: str, names: tuple[str, ...]) -> list[_Node]:
    """Return the nodes of arm and leg of one side. `names` are upper leg, lower leg and toe."""
    upper, lower, toe = names
    return [
        _Node("*Shoulder", chest, "*clavicle", ("*clavicle",)),
        _Node("*Arm", "*Shoulder", "*shoulder", ("*shoulder",)),
        _Node("*ForeArm", "*Arm", "*elbow", ("*elbow",)),
        _Node("*Hand", "*ForeArm", "*wrist", ("*wrist",)),
        _Node(f"*{upper}", "Hips", "*hip", ("*hip",)),
        _Node(f"*{lower}", f"*{upper}", "*knee", ("*knee",)),
        _Node("*Foot", f"*{lower}", "*ankle", ("*ankle",)),
        _Node(f"*{toe}", "*Foot", "*ankle", ("*ankle",), (0.13, 0, -0.06)),
    ]


def _soma() -> list[_Node]:
    head = {
        "HeadEnd": (0, 0, 0.18),
        "Jaw": (0.02, 0, 0.03),
        "LeftEye": (0.08, 0.03, 0.09),
        "RightEye": (0.08, -0.03, 0.09),
    }
    nodes = [_Node("Root", "", "")] + _trunk(("Spine1", "Spine2", "Chest"), ("Neck1", "Neck2"))
    nodes += [_Node(name, "Head", "head", ("head",), place) for name, place in head.items()]
    limbs = _limbs("Chest", ("Leg", "Shin", "ToeBase"))
    limbs.append(_Node("*ToeEnd", "*ToeBase", "*ankle", ("*ankle",), (0.20, 0, -0.06)))
    for finger, place in {"Thumb": 0.04, "Index": 0.03, "Middle": 0.01, "Ring": -0.01, "Pinky": -0.03}.items():
        above, count, start = "*Hand", 3 if finger == "Thumb" else 4, 0.03
        for number in range(count + 1):
            name = f"*Hand{finger}{number + 1}" if number < count else f"*Hand{finger}End"
            # From the wrist over the back of the hand, then three bones of a finger.
            reach = start + (0.03 * number if finger == "Thumb" else (0, 0.06, 0.09, 0.115, 0.135)[number])
            nodes_at = (place, reach, -0.01 * (finger == "Thumb"))
            limbs.append(_Node(name, above, "*wrist", ("*wrist",), nodes_at))
            above = name
    return nodes + limbs


# Parents come before children.
_RIGS = {
    "soma": _soma(),
    "lafan1": _trunk(("Spine", "Spine1", "Spine2"), ("Neck",)) + _limbs("Spine2", ("UpLeg", "Leg", "Toe")),
}
CENTIMETRES = 0.01
"""m; both rigs are in cm."""

# Orientation of a robot's link, x forward, z up, in the axes of the joint of LAFAN1 that drives it: w, x, y, z.
_LAFAN1_TRUNK, _LAFAN1_LEG, _LAFAN1_TOE = (0.5, 0.5, 0.5, 0.5), (-0.5, 0.5, 0.5, -0.5), (-0.70710678, 0.70710678, 0, 0)
_LAFAN1_ARM, _LAFAN1_FOREARM = (0.5, 0.5, -0.5, -0.5), (0.70710678, 0.70710678, 0, 0)


def _axes(name: str) -> np.ndarray:
    """Return the axes of a joint of LAFAN1 in the T-pose, as columns, in our world: the person faces x."""
    part = name.removeprefix("Left").removeprefix("Right")
    # The robot's arms hang, and its forearms point forward.
    hang = Rotation.from_euler("x", -90 if name.startswith("Left") else 90, degrees=True)
    bend = Rotation.from_euler("y", -90, degrees=True)
    pose, driven = {
        "UpLeg": (None, _LAFAN1_LEG), "Leg": (None, _LAFAN1_LEG), "Foot": (None, _LAFAN1_LEG),
        "Toe": (None, _LAFAN1_TOE),
        "Arm": (hang, _LAFAN1_ARM), "ForeArm": (bend * hang, _LAFAN1_FOREARM), "Hand": (bend * hang, _LAFAN1_FOREARM),
        "Shoulder": (hang, _LAFAN1_ARM),
    }.get(part, (None, _LAFAN1_TRUNK))  # fmt: skip
    axes = Rotation.from_quat(driven, scalar_first=True).inv()
    return (axes if pose is None else pose.inv() * axes).as_matrix()


def as_rig(motion: JointRotations, rig: str, name: str) -> JointRotations:
    """Return the motion of the person of this name on a rig, `soma` or `lafan1`; NoBody if a limb was never known."""
    turned, rest = motion.turned, motion.rest
    ours = {joint: number for number, joint in enumerate(motion.joints)}
    nodes: list[_Node] = []
    for node in _RIGS[rig]:
        sides = (("Left", "l_", 1), ("Right", "r_", -1)) if "*" in node.name else (("", "", 1),)
        for side, short, sign in sides:
            offset = (node.offset[0], sign * node.offset[1], node.offset[2])
            at = tuple(part.replace("*", short) if isinstance(part, str) else part for part in node.at)
            nodes.append(_Node(node.name.replace("*", side), node.parent.replace("*", side),
                               node.turns.replace("*", short), at, offset))  # fmt: skip
    lacking = sorted({node.turns for node in nodes if node.turns} - ours.keys())
    if lacking:
        raise NoBody(f"{name}: skeleton={rig} needs a whole person; never known: {', '.join(lacking)}")
    order = {node.name: number for number, node in enumerate(nodes)}
    parents = tuple(order.get(node.parent, -1) for node in nodes)
    frames = len(motion.root)
    world, place, axes = [], [], []
    for node in nodes:
        world.append(turned[:, ours[node.turns]] if node.turns else np.broadcast_to(np.eye(3), (frames, 3, 3)))
        joint = np.zeros(3)
        if node.at:
            start = rest[ours[node.at[0]]]
            joint = start if len(node.at) == 1 else start + node.at[2] * (rest[ours[node.at[1]]] - start)
        place.append(joint + node.offset)
        axes.append(_axes(node.name) @ Y_UP if rig == "lafan1" else np.eye(3))
    offsets = np.zeros((len(nodes), 3))
    rotations = np.empty((frames, len(nodes), 3, 3))
    for number, parent in enumerate(parents):
        if parent < 0:
            rotations[:, number] = world[number] @ axes[number]
        else:
            offsets[number] = axes[parent].T @ (place[number] - place[parent])
            rotations[:, number] = axes[parent].T @ world[parent].swapaxes(-1, -2) @ world[number] @ axes[number]
    placed = order["Hips"]
    offsets[placed] = 0
    return JointRotations(tuple(node.name for node in nodes), parents, offsets, motion.root, rotations, placed)
