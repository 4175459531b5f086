"""Joints that are pruned, and joints that are kept."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dmae.data.skeleton import BODY25
from dmae.numerics.body import symmetric_bone_lengths
from dmae.reconstruction.pruning import broken, jumps
from tests.support.detected_people import FPS, standing


def test_the_usual_length_of_a_bone_is_that_of_both_sides():
    xyz = standing(persons=2)
    thigh = BODY25.bones.index(tuple(BODY25.index("l_hip", "l_knee")))
    xyz[:, 1, BODY25.index("l_knee")[0]] = np.nan
    lengths = symmetric_bone_lengths(xyz, BODY25)
    np.testing.assert_allclose(lengths[0], lengths[1])
    assert 0.4 < lengths[1, thigh] < 0.5


@pytest.mark.parametrize("joint", ["l_wrist", "l_elbow", "r_knee", "nose"])
def test_the_joint_that_broke_its_bones_is_found(joint):
    xyz = standing()
    xyz[7, 0, BODY25.index(joint)[0]] += (0.3, 0.2, 0.3)
    assert np.argwhere(broken(xyz, BODY25)).tolist() == [[7, 0, BODY25.index(joint)[0]]]


def test_no_bone_is_broken_in_another_pose_or_by_absent_joints():
    xyz = standing()
    turned = xyz[..., [1, 2, 0]].copy()
    turned[5:9, 0, 3:8] = np.nan
    assert not broken(turned, BODY25).any()


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 2**32 - 1), st.sampled_from([25.0, 60.0]))
def test_swinging_hands_do_not_jump(seed, fps):
    """Half a metre back and forth twice a second is 39 m/s^2 at most; with noise and gaps."""
    rng = np.random.default_rng(seed)
    time = np.arange(100) / fps
    xyz = rng.normal(0, 0.015, (100, 1, 3))
    xyz[:, 0, 0] += 0.25 * np.sin(4 * np.pi * time + rng.uniform(0, 6)) + 2 * time
    xyz[rng.random(100) < 0.2] = np.nan
    assert not jumps(xyz, fps).any()


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 4))
def test_all_samples_of_a_jump_are_found_and_no_others(seed, width):
    rng = np.random.default_rng(seed)
    xyz = np.cumsum(rng.normal(0, 0.005, (60, 2, 3)), 0)
    start = int(rng.integers(1, 60 - width - 1))
    xyz[start : start + width, 1] += 0.8 * np.array([0.6, 0, 0.8])
    assert np.argwhere(jumps(xyz, FPS)).tolist() == [[frame, 1] for frame in range(start, start + width)]


def test_a_step_without_return_is_no_jump():
    xyz = np.zeros((40, 1, 3))
    xyz[20:] = 1
    assert not jumps(xyz, FPS).any()
