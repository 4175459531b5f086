"""Random processes, likely errors, and poses without the joints that have a large one."""

import numpy as np
import pytest

from dmae.data.clip import Poses3D, Source
from dmae.data.skeleton import BODY25
from dmae.numerics.noise import ar1_filter, ar1_noise, bursts, multiscale_noise
from dmae.numerics.statistics import likely_error, without_unlikely
from tests.support.clips import walkers


def test_ar1_noise_is_standard_normal_and_decorrelates_in_the_time_given():
    values = ar1_noise((5000, 40), 50, 0.1, rng=np.random.default_rng(0))
    assert abs(values.mean()) < 0.03
    assert abs(values.std() - 1) < 0.02
    # From the first frame on.
    assert abs(ar1_noise((1, 100_000), 50, 0.1, rng=np.random.default_rng(1)).std() - 1) < 0.02
    assert abs((values[5:] * values[:-5]).mean() - np.exp(-1)) < 0.03
    assert abs((ar1_noise((5000, 40), 50, 0, rng=np.random.default_rng(2))[1:] * values[:-1]).mean()) < 0.01


def test_bursts_have_the_probability_given_and_vary_in_length():
    noise = multiscale_noise((20_000, 20), 25, [3.0, 0.4], rng=np.random.default_rng(0))
    assert abs(noise.std() - 1) < 0.1
    missed = bursts(0.12, noise)
    assert abs(missed.mean() - 0.12) < 0.01
    edges = np.diff(np.pad(missed, ((1, 1), (0, 0))).astype(int).T)
    lengths = np.nonzero(edges == -1)[1] - np.nonzero(edges == 1)[1]
    # A Markov chain's longest tenth of bursts would hold a third of the events.
    assert lengths[lengths >= np.quantile(lengths, 0.9)].sum() > 0.4 * lengths.sum()
    assert not bursts(0.0, noise).any()
    assert bursts(1.0, noise).all()


@pytest.mark.parametrize("coefficient", [0.0, 0.5, 0.97])
def test_ar1_filter_is_the_recursion(coefficient):
    white = np.random.default_rng(0).normal(size=(50, 3))
    expected = [white[0]]
    for step in white[1:]:
        expected.append(coefficient * expected[-1] + np.sqrt(1 - coefficient**2) * step)
    np.testing.assert_allclose(ar1_filter(white, coefficient), expected, rtol=1e-12)


def test_half_of_a_gaussian_is_nearer():
    error = np.random.default_rng(0).normal(0, 0.02, (20000, 3))
    assert (np.linalg.norm(error, axis=-1) < likely_error(0.02**2 * np.eye(3))).mean() == pytest.approx(0.5, abs=0.02)
    assert np.isnan(likely_error(np.full((3, 3), np.nan)))


def test_what_is_likely_worse_is_left_out():
    poses = walkers(4, 1)
    cov, source = np.full((4, 1, 25, 3, 3), np.nan), poses.source.copy()
    cov[0], cov[1] = 0.01**2 * np.eye(3), 0.1**2 * np.eye(3)
    source[:3] = Source.COMPLETED
    found = without_unlikely(Poses3D(BODY25, poses.xyz, source, cov), 30)
    # Sure, unsure, completed without a covariance, measured without one.
    assert (found.source[:, 0, 0] == [Source.COMPLETED, Source.ABSENT, Source.ABSENT, Source.MEASURED]).all()
    assert without_unlikely(poses, None) is poses


@pytest.mark.parametrize("limit", [0, -1, float("nan"), float("inf")])
def test_impossible_limits_are_refused(limit):
    with pytest.raises(ValueError, match="keep_mm"):
        without_unlikely(walkers(), limit)
