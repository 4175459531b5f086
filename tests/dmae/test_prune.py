"""What is pruned, and what is left alone."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dmae.associate import NONE
from dmae.prune import bone_lengths, broken, by_chance, ghosts, jumps, merge, same_person
from dmae.skeleton import BODY25

from .examples import t_pose

FPS = 25.0


def standing(frames: int = 40, persons: int = 1, scale: float = 1.0) -> np.ndarray:
    """(F, P, 25, 3) T-poses a metre apart."""
    xyz = np.tile(scale * t_pose(), (frames, persons, 1, 1))
    xyz[..., 1] += np.arange(persons)[:, None]
    return xyz


def test_bone_lengths_are_those_of_both_sides():
    xyz = standing(persons=2)
    thigh = BODY25.bones.index(tuple(BODY25.index("l_hip", "l_knee")))
    xyz[:, 1, BODY25.index("l_knee")[0]] = np.nan
    lengths = bone_lengths(xyz, BODY25)
    np.testing.assert_allclose(lengths[0], lengths[1])
    assert 0.4 < lengths[1, thigh] < 0.5


@pytest.mark.parametrize("joint", ["l_wrist", "l_elbow", "r_knee", "nose"])
def test_the_joint_that_broke_its_bones_is_blamed(joint):
    xyz = standing()
    xyz[7, 0, BODY25.index(joint)[0]] += (0.3, 0.2, 0.3)
    assert np.argwhere(broken(xyz, BODY25)).tolist() == [[7, 0, BODY25.index(joint)[0]]]


def test_nothing_is_broken_in_another_pose_or_where_nothing_is():
    xyz = standing()
    turned = xyz[..., [1, 2, 0]].copy()
    turned[5:9, 0, 3:8] = np.nan
    assert not broken(turned, BODY25).any()


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 2**32 - 1), st.sampled_from([25.0, 60.0]))
def test_swinging_hands_do_not_jump(seed, fps):
    """Half a metre to and fro twice a second is 39 m/s^2 at most; with noise and gaps."""
    rng = np.random.default_rng(seed)
    time = np.arange(100) / fps
    xyz = rng.normal(0, 0.015, (100, 1, 3))
    xyz[:, 0, 0] += 0.25 * np.sin(4 * np.pi * time + rng.uniform(0, 6)) + 2 * time
    xyz[rng.random(100) < 0.2] = np.nan
    assert not jumps(xyz, fps).any()


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 4))
def test_a_jump_is_found_whole_and_alone(seed, width):
    rng = np.random.default_rng(seed)
    xyz = np.cumsum(rng.normal(0, 0.005, (60, 2, 3)), 0)
    start = int(rng.integers(1, 60 - width - 1))
    xyz[start : start + width, 1] += 0.8 * np.array([0.6, 0, 0.8])
    assert np.argwhere(jumps(xyz, FPS)).tolist() == [[frame, 1] for frame in range(start, start + width)]


def test_a_step_that_does_not_return_is_no_jump():
    xyz = np.zeros((40, 1, 3))
    xyz[20:] = 1
    assert not jumps(xyz, FPS).any()


def test_ghosts_are_those_that_hardly_live():
    xyz = standing(persons=3)
    xyz[5:, 1] = np.nan
    xyz[:, 2, 3:] = np.nan
    assert ghosts(xyz, FPS, joints=4, seconds=0.3).tolist() == [False, True, True]


def test_views_that_agree_by_chance_agree_on_few_joints():
    xyz = standing(persons=3)
    xyz[:, 1, ::2] = np.nan
    xyz[:, 2, :5] = np.nan
    chosen = np.zeros((*xyz.shape[:2], 3, 25), int)
    chosen[:, :, 2] = NONE
    assert by_chance(xyz, chosen, views=2).tolist() == [False, True, False]
    # A single view promises nothing.
    chosen[:, 1, 1, ::2] = NONE
    assert not by_chance(xyz, chosen, views=2).any()


def test_in_a_short_clip_half_of_it_is_enough():
    assert not ghosts(standing(frames=3), FPS, joints=4, seconds=0.3).any()


def test_doubles_and_returns_are_one_person():
    """Track 1 doubles 0, track 3 is 2 come back; 4 comes back too late, and 5 is a child where somebody left."""
    xyz = standing(frames=200, persons=6)
    xyz[:, 1] = xyz[:, 0] + 0.03
    xyz[:, 3] = xyz[:, 4] = xyz[:, 2]
    xyz[:, 5] = standing(frames=200, scale=0.7)[:, 0] + (0, 2, 0)
    for track, (start, end) in enumerate([(0, 200), (50, 90), (0, 40), (60, 80), (180, 200), (82, 120)]):
        xyz[:start, track], xyz[end:, track] = np.nan, np.nan
    assert same_person(xyz, BODY25, FPS, rejoin=2.0).tolist() == [0, 0, 2, 2, 4, 5]


def test_who_is_far_off_did_not_come_back():
    xyz = standing(frames=60, persons=2)
    xyz[20:, 0], xyz[:25, 1] = np.nan, np.nan
    assert same_person(xyz, BODY25, FPS, 2.0).tolist() == [0, 1]
    xyz[:, 1, :, 1] -= 1
    assert same_person(xyz, BODY25, FPS, 2.0).tolist() == [0, 0]


def test_nobody_returns_into_two():
    xyz = standing(frames=60, persons=3)
    xyz[:, 1:, :, 1] -= ((0.9,), (2.1,))
    xyz[20:, 0], xyz[:25, 1:] = np.nan, np.nan
    assert same_person(xyz, BODY25, FPS, 2.0).tolist() == [0, 0, 2]


def test_merging_keeps_the_older_and_fills_from_the_younger():
    xyz = standing(frames=4, persons=3)
    chosen = np.broadcast_to(np.arange(3)[:, None, None], (4, 3, 2, 25)).copy()
    chosen[2:, 0], xyz[2:, 0] = NONE, np.nan
    merged, joints = merge(chosen, xyz, np.array([0, 0, 2]))
    assert merged[:, :, 0, 0].tolist() == [[0, 2], [0, 2], [1, 2], [1, 2]]
    np.testing.assert_array_equal(joints[1:3, 0], xyz[[1, 2], [0, 1]])
    np.testing.assert_array_equal(joints[:, 1], xyz[:, 2])
