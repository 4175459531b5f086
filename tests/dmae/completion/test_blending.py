"""Blending: noisiness of poses, and the weight of corrections."""

import numpy as np
import pytest

from dmae.completion.blending import correction_weight, near_measurement, noisiness, smooth_by_noise
from dmae.data.clip import Poses3D, Source
from dmae.data.skeleton import SHELF14
from dmae.numerics.filling import smooth


@pytest.fixture
def people() -> Poses3D:
    """Three people with swinging joints, measured exactly, to a few millimetres, and to some centimetres."""
    rng = np.random.default_rng(0)
    time = np.arange(100)[:, None, None, None] / 25
    xyz = rng.normal(0, 0.3, (1, 1, 14, 3)) + np.sin(20 * time) * [0.3, 0.1, 0]
    return Poses3D(SHELF14, xyz + rng.normal(size=(100, 3, 14, 3)) * np.array([0, 0.004, 0.03])[:, None, None])


def test_noisiness_separates_exact_from_noisy_poses(people):
    exact, between, captured = noisiness(people)[..., 0].T
    assert exact.max() == 0
    assert 0 < between.min() <= between.max() < 1
    assert captured.min() == 1


def test_people_never_measured_count_as_noisy():
    assert (noisiness(Poses3D(SHELF14, np.full((5, 1, 14, 3), np.nan))) == 1).all()


def test_interpolated_joints_are_corrected_and_exactly_measured_ones_are_not(people):
    hidden = np.zeros(people.measured.shape, bool)
    hidden[10:12, :, 3] = hidden[40:90, :, 3] = True
    counts = correction_weight(people.without(hidden))[..., 3, 0]
    assert (counts[hidden[..., 3]] == 1).all()
    exact, between, captured = counts[~hidden[:, 0, 3]].T
    assert exact.max() == 0 and captured.min() == 1
    assert 0 < between.min() <= between.max() < 1


def test_exact_poses_are_not_smoothed_and_captured_ones_are_in_full(people):
    found, full = smooth_by_noise(people, noisiness(people), 25.0, 0.1), smooth(people, 25.0, 0.1)
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
