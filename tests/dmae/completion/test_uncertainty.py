"""Calibration of uncertainty: predicted scales become deviations that match the errors, by class of gap."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.stats import chi2

from dmae.completion.complete import CLASSES, Factors, calibrated
from dmae.completion.training import fit_factors
from dmae.data.clip import Poses3D, Source
from dmae.data.skeleton import SHELF14
from dmae.metrics.position import GAPS, REGION_PROBABILITY, REGION_RADIUS
from dmae.numerics.paths import gap_lengths

TRUTH = Poses3D(SHELF14, np.zeros((400, 4, 14, 3)))
DEVIATIONS = np.array([0.01, 0.02, 0.04, 0.08, 0.16])
"""m, by class of gap, the last where nothing was measured."""


@pytest.fixture
def rng():
    return np.random.default_rng(0)


def with_gaps(*lengths: int) -> Poses3D:
    """Return poses with gaps of those lengths in all joints."""
    observed = np.ones(len(TRUTH.xyz), bool)
    for start, length in zip(range(10, 400, 80), lengths, strict=False):
        observed[start : start + length] = False
    return Poses3D(SHELF14, np.where(observed[:, None, None, None], TRUTH.xyz, np.nan))


@dataclass
class GaussianCompleter:
    """Completes with Gaussian errors of `DEVIATIONS`, twice that for noisy poses, and predicts one scale for all."""

    stated: float
    rng: np.random.Generator
    factors: Factors = ((1.0,) * CLASSES,) * 2
    noisy: float = 1.0

    def uncertainty_inputs(self, poses: Poses3D, _: float) -> tuple[np.ndarray, np.ndarray]:
        lengths = np.where(poses.measured.any(0), gap_lengths(poses.measured), np.inf)
        return lengths, np.full((*lengths.shape[:2], 1), self.noisy)

    def __call__(self, poses: Poses3D, fps: float) -> Poses3D:
        absent, (lengths, noisy) = poses.source == Source.ABSENT, self.uncertainty_inputs(poses, fps)
        deviations = DEVIATIONS[np.searchsorted([5, 15, 40, 1000], lengths)] * (1 + noisy)
        errors = self.rng.normal(size=poses.xyz.shape) * deviations[..., None]
        stated = calibrated(np.full(lengths.shape, self.stated), lengths, noisy, self.factors)
        return replace(
            poses,
            xyz=np.where(absent[..., None], errors, poses.xyz),
            source=np.where(absent, Source.COMPLETED, poses.source),
            cov=np.where(absent[..., None, None], stated[..., None, None] ** 2 * np.eye(3), np.nan),
        )


def test_the_radius_is_that_of_a_gaussian_in_three_dimensions():
    assert abs(REGION_RADIUS**2 - chi2(3).ppf(REGION_PROBABILITY)) < 1e-3


@pytest.mark.parametrize("noisy", [0.0, 1.0])
@pytest.mark.parametrize("stated", [0.001, 0.03, 2.0])
def test_regions_of_90_percent_hold_90_percent_in_every_class(stated, noisy, rng):
    measured = with_gaps(5, 15, 40, 60, 5)
    measured = measured.without(np.arange(14) == 3)
    completer = GaussianCompleter(stated, rng, noisy=noisy)
    factors = fit_factors(completer, [(measured, TRUTH)] * 5, 25.0)
    np.testing.assert_allclose(np.array(factors[int(noisy)]) * stated, DEVIATIONS * (1 + noisy), rtol=0.1)
    done = replace(completer, factors=factors)(measured, 25.0)
    distance = np.linalg.norm(done.xyz, axis=-1) / np.sqrt(done.cov[..., 0, 0])
    lengths, _ = completer.uncertainty_inputs(measured, 25.0)
    for low, high in (*GAPS[:-1], (41, 1000), (np.inf, np.inf)):
        inside = (lengths >= low) & (lengths <= high)
        assert 0.85 < (distance[inside] <= REGION_RADIUS).mean() < 0.95


def test_factors_are_interpolated_between_exact_and_noisy_poses():
    lengths, factors = np.array([3.0, np.inf]), ((1.0,) * 4 + (2.0,), (4.0,) * 4 + (8.0,))
    for noisy, expected in ((0, [0.1, 0.2]), (0.5, [0.2, 0.4]), (1, [0.4, 0.8])):
        np.testing.assert_allclose(calibrated(np.full(2, 0.1), lengths, np.full(2, noisy), factors), expected)


def test_without_exact_poses_the_factors_of_noisy_ones_are_used(rng):
    true, noisy = fit_factors(GaussianCompleter(0.01, rng), [(with_gaps(5, 15, 40, 60, 5), TRUTH)] * 5, 25.0)
    assert true == noisy


def test_gap_classes_without_samples_take_the_factor_of_all(rng):
    _, factors = fit_factors(GaussianCompleter(0.01, rng), [(with_gaps(15, 15), TRUTH)], 25.0)
    assert len(set(factors)) == 1


def test_too_few_samples_give_no_factors(rng):
    assert fit_factors(GaussianCompleter(0.01, rng), [(with_gaps(1), TRUTH)], 25.0) is None
    assert fit_factors(GaussianCompleter(0.01, rng), [], 25.0) is None


def test_joints_without_truth_do_not_count(rng):
    truth = Poses3D(SHELF14, np.full(TRUTH.xyz.shape, np.nan))
    assert fit_factors(GaussianCompleter(0.01, rng), [(with_gaps(40), truth)], 25.0) is None
