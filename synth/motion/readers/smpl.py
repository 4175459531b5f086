"""The joints of the SMPL family of body models, and motions in AMASS's format."""

import io
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from dmae.data.store import write_atomic
from synth.motion.motion import Motion
from synth.motion.readers.dialects import SMPL
from synth.motion.retargeting import ANKLE_OF_LEG
from synth.motion.rotations import UPRIGHT, aligned
from synth.people.segments import SEGMENTS

# Joint, parent, and rest position in the parent, m: x left, y up, z forward. The mean body of SMPL (Loper et al., ACM
# Transactions on Graphics 34, 2015), as published with simulated humanoids; SMPL-H and SMPL-X share order and pose.
_TEMPLATE = """pelvis - -0.0018 -0.2233 0.0282
left_hip pelvis 0.0695 -0.0914 -0.0068
right_hip pelvis -0.0677 -0.0905 -0.0043
spine1 pelvis -0.0025 0.1090 -0.0267
left_knee left_hip 0.0343 -0.3752 -0.0045
right_knee right_hip -0.0383 -0.3826 -0.0089
spine2 spine1 0.0055 0.1352 0.0011
left_ankle left_knee -0.0136 -0.3980 -0.0437
right_ankle right_knee 0.0158 -0.3984 -0.0423
spine3 spine2 0.0015 0.0529 0.0254
left_foot left_ankle 0.0264 -0.0558 0.1193
right_foot right_ankle -0.0254 -0.0481 0.1233
neck spine3 -0.0028 0.2139 -0.0429
left_collar spine3 0.0788 0.1217 -0.0341
right_collar spine3 -0.0818 0.1188 -0.0386
head neck 0.0052 0.0650 0.0513
left_shoulder left_collar 0.0910 0.0305 -0.0089
right_shoulder right_collar -0.0960 0.0326 -0.0091
left_elbow left_shoulder 0.2596 -0.0128 -0.0275
right_elbow right_shoulder -0.2537 -0.0133 -0.0214
left_wrist left_elbow 0.2492 0.0090 -0.0012
right_wrist right_elbow -0.2553 0.0078 -0.0056
left_hand left_wrist 0.0840 -0.0082 -0.0149
right_hand right_wrist -0.0846 -0.0061 -0.0103"""
_ROWS = [row.split() for row in _TEMPLATE.splitlines()]
JOINTS = tuple(row[0] for row in _ROWS)
"""Joints in SMPL's order. The last two are at the knuckles, where SMPL-H and SMPL-X have fingers."""
PARENTS = (-1, *(JOINTS.index(row[1]) for row in _ROWS[1:]))
OFFSETS = np.array([row[2:] for row in _ROWS], np.float64)
"""(24, 3) position of each joint in its parent, m; that of the pelvis is relative to the point that `trans` moves."""
BODY = 22
"""Number of joints before the joints of the hands."""


def write_npz(path: Path, motion: Motion) -> None:
    """Write a motion in AMASS's format, on SMPL-H's mean body (`betas` zero, fingers straight); atomically.

    `synth.motion.readers.npz` reads it back. The array `on_floor`, which is not part of the format, states that
    floor, soles and forearms need no repair.

    Args:
        path: `<name>.npz`.
        motion: The motion; its steps are scaled to the mean body's legs.
    """
    axes = UPRIGHT["y"]
    turn = dict(zip(SEGMENTS, motion.rotations.swapaxes(0, 1), strict=True))
    world = {"pelvis": turn["pelvis"], "spine1": turn["spine"], "spine3": turn["chest"], "head": turn["head"]}
    for side, name, outward in (("l", "left", 1.0), ("r", "right", -1.0)):
        for segment, joint, end, axis in (
            ("upper_arm", "shoulder", "elbow", (0, outward, 0)),
            ("forearm", "elbow", "wrist", (0, outward, 0)),
            ("hand", "wrist", "hand", (0, outward, 0)),
            ("thigh", "hip", "knee", (0, 0, -1)),
            ("shin", "knee", "ankle", (0, 0, -1)),
        ):
            # The template's limbs are slightly off the axes of the T-pose.
            bone = axes @ OFFSETS[JOINTS.index(f"{name}_{end}")]
            world[f"{name}_{joint}"] = (
                turn[f"{side}_{segment}"] @ aligned(bone[None], np.array([[1.0, 0, 0]]), axis)[0].T
            )
        world[f"{name}_ankle"] = turn[f"{side}_foot"] @ axes @ SMPL.rest_of(f"{side}_foot") @ axes.T
    poses = np.zeros((len(motion), 52, 3))
    within = {joint: matrices @ axes for joint, matrices in world.items()}
    for joint, parent in zip(JOINTS[:BODY], PARENTS, strict=False):
        above = within[JOINTS[parent]] if parent >= 0 else np.eye(3)
        local = within.setdefault(joint, above)
        poses[:, JOINTS.index(joint)] = Rotation.from_matrix(np.swapaxes(above, -1, -2) @ local).as_rotvec()
    legs = [JOINTS.index(f"{side}_{joint}") for side in ("left", "right") for joint in ("knee", "ankle")]
    hip_height = np.linalg.norm(OFFSETS[legs], axis=1).sum() / 2 * (1 + ANKLE_OF_LEG)
    hips = OFFSETS[[JOINTS.index("left_hip"), JOINTS.index("right_hip")]].mean(0)
    trans = motion.root * (hip_height / motion.hip_height) - within["pelvis"] @ hips - OFFSETS[0]
    buffer = io.BytesIO()
    np.savez_compressed(
        buffer,
        poses=poses.reshape(len(poses), -1),
        trans=trans,
        mocap_framerate=motion.fps,
        gender="neutral",
        betas=np.zeros(16),
        on_floor=True,
    )
    write_atomic(path, buffer.getvalue())
