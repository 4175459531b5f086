"""The Gaussian process: hidden limbs are predicted from the person's poses in other frames."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dmae.completion.fillings import fill_pchip_body
from dmae.completion.gaussian_process import fill_gaussian_process, place_limbs, predict_gap, predict_offset
from dmae.completion.methods import find_method
from dmae.data.clip import Poses3D
from dmae.data.skeleton import BODY25, SKELETONS, get_skeleton
from dmae.numerics.body import interpolate_bodies, rotate_z
from dmae.numerics.paths import pchip
from tests.support.circling_people import circling_people
from tests.support.gaps import without

FPS = 25.0
ELBOW, WRIST = BODY25.index("l_elbow", "l_wrist")


def circling(hidden: slice = slice(60, 90), joints=(ELBOW, WRIST), fps: float = FPS, frames: int = 200):
    """Return a circling person with one arm hidden for longer than one swing; and the truth."""
    truth = circling_people(frames, 1, rng=np.random.default_rng(0), fps=fps)
    return without(truth, hidden, 0, list(joints)), truth.xyz


def off(poses: Poses3D, truth: np.ndarray, joint: int = WRIST) -> np.ndarray:
    return 1000 * np.linalg.norm(poses.xyz[:, 0, joint] - truth[:, 0, joint], axis=-1)


@pytest.mark.parametrize("fps", [10.0, 25.0, 120.0])
def test_a_hidden_arm_keeps_swinging(fps):
    holed, truth = circling(slice(int(3 * fps), int(4.2 * fps)), fps=fps, frames=int(8 * fps))
    hidden = slice(int(3 * fps), int(4.2 * fps))
    assert off(fill_pchip_body(holed, fps), truth)[hidden].mean() > 80
    assert off(fill_gaussian_process(holed, fps), truth)[hidden].mean() < 35


def test_measured_joints_stay_and_paths_are_continuous():
    holed, truth = circling()
    filled = fill_gaussian_process(holed, FPS)
    seen = ~np.isnan(holed.xyz).any(-1)
    np.testing.assert_array_equal(filled.xyz[seen], holed.xyz[seen])
    step = np.linalg.norm(np.diff(filled.xyz[:, 0, WRIST], axis=0), axis=-1)
    assert step[55:95].max() < 1.5 * np.linalg.norm(np.diff(truth[:, 0, WRIST], axis=0), axis=-1).max()


def test_short_gaps_are_interpolated():
    holed, truth = circling(slice(60, 62), (WRIST,))
    assert (
        off(fill_gaussian_process(holed, FPS), truth)[60:62].max()
        < off(fill_pchip_body(holed, FPS), truth)[60:62].max() + 3
    )


def test_the_result_does_not_depend_on_the_frame_of_the_world():
    holed, _ = circling()
    R, away = Rotation.from_euler("z", 1.0).as_matrix(), (3.0, -2.0, 0.5)
    there = fill_gaussian_process(Poses3D(BODY25, holed.xyz @ R.T + away), FPS)
    np.testing.assert_allclose(fill_gaussian_process(holed, FPS).xyz @ R.T + away, there.xyz, atol=1e-3)


def test_with_few_training_poses_limbs_are_interpolated():
    holed, _ = circling(slice(8, 192))
    np.testing.assert_array_equal(fill_gaussian_process(holed, FPS).xyz, fill_pchip_body(holed, FPS).xyz)
    nothing = Poses3D(BODY25, np.full((30, 2, 25, 3), np.nan))
    assert np.isnan(fill_gaussian_process(nothing, FPS).xyz).all()


def test_a_joint_that_follows_another_is_predicted_from_it():
    """One joint moves in proportion to another, and is hidden in the middle."""
    swing = np.sin(np.arange(100) / 5)[:, None]
    offsets = np.concatenate([swing * (0.3, 0, 0), swing * (0, 0.2, 0)], 1).reshape(100, 2, 3)
    hidden = (np.arange(100) >= 40) & (np.arange(100) < 60)
    unseen = offsets.copy()
    unseen[hidden, 1] = 7
    found = predict_offset(unseen, 1, [0], ~hidden, hidden, FPS)
    np.testing.assert_allclose(found[39:61], offsets[39:61, 1], atol=0.01)
    assert np.isnan(found[:39]).all() and np.isnan(found[61:]).all()


def test_training_poses_do_not_grow_with_the_recording():
    """Takes seconds: only the poses nearest in time are used."""
    holed, truth = circling(slice(5000, 5040), frames=10000)
    assert off(fill_gaussian_process(holed, FPS), truth)[5000:5040].mean() < 35


@pytest.mark.parametrize("name", SKELETONS)
def test_limbs_of_every_skeleton_are_filled(name):
    """Also skeletons in which the torso is below the head."""
    rng = np.random.default_rng(0)
    skeleton = get_skeleton(name)
    truth = np.cumsum(rng.normal(0, 0.01, (60, 1, len(skeleton), 3)), 0) + rng.normal(0, 0.3, (len(skeleton), 3))
    for joint in range(len(skeleton)):
        holed = without(Poses3D(skeleton, truth), slice(20, 40), 0, joint)
        assert not np.isnan(fill_gaussian_process(holed, FPS).xyz).any()


def test_rejection_precedes_the_gaussian_process():
    holed, truth = circling()
    xyz = holed.xyz.copy()
    xyz[20, 0, WRIST] += (0, 0, 0.6)
    assert off(find_method("reject_gaussian_process").load()(Poses3D(BODY25, xyz), FPS), truth)[[20, 75]].max() < 100


# Exact poses: limbs by a second process, and the torso by the joints around it.

GAP = slice(60, 90)
HIPS = BODY25.index("mid_hip", "l_hip", "r_hip")
LEFT, RIGHT, MIDDLE, KNEE = BODY25.index("l_hip", "r_hip", "mid_hip", "l_knee")
LOWER = ("hip", "knee", "ankle", "toe", "heel")


def leaning(joints: list[int]) -> tuple[Poses3D, np.ndarray]:
    """Return a person with an upper body that leans to and fro, joints of it hidden for a while; and the truth."""
    xyz = circling_people(200, 1, rng=np.random.default_rng(0)).xyz.astype(np.float64)
    # All bones keep their lengths, as those of motion capture do.
    turned = rotate_z(np.broadcast_to(xyz[0, 0] - xyz[0, 0, MIDDLE], xyz[:, 0].shape), np.arange(200)[:, None] / 40)
    xyz[:, 0] = xyz[:1, 0, [MIDDLE]] + turned
    across = xyz[:, 0, LEFT] - xyz[:, 0, RIGHT]
    axis = across / np.linalg.norm(across, axis=-1, keepdims=True)
    lean = Rotation.from_rotvec(axis * 0.4 * np.sin(np.arange(200) / 7.0)[:, None]).as_matrix()
    above = [i for i, joint in enumerate(BODY25.joints) if not any(part in joint for part in LOWER)]
    hip = xyz[:, :, [MIDDLE]]
    xyz[:, :, above] = hip + np.einsum("fij,fpkj->fpki", lean, xyz[:, :, above] - hip)
    return without(Poses3D(BODY25, xyz), GAP, 0, joints), xyz


def error(xyz: np.ndarray, truth: np.ndarray, joints: list[int]) -> float:
    return 1000 * float(np.linalg.norm(xyz - truth, axis=-1)[GAP, 0][:, joints].mean())


def by_one_kernel(poses: Poses3D) -> np.ndarray:
    bodies = interpolate_bodies(poses.xyz.astype(np.float64), BODY25, FPS, pchip, poses.rays)
    place_limbs(bodies, FPS)
    return bodies.filled


def test_knees_say_where_hips_are():
    given, truth = leaning(HIPS)
    assert error(fill_gaussian_process(given, FPS).xyz, truth, HIPS) < 0.2 * error(by_one_kernel(given), truth, HIPS)


def test_a_torso_of_which_nothing_is_seen_is_left_to_interpolation():
    given, _ = leaning([joint for joint in range(25) if joint != KNEE])
    filled = fill_gaussian_process(given, FPS).xyz
    np.testing.assert_allclose(filled[:, :, HIPS], by_one_kernel(given)[:, :, HIPS], atol=1e-6)


def test_single_cameras_that_see_a_joint_say_more():
    given, truth = leaning(HIPS)
    rays = np.full((*given.xyz.shape[:3], 2, 3), np.nan)
    for hip in HIPS:
        rays[GAP, :, hip, 0] = truth[GAP, :, hip] - [1, 0, 0]
        rays[GAP, :, hip, 1] = [1, 0, 0]
    seen = Poses3D(BODY25, given.xyz, rays=rays)
    filled = fill_gaussian_process(seen, FPS).xyz
    np.testing.assert_allclose(filled[GAP, :, HIPS], by_one_kernel(seen)[GAP, :, HIPS], atol=1e-6)


def test_noisy_poses_are_filled_by_one_kernel():
    given, _ = leaning(HIPS)
    noisy = Poses3D(BODY25, given.xyz + np.random.default_rng(0).normal(0, 0.03, given.xyz.shape))
    filled = fill_gaussian_process(noisy, FPS)
    np.testing.assert_array_equal(filled.xyz, np.float32(by_one_kernel(noisy)))


def test_a_joint_is_predicted_from_those_that_it_moves_with():
    """Of two that move, one alone says where the wanted joint is; that one tells two poses apart at any time."""
    rng = np.random.default_rng(0)
    told, other = rng.uniform(-0.2, 0.2, (2, 150, 3)).cumsum(1).clip(-0.3, 0.3)
    wanted = 0.5 * told[:, [1, 2, 0]]
    gap = np.arange(70, 90)
    training = np.delete(np.arange(150), gap)
    frames = np.concatenate([training, gap])
    found = predict_gap(np.stack([told, other], 1)[frames], wanted[training], frames, FPS)
    assert np.linalg.norm(found - wanted[70:90], axis=-1).mean() < 0.2 * np.linalg.norm(wanted[70:90], axis=-1).mean()
