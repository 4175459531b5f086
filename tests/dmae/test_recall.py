"""Hidden limbs are where the person held them when the rest of the body was alike."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dmae.baselines import METHODS, fill_pchip_body, fill_recall
from dmae.clip import Poses3D
from dmae.recall import recall
from dmae.skeleton import BODY25, SKELETONS, get_skeleton

from .holed import without
from .strollers import strollers

FPS = 25.0
ELBOW, WRIST = BODY25.index("l_elbow", "l_wrist")


def strolling(hidden: slice = slice(60, 90), joints=(ELBOW, WRIST), fps: float = FPS, frames: int = 200):
    """Somebody who strolls and of whom one arm is hidden for longer than it swings; and the truth."""
    truth = strollers(frames, 1, rng=np.random.default_rng(0), fps=fps)
    return without(truth, hidden, 0, list(joints)), truth.xyz


def off(poses: Poses3D, truth: np.ndarray, joint: int = WRIST) -> np.ndarray:
    return 1000 * np.linalg.norm(poses.xyz[:, 0, joint] - truth[:, 0, joint], axis=-1)


@pytest.mark.parametrize("fps", [10.0, 25.0, 120.0])
def test_an_arm_swings_on_while_nobody_sees_it(fps):
    holed, truth = strolling(slice(int(3 * fps), int(4.2 * fps)), fps=fps, frames=int(8 * fps))
    hidden = slice(int(3 * fps), int(4.2 * fps))
    assert off(fill_pchip_body(holed, fps), truth)[hidden].mean() > 80
    assert off(fill_recall(holed, fps), truth)[hidden].mean() < 35


def test_what_was_measured_stays_and_paths_are_whole():
    holed, truth = strolling()
    filled = fill_recall(holed, FPS)
    seen = ~np.isnan(holed.xyz).any(-1)
    np.testing.assert_array_equal(filled.xyz[seen], holed.xyz[seen])
    step = np.linalg.norm(np.diff(filled.xyz[:, 0, WRIST], axis=0), axis=-1)
    assert step[55:95].max() < 1.5 * np.linalg.norm(np.diff(truth[:, 0, WRIST], axis=0), axis=-1).max()


def test_short_holes_are_passed_through_as_they_were_entered():
    holed, truth = strolling(slice(60, 62), (WRIST,))
    assert off(fill_recall(holed, FPS), truth)[60:62].max() < off(fill_pchip_body(holed, FPS), truth)[60:62].max() + 3


def test_it_does_not_matter_where_north_is():
    holed, _ = strolling()
    R, away = Rotation.from_euler("z", 1.0).as_matrix(), (3.0, -2.0, 0.5)
    there = fill_recall(Poses3D(BODY25, holed.xyz @ R.T + away), FPS)
    np.testing.assert_allclose(fill_recall(holed, FPS).xyz @ R.T + away, there.xyz, atol=1e-3)


def test_what_was_hardly_ever_seen_is_not_recalled():
    holed, _ = strolling(slice(8, 192))
    np.testing.assert_array_equal(fill_recall(holed, FPS).xyz, fill_pchip_body(holed, FPS).xyz)
    nothing = Poses3D(BODY25, np.full((30, 2, 25, 3), np.nan))
    assert np.isnan(fill_recall(nothing, FPS).xyz).all()


def test_an_expectation_by_hand():
    """A joint that goes as another does, once to either side, and is asked for in the middle of it."""
    swing = np.sin(np.arange(100) / 5)[:, None]
    offsets = np.concatenate([swing * (0.3, 0, 0), swing * (0, 0.2, 0)], 1).reshape(100, 2, 3)
    hidden = (np.arange(100) >= 40) & (np.arange(100) < 60)
    unseen = offsets.copy()
    unseen[hidden, 1] = 7
    found = recall(unseen, 1, [0], ~hidden, hidden, FPS)
    np.testing.assert_allclose(found[39:61], offsets[39:61, 1], atol=0.01)
    assert np.isnan(found[:39]).all() and np.isnan(found[61:]).all()


def test_long_recordings_are_remembered_in_part():
    """A matter of seconds: what is remembered does not grow with the recording."""
    holed, truth = strolling(slice(5000, 5040), frames=10000)
    assert off(fill_recall(holed, FPS), truth)[5000:5040].mean() < 35


@pytest.mark.parametrize("name", SKELETONS)
def test_every_skeleton_has_limbs_to_recall(name):
    """Whatever hangs from what: heads from which torsos hang are no exception."""
    rng = np.random.default_rng(0)
    skeleton = get_skeleton(name)
    truth = np.cumsum(rng.normal(0, 0.01, (60, 1, len(skeleton), 3)), 0) + rng.normal(0, 0.3, (len(skeleton), 3))
    for joint in range(len(skeleton)):
        holed = without(Poses3D(skeleton, truth), slice(20, 40), 0, joint)
        assert not np.isnan(fill_recall(holed, FPS).xyz).any()


def test_rejection_and_rays_come_with_it():
    holed, truth = strolling()
    xyz = holed.xyz.copy()
    xyz[20, 0, WRIST] += (0, 0, 0.6)
    assert off(METHODS["reject_recall"](Poses3D(BODY25, xyz), FPS), truth)[[20, 75]].max() < 100
