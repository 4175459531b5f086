"""Controller: forces against MuJoCo's inverse dynamics, torques against rotation vectors."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from synth.people.body import SEGMENTS, SIDES, Body
from synth.physics.controller import Controller, ReferenceMotion, find_joints, make_reference
from synth.scene.build import STEPS_PER_CONTROL, build_scene
from tests.support.scenes import BODY, RIG, gliding, scene

BODIES = [BODY, Body(1.65, 60, 1.0)]
MASSES = np.array([body.mass for body in BODIES])


@pytest.fixture
def model():
    return build_scene(scene(BODIES, 5), RIG, painted=False).model


def reference(seed: int = 0) -> ReferenceMotion:
    """Two people who glide and twist every joint at random."""
    rng = np.random.default_rng(seed)
    motions = [gliding(body, 5, (i, 0), (1, 0)) for i, body in enumerate(BODIES)]
    turns = Rotation.from_rotvec(rng.normal(0, 0.2, (5 * 2 * len(SEGMENTS), 3))).as_matrix()
    rotations = np.stack([motion.rotations for motion in motions], 1) @ turns.reshape(5, 2, len(SEGMENTS), 3, 3)
    bearing = np.full((5, 2, 2), 0.5)
    return make_reference(np.stack([motion.root for motion in motions], 1), rotations, bearing, 25.0, 8)


def test_joint_addresses_match_the_model(model):
    joints = find_joints(model, 2)
    qpos, qvel = np.arange(float(model.nq)), np.arange(float(model.nv))
    for person in (0, 1):
        for segment in (0, 5, 15):
            joint = model.joint(f"person{person}/{SEGMENTS[segment]}")
            place, dof = joint.qposadr[0] + 3 * (segment == 0), joint.dofadr[0] + 3 * (segment == 0)
            np.testing.assert_array_equal(joints.quats(qpos)[person, segment], np.arange(place, place + 4))
            np.testing.assert_array_equal(joints.moves(qvel)[person, 1 + segment], np.arange(dof, dof + 3))
        pelvis = model.joint(f"person{person}/pelvis")
        np.testing.assert_array_equal(joints.root(qpos)[person], pelvis.qposadr[0] + np.arange(3))
        np.testing.assert_array_equal(joints.moves(qvel)[person, 0], pelvis.dofadr[0] + np.arange(3))


def test_forces_on_the_reference_are_those_of_inverse_dynamics(model):
    """Without lag only the inverse dynamics are left, up to twice the strength."""
    wanted, data = reference(), mujoco.MjData(model)
    controller, joints = Controller(model, data, wanted, MASSES), find_joints(model, 2)
    moves = np.concatenate([wanted.velocity[:, :, None], wanted.spin], axis=2)
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    within = 0
    # Odd steps are interpolated.
    for step in (0, 8, 16, 28):
        joints.root(data.qpos)[:], joints.quats(data.qpos)[:] = wanted.root[step], wanted.quats[step]
        joints.moves(data.qvel)[:] = moves[step]
        joints.moves(data.qacc)[:] = (moves[step + 1] - moves[step]) / (STEPS_PER_CONTROL * model.opt.timestep)
        mujoco.mj_inverse(model, data)
        controller.apply(step)
        inverse, force = joints.moves(data.qfrc_inverse), joints.moves(data.qfrc_applied)
        own = (
            np.abs(inverse - joints.moves(model.dof_damping * data.qvel))
            < controller._strongest[step] - controller._weakest[step]
        )
        np.testing.assert_allclose(force[own], inverse[own], atol=1e-6)
        within += own.sum()
    assert within > 100


@pytest.mark.parametrize("flipped", [False, True])
def test_torques_turn_joints_the_short_way(model, flipped):
    """Half the rotation vector to the reference, times twice the stiffness; q and -q are the same orientation."""
    still, data = reference().still(), mujoco.MjData(model)
    controller, joints = Controller(model, data, still, MASSES), find_joints(model, 2)
    controller.start()
    controller.apply(0)
    before = joints.moves(data.qfrc_applied).copy()
    turn = Rotation.from_rotvec((0.0, 0.02, 0.01))
    chest = SEGMENTS.index("chest")
    quats = joints.quats(data.qpos)
    quats[1, chest] = (Rotation.from_quat(quats[1, chest], scalar_first=True) * turn).as_quat(scalar_first=True)
    if flipped:
        quats[:] *= -1
    again = Controller(model, data, still, MASSES)
    again.apply(0)
    torque = joints.moves(data.qfrc_applied) - before
    stiffness = 1500 * MASSES[1] / 70
    np.testing.assert_allclose(torque[1, 1 + chest], -stiffness * turn.as_rotvec(), rtol=1e-4, atol=1e-9)
    torque[1, 1 + chest] = 0
    np.testing.assert_allclose(torque, 0, atol=1e-9)


def test_the_path_shifts_beyond_the_leash_and_returns(model):
    still, data = reference().still(), mujoco.MjData(model)
    controller, joints = Controller(model, data, still, MASSES), find_joints(model, 2)
    controller.start()
    joints.root(data.qpos)[0, 0] -= 0.3
    controller.apply(0)
    # The lag beyond 60 mm, less the return of one step.
    np.testing.assert_allclose(controller.shift, [(-0.24, 0), (0, 0)], atol=0.24 * 0.006)
    joints.root(data.qpos)[0, 0] += 0.06 + 0.24
    for _ in range(round(1 / (STEPS_PER_CONTROL * model.opt.timestep))):
        controller.apply(0)
    assert -0.24 * np.exp(-1) < controller.shift[0, 0] <= 0
    assert (controller.shift[1] == 0).all()


@pytest.mark.parametrize("bearing", [1.0, 0.0])
def test_standing_feet_are_held_by_at_most_friction(model, bearing):
    still, data = reference().still(), mujoco.MjData(model)
    still = replace(still, bearing=np.full((1, 2, 2), bearing / 2))
    controller = Controller(model, data, still, MASSES)
    controller.start()
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    controller.apply(0)
    feet = np.array([[model.body(f"person{p}/{side}_foot").id for side in SIDES] for p in (0, 1)])
    np.testing.assert_allclose(data.xfrc_applied[feet], 0, atol=1e-3)
    data.xipos[feet[0, 0]] += (0.0, 0.01, 0.0)
    data.xipos[feet[1, 1]] -= (0.2, 0.0, 0.0)
    controller.apply(0)
    pushed = data.xfrc_applied[feet, :3]
    np.testing.assert_allclose(pushed[0, 0], (0, -bearing * 200 * MASSES[0] / 70, 0), atol=1e-3)
    np.testing.assert_allclose(pushed[1, 1], (bearing * 0.45 * 9.81 * MASSES[1], 0, 0), atol=1e-3)
    np.testing.assert_allclose(pushed[[0, 1], [1, 0]], 0, atol=1e-3)
