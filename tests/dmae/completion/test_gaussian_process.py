"""The Gaussian process: hidden limbs are predicted from the person's poses in other frames."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dmae.completion.fillings import fill_pchip_body
from dmae.completion.gaussian_process import fill_gaussian_process, predict_offset
from dmae.completion.methods import METHODS
from dmae.data.clip import Poses3D
from dmae.data.skeleton import BODY25, SKELETONS, get_skeleton
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
    assert off(METHODS["reject_gaussian_process"](Poses3D(BODY25, xyz), FPS), truth)[[20, 75]].max() < 100
