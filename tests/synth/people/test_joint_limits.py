"""Joint limits: real motion stays within them, and other motion is brought within them."""

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from synth.motion.config import MotionConfig, ProceduralConfig
from synth.motion.procedural.gait import make_motion
from synth.motion.source import read_take, takes
from synth.people.body import PARENTS, SEGMENTS
from synth.people.joint_limits import GREATEST, LEAST, ORDER, WIDEST, limit_joints, swing_twist
from synth.physics.controller import Controller, find_joints, make_reference
from synth.scene.build import build_scene
from tests.support.scenes import BODY, RIG, gliding, scene

FPS = 25.0


def bent(segment: str, axis: str, degrees) -> np.ndarray:
    """(F, 16, 3, 3) the T-pose with one joint bent."""
    degrees = np.atleast_1d(degrees)
    relative = np.tile(np.eye(3), (len(degrees), len(SEGMENTS), 1, 1))
    relative[:, SEGMENTS.index(segment)] = Rotation.from_euler(axis, degrees[:, None], degrees=True).as_matrix()
    return composed(relative)


def composed(relative: np.ndarray) -> np.ndarray:
    rotations = relative.copy()
    for segment, parent in enumerate(PARENTS[1:], start=1):
        rotations[:, segment] = rotations[:, parent] @ relative[:, segment]
    return rotations


def parted(rotations: np.ndarray) -> np.ndarray:
    """(F, 15, 3, 3) rotations of all joints except the pelvis, in their parents."""
    return np.swapaxes(rotations[:, PARENTS[1:]], -1, -2) @ rotations[:, 1:]


# Knees bend backwards about y, elbows forwards about z, mirrored on the right side.
@pytest.mark.parametrize(
    ("segment", "axis", "asked", "got"),
    [
        ("l_shin", "y", 120, 120),
        ("r_shin", "y", -40, -8),
        ("l_forearm", "z", -150, -150),
        ("l_forearm", "z", 40, 8),
        ("r_forearm", "z", 150, 150),
        ("r_forearm", "z", -40, -8),
        ("l_thigh", "x", -80, -45),
        ("r_thigh", "x", 80, 45),
        ("l_thigh", "z", 120, 80),
        ("head", "z", 120, 85),
        ("pelvis", "z", 170, 170),
        ("l_upper_arm", "y", 175, 175),
    ],
)
def test_a_joint_stops_at_its_limit(segment, axis, asked, got):
    rotations, beyond = limit_joints(bent(segment, axis, asked), FPS)
    np.testing.assert_allclose(rotations, bent(segment, axis, got), atol=1e-7)
    assert beyond == (0 if asked == got else 1 / 15)


def test_only_segments_below_a_limited_joint_change():
    rng = np.random.default_rng(0)
    relative = Rotation.from_rotvec(rng.normal(0, 0.05, (20 * 16, 3))).as_matrix().reshape(20, 16, 3, 3)
    knee = SEGMENTS.index("l_shin")
    relative[:, knee] = Rotation.from_euler("y", np.linspace(-30, 30, 20)[:, None], degrees=True).as_matrix()
    asked = composed(relative)
    got, beyond = limit_joints(asked, FPS)
    assert beyond == pytest.approx((np.linspace(-30, 30, 20) < -8).sum() / 20 / 15)
    others = [i for i in range(15) if i != knee - 1]
    np.testing.assert_allclose(parted(got)[:, others], parted(asked)[:, others], atol=1e-9)
    np.testing.assert_array_equal(got[:, 0], asked[:, 0])


@given(st.integers(0, 1000))
@settings(max_examples=20, deadline=None)
def test_limited_poses_are_within_limits_and_stable(seed):
    relative = Rotation.random(16, rng=np.random.default_rng(seed)).as_matrix()[None]
    once, beyond = limit_joints(composed(relative), FPS)
    again, left = limit_joints(once, FPS)
    assert beyond > 0 == left or np.allclose(again, once, atol=1e-6)
    quats = Rotation.from_matrix(parted(once)[0]).as_quat(scalar_first=True)
    _, _, turns = swing_twist(*(quats[np.arange(15), order[1:]] for order in ORDER))
    assert (turns > LEAST[:, 1:] - 1e-6).all()
    assert (turns < GREATEST[:, 1:] + 1e-6).all()


def test_a_twist_beyond_half_a_turn_stays_at_its_limit():
    rotations, _ = limit_joints(bent("l_hand", "y", np.arange(0, 300, 10)), FPS)
    steps = Rotation.from_matrix(np.swapaxes(rotations[:-1, 6], -1, -2) @ rotations[1:, 6]).magnitude()
    assert np.degrees(steps.max()) < 11


def speeds(rotations: np.ndarray) -> np.ndarray:
    """(F - 1, 15) speeds of all joints except the pelvis, rad/s."""
    joints = parted(rotations)
    turns = Rotation.from_matrix((np.swapaxes(joints[:-1], -1, -2) @ joints[1:]).reshape(-1, 3, 3))
    return FPS * turns.magnitude().reshape(len(joints) - 1, -1)


def test_only_joints_that_jump_are_smoothed():
    """A take in which shin and thigh jump for two frames while a foot nods."""
    frames = np.arange(50)
    relative = np.tile(np.eye(3), (50, 16, 1, 1))
    foot = SEGMENTS.index("l_foot")
    relative[:, foot] = Rotation.from_euler("y", 0.3 * np.sin(0.5 * frames)[:, None]).as_matrix()
    for segment, degrees in (("l_thigh", -100), ("r_shin", 90)):
        relative[24:26, SEGMENTS.index(segment)] = Rotation.from_euler("y", degrees, degrees=True).as_matrix()
    asked = composed(relative)
    got, beyond = limit_joints(asked, FPS)
    assert beyond == 0
    assert speeds(asked).max() > 35
    assert speeds(got).max() < 16
    np.testing.assert_allclose(parted(got)[:, foot - 1], relative[:, foot], atol=1e-9)
    np.testing.assert_allclose(got[[*range(20), *range(30, 50)]], asked[[*range(20), *range(30, 50)]], atol=1e-9)


@pytest.mark.parametrize("seed", range(6))
def test_procedural_people_stay_within_limits(seed):
    motion = make_motion(ProceduralConfig(gesture=1.0), seconds=5, fps=25, rng=np.random.default_rng(seed))
    kept, beyond = limit_joints(motion.rotations, FPS)
    assert beyond == 0
    assert kept is motion.rotations


def test_recorded_people_stay_within_limits(data_folder):
    """Walks, a run, jumps, punches, a sword fight and balancing: no frame is changed."""
    for kind, folder in (("amc", "asf_amc"), ("c3d", "c3d"), ("bvh", "bvh_mb")):
        for take in takes(MotionConfig(kind=kind, path=str(data_folder / "cmu" / folder))):
            assert limit_joints((motion := read_take(take)).rotations[::4], motion.fps / 4)[1] == 0


def test_no_push_turns_a_joint_beyond_widest():
    model = build_scene(scene([BODY], 5), RIG, painted=False).model
    still = gliding(BODY, 1, (0, 0), (0, 0))
    reference = make_reference(still.root[:, None], still.rotations[:, None], np.zeros((1, 1, 2)), 25.0, 8)
    data = mujoco.MjData(model)
    controller, joints = Controller(model, data, reference, np.array([BODY.mass])), find_joints(model, 1)
    controller.start()
    head = SEGMENTS.index("head")
    for _ in range(200):
        controller.apply(0)
        joints.moves(data.qfrc_applied)[0, 1 + head] += (0, 0, 100.0)
        mujoco.mj_step(model, data)
    turned = 2 * np.arccos(np.abs(joints.quats(data.qpos)[0, head, 0]))
    # Twice the torque of the neck: without limits the head would keep turning.
    assert turned == pytest.approx(WIDEST[head], abs=0.1)
