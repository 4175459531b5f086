"""Positions of the labelled joints, in simulated states and in reference motions."""

import mujoco
import numpy as np

from synth.people.body import Body, segment_origins
from synth.people.landmarks import landmarks
from synth.people.segments import SEGMENTS


def joint_positions(model: mujoco.MjModel, qpos: np.ndarray, bodies: list[Body]) -> np.ndarray:
    """Return (F, P, 39, 3) joints of `SKELETON` in the states (F, nq), m, world."""
    data = mujoco.MjData(model)
    ids = moved_with(model, bodies)
    points = np.stack([landmarks(body)[1] for body in bodies])
    joints = np.empty((len(qpos), *points.shape))
    for frame, state in enumerate(qpos):
        data.qpos[:] = state
        mujoco.mj_kinematics(model, data)
        joints[frame] = data.xpos[ids] + (data.xmat[ids].reshape(*ids.shape, 3, 3) @ points[..., None])[..., 0]
    return joints


def moved_with(model: mujoco.MjModel, bodies: list[Body]) -> np.ndarray:
    """Return the (P, 39) index of the model's body with which each joint of each person moves."""
    return np.array(
        [
            [model.body(f"person{p}/{SEGMENTS[segment]}").id for segment in landmarks(body)[0]]
            for p, body in enumerate(bodies)
        ]
    )


def reference_joints(body: Body, root: np.ndarray, rotations: np.ndarray) -> np.ndarray:
    """Return (F, 39, 3) joints of `SKELETON`, m, world, in a motion with root (F, 3) and rotations (F, 16, 3, 3)."""
    segments, points, _ = landmarks(body)
    return segment_origins(body, root, rotations)[:, segments] + (rotations[:, segments] @ points[..., None])[..., 0]
