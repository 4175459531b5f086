"""The forces that move people along a reference without contact, and the positions of their feet on it."""

import mujoco
import numpy as np

from synth.physics.joint_addresses import JointAddresses
from synth.physics.reference import ReferenceMotion, interpolate_steps
from synth.scene.build import STEPS_PER_CONTROL

_EVERY = 2
"""Steps from one computation of the forces to the next."""


def inverse_dynamics(
    model: mujoco.MjModel, joints: JointAddresses, reference: ReferenceMotion
) -> tuple[np.ndarray, np.ndarray]:
    """Return forces along a reference, and positions of the feet, computed every other step and interpolated linearly.

    Args:
        model: The scene.
        joints: Addresses of the people's joints.
        reference: The motion over S steps.

    Returns:
        Forces (S, nv), and centres of mass of the feet (S, P, 2, 3), m.
    """
    dt, steps = STEPS_PER_CONTROL * model.opt.timestep, len(reference.root)
    data = mujoco.MjData(model)
    qvel = np.zeros((steps, model.nv))
    moves = joints.moves(qvel)
    moves[:, :, 0], moves[:, :, 1:] = reference.velocity, reference.spin
    computed = np.arange(0, steps + _EVERY - 1, _EVERY).clip(max=steps - 1)
    later = np.minimum(computed + 1, steps - 1)
    velocities, accelerations = qvel[computed], (qvel[later] - qvel[computed]) / dt
    qpos = np.tile(data.qpos, (len(computed), 1))
    joints.root(qpos)[:], joints.quats(qpos)[:] = reference.root[computed], reference.quats[computed]
    forces, feet = np.empty_like(velocities), np.empty((len(computed), joints.persons, 2, 3))
    # The parts of mj_inverse without contacts and constraints.
    for k in range(len(computed)):
        data.qpos[:], data.qvel[:], data.qacc[:] = qpos[k], velocities[k], accelerations[k]
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_comVel(model, data)
        mujoco.mj_rne(model, data, 1, forces[k])
        feet[k] = joints.feet(data.xipos)
    return tuple(interpolate_steps(values, _EVERY)[:steps] for values in (forces, feet))
