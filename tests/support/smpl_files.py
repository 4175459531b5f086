"""Files in AMASS's format, written as other programs write them."""

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from synth.motion.geometry import UPRIGHT, aligned
from synth.motion.motion import Motion
from synth.motion.readers.dialects import SMPL
from synth.motion.readers.npz import BODY, JOINTS, OFFSETS, PARENTS
from synth.motion.retargeting import ANKLE_OF_LEG
from synth.people.body import SEGMENTS


def write_smpl(path: Path, motion: Motion) -> None:
    """Write a motion in AMASS's format, on SMPL-H's mean body (`betas` 0, fingers straight), to whose legs steps are
    scaled."""
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
    np.savez_compressed(
        path,
        poses=poses.reshape(len(poses), -1),
        trans=trans,
        mocap_framerate=motion.fps,
        gender="neutral",
        betas=np.zeros(16),
    )
