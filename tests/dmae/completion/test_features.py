"""Blending: noisiness of poses, and the weight of corrections."""

import numpy as np
import pytest

from dmae.completion.features import (
    bone_length_offsets,
    bone_stretch,
    correction_weight,
    held_offsets,
    jitter,
    near_measurement,
    noisiness,
    smooth_by_noise,
)
from dmae.data.clip import Poses3D, Source
from dmae.data.skeleton import SHELF14
from dmae.numerics.body import rotate_z
from dmae.numerics.filling import smooth

PARENTS = np.array([0, 0])


def turning_person(frames: int = 9) -> tuple[np.ndarray, np.ndarray]:
    """Return a root that moves along x while the body turns, with a child half a metre ahead; and the heading."""
    heading = np.linspace(0, np.pi / 2, frames)[:, None]
    root = np.stack([np.arange(frames), np.zeros(frames), np.ones(frames)], -1)[:, None]
    return np.stack([root, root + rotate_z(np.broadcast_to([0.5, 0, 0], root.shape), heading)], 2), heading


class TestHeldOffsets:
    def test_a_joint_still_in_the_body_has_no_offset_there(self):
        xyz, heading = turning_person()
        observed = np.ones((9, 1, 2), bool)
        observed[3:6, 0, 1] = False
        off = held_offsets(xyz, observed, PARENTS, heading)
        np.testing.assert_allclose(off[..., :2, :], 0, atol=1e-12)
        # In the world it was left behind, and is not there yet.
        np.testing.assert_allclose(off[4, 0, 1, 2], xyz[2, 0, 1] - xyz[4, 0, 1])
        np.testing.assert_allclose(off[4, 0, 1, 3], xyz[6, 0, 1] - xyz[4, 0, 1])
        assert not off[observed].any()

    def test_a_move_in_the_body_is_an_offset_in_the_world(self):
        xyz, heading = turning_person()
        xyz[6:, 0, 1] += rotate_z(np.tile([0, 0.2, 0], (3, 1)), heading[6:, 0])
        observed = np.ones((9, 1, 2), bool)
        observed[3:6, 0, 1] = False
        off = held_offsets(xyz, observed, PARENTS, heading)
        np.testing.assert_allclose(off[4, 0, 1, 1], rotate_z(np.array([0, 0.2, 0]), heading[4, 0]), atol=1e-12)

    def test_offsets_are_zero_for_a_side_on_which_a_joint_is_never_observed(self):
        xyz, heading = turning_person()
        observed = np.ones((9, 1, 2), bool)
        observed[4:, 0, 1] = False
        off = held_offsets(xyz, observed, PARENTS, heading)
        assert off[5, 0, 1, 2].any()
        assert not off[4:, 0, 1, [1, 3]].any()


class TestJitter:
    def test_noise_has_jitter_and_motion_has_little(self):
        rng = np.random.default_rng(0)
        time = np.arange(200)[:, None, None, None] / 25
        smooth = np.sin(3 * time) * np.ones((1, 2, 3, 3)) * 0.2
        noisy = smooth + rng.normal(0, 0.01, smooth.shape) * np.array([0, 1])[:, None, None]
        rough = jitter(noisy)[5:-5]
        assert rough[:, 0].max() < -1
        # The third difference of white noise has 20 times its variance; three of them are some 1.6 deviations long.
        assert rough[:, 1].mean() == pytest.approx(np.log(1.6 * np.sqrt(20)), abs=0.2)

    def test_a_hidden_joint_takes_the_jitter_at_the_edges_of_its_gap(self):
        rng = np.random.default_rng(0)
        xyz = np.zeros((80, 1, 2, 3))
        xyz[:30, 0, 0] = rng.normal(0, 0.05, (30, 3))
        xyz[30:50, 0, 0] = np.nan
        person, before, after = jitter(xyz)[40, 0, 0]
        assert before > person > 1
        assert after == pytest.approx(np.log(0.1))

    @pytest.mark.parametrize("frames", [1, 3, 5])
    def test_hardly_measured_joints_have_the_default_jitter(self, frames):
        xyz = np.full((frames, 1, 2, 3), np.nan)
        xyz[0] = 0
        np.testing.assert_allclose(jitter(xyz), np.log(1.1))


class TestBoneStretch:
    def test_swinging_limbs_keep_their_length_and_noisy_ones_do_not(self):
        rng = np.random.default_rng(0)
        angle = 10 * np.sin(np.arange(100) / 5)
        child = 0.3 * np.stack([np.cos(angle), np.sin(angle), np.zeros(100)], -1)
        xyz = np.zeros((100, 2, 2, 3))
        xyz[:, :, 1] = child[:, None] + rng.normal(0, 0.02, (100, 2, 3)) * np.array([0, 1])[:, None]
        exact, noisy = bone_stretch(xyz, [(0, 1)]).transpose(1, 0, 2, 3)
        np.testing.assert_allclose(exact, np.log(0.1))
        # The mean size of a Gaussian is 0.8 deviations.
        assert noisy[..., 0].mean() == pytest.approx(np.log(0.8 * 2 + 0.1), abs=0.15)
        # A root has no bone; it is as its person.
        np.testing.assert_array_equal(noisy[:, 0, 1], noisy[:, 0, 0])

    def test_a_hidden_joint_takes_the_bone_stretch_at_the_edges_of_its_gap(self):
        xyz = np.zeros((80, 1, 2, 3))
        xyz[:, 0, 1, 0] = 0.3
        xyz[29, 0, 1, 0] = 0.5
        xyz[30:50, 0, 1] = np.nan
        _, before, after = bone_stretch(xyz, [(0, 1)])[40, 0, 1]
        assert before > np.log(5)
        assert after == pytest.approx(np.log(0.1))

    def test_people_never_measured_have_the_default_stretch(self):
        np.testing.assert_allclose(bone_stretch(np.full((4, 1, 2, 3), np.nan), [(0, 1)]), np.log(1.1))


class TestBoneLengthOffsets:
    BONES = ((0, 1), (1, 2), (1, 3))

    def arm(self) -> np.ndarray:
        """A root at the origin, a joint 0.3 m along x, and two children of that 0.4 m along x and y."""
        return np.tile([[0, 0, 0], [0.3, 0, 0], [0.7, 0, 0], [0.3, 0.4, 0]], (9, 1, 1, 1)).reshape(9, 1, 4, 3)

    def test_a_bone_too_long_gives_an_offset_back(self):
        base, xyz = self.arm(), self.arm()
        xyz[3:6, 0, 2] = np.nan
        base[3:6, 0, 2] = [0.3, 0, 0.5]
        off = bone_length_offsets(base, xyz, self.BONES)
        np.testing.assert_allclose(off[4, 0, 2, 0], [0, 0, -0.1])
        assert not off[:, :, [0, 1, 3]].any() and not off[[2, 6]].any()

    def test_bones_of_children_give_an_offset_of_their_parent(self):
        base, xyz = self.arm(), self.arm()
        xyz[3:6, 0, 1] = np.nan
        base[3:6, 0, 1] = [0.2, 0, 0]
        parent, children = bone_length_offsets(base, xyz, self.BONES)[4, 0, 1]
        np.testing.assert_allclose(parent, [0.1, 0, 0])
        to_second = np.array([0.1, 0.4, 0])
        length = np.linalg.norm(to_second)
        np.testing.assert_allclose(children, ([0.1, 0, 0] + to_second * (1 - 0.4 / length)) / 2)

    def test_bones_never_measured_give_no_offset(self):
        xyz = self.arm()
        xyz[:, 0, 2] = np.nan
        assert not bone_length_offsets(self.arm(), xyz, self.BONES).any()


@pytest.fixture
def people() -> Poses3D:
    """Three people with swinging joints, measured exactly, to a few millimetres, and to some centimetres."""
    rng = np.random.default_rng(0)
    time = np.arange(100)[:, None, None, None] / 25
    xyz = rng.normal(0, 0.3, (1, 1, 14, 3)) + np.sin(20 * time) * [0.3, 0.1, 0]
    return Poses3D(SHELF14, xyz + rng.normal(size=(100, 3, 14, 3)) * np.array([0, 0.004, 0.03])[:, None, None])


def test_noisiness_separates_exact_from_noisy_poses(people):
    exact, between, captured = noisiness(people, 25.0)[..., 0].T
    assert exact.max() == 0
    assert 0 < between.min() <= between.max() < 1
    assert captured.min() == 1


def test_noisiness_is_averaged_over_as_many_seconds_at_any_rate():
    """Of poses that become noisy after 6 s, and every fourth of their frames."""
    rng = np.random.default_rng(0)
    xyz = (
        rng.normal(0, 0.3, (1, 1, 14, 3))
        + rng.normal(0, 0.012, (1200, 1, 14, 3)) * (np.arange(1200) >= 600)[:, None, None, None]
    )
    often, seldom = (noisiness(Poses3D(SHELF14, xyz[::step]), 100 / step)[..., 0] for step in (1, 4))
    np.testing.assert_allclose(often[::4], seldom, atol=0.15)


def test_people_never_measured_count_as_noisy():
    assert (noisiness(Poses3D(SHELF14, np.full((5, 1, 14, 3), np.nan)), 25.0) == 1).all()


def test_interpolated_joints_are_corrected_and_exactly_measured_ones_are_not(people):
    hidden = np.zeros(people.measured.shape, bool)
    hidden[10:12, :, 3] = hidden[40:90, :, 3] = True
    counts = correction_weight(people.without(hidden), 25.0)[..., 3, 0]
    assert (counts[hidden[..., 3]] == 1).all()
    exact, between, captured = counts[~hidden[:, 0, 3]].T
    assert exact.max() == 0 and captured.min() == 1
    assert 0 < between.min() <= between.max() < 1


def test_exact_poses_are_not_smoothed_and_captured_ones_are_in_full(people):
    found, full = smooth_by_noise(people, noisiness(people, 25.0), 25.0, 0.1), smooth(people, 25.0, 0.1)
    np.testing.assert_array_equal(found.xyz[:, 0], people.xyz[:, 0])
    np.testing.assert_allclose(found.xyz[:, 2], full.xyz[:, 2], atol=1e-6)
    moved = np.linalg.norm(np.stack([found.xyz, full.xyz]) - people.xyz, axis=-1).mean((1, 3))
    assert 0 < moved[0, 1] < moved[1, 1]
    assert (found.source[:, 0] == Source.MEASURED).all() and (found.source[:, 1:] == Source.DENOISED).all()


def test_near_measurement_is_within_a_fifth_of_a_second(people):
    hidden = np.ones(people.measured.shape, bool)
    hidden[50, :2, 7] = False
    near = near_measurement(people.without(hidden), 25.0)[..., 0]
    np.testing.assert_array_equal(np.flatnonzero(near[:, 0]), np.arange(45, 56))
    assert not near[:, 2].any()
