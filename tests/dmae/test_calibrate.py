"""Stated uncertainty: brought to the errors there are, class by class, on whatever scale it was stated."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.stats import chi2

from dmae.calibrate import CLASSES, RADIUS, SHARE, Factors, fit_factors, inflated
from dmae.clip import Poses3D, Source
from dmae.metrics import GAPS, gap_lengths
from dmae.skeleton import SHELF14

TRUTH = Poses3D(SHELF14, np.zeros((400, 4, 14, 3)))
DEVIATIONS = np.array([0.01, 0.02, 0.04, 0.08, 0.16])
"""m, by class of gap, the last where nothing was measured."""


@pytest.fixture
def rng():
    return np.random.default_rng(0)


def with_gaps(*lengths: int) -> Poses3D:
    """Everyone measured but for gaps of those lengths."""
    observed = np.ones(len(TRUTH.xyz), bool)
    for start, length in zip(range(10, 400, 80), lengths, strict=False):
        observed[start : start + length] = False
    return Poses3D(SHELF14, np.where(observed[:, None, None, None], TRUTH.xyz, np.nan))


@dataclass
class Guesser:
    """Completes with Gaussian errors of `DEVIATIONS`, twice that of captured poses, and states one scale for all."""

    stated: float
    rng: np.random.Generator
    factors: Factors = ((1.0,) * CLASSES,) * 2
    captured: float = 1.0

    def doubts(self, poses: Poses3D, _: float) -> tuple[np.ndarray, np.ndarray]:
        lengths = np.where(poses.measured.any(0), gap_lengths(poses.measured), np.inf)
        return lengths, np.full((*lengths.shape[:2], 1), self.captured)

    def __call__(self, poses: Poses3D, fps: float) -> Poses3D:
        absent, (lengths, captured) = poses.source == Source.ABSENT, self.doubts(poses, fps)
        deviations = DEVIATIONS[np.searchsorted([5, 15, 40, 1000], lengths)] * (1 + captured)
        errors = self.rng.normal(size=poses.xyz.shape) * deviations[..., None]
        stated = inflated(np.full(lengths.shape, self.stated), lengths, captured, self.factors)
        return replace(
            poses,
            xyz=np.where(absent[..., None], errors, poses.xyz),
            source=np.where(absent, Source.COMPLETED, poses.source),
            cov=np.where(absent[..., None, None], stated[..., None, None] ** 2 * np.eye(3), np.nan),
        )


def test_the_radius_is_that_of_a_gaussian_in_three_dimensions():
    assert abs(RADIUS**2 - chi2(3).ppf(SHARE)) < 1e-3


@pytest.mark.parametrize("captured", [0.0, 1.0])
@pytest.mark.parametrize("stated", [0.001, 0.03, 2.0])
def test_regions_hold_what_they_say_in_every_class(stated, captured, rng):
    measured = with_gaps(5, 15, 40, 60, 5)
    measured = measured.without(np.arange(14) == 3)
    guesser = Guesser(stated, rng, captured=captured)
    factors = fit_factors(guesser, [(measured, TRUTH)] * 5, 25.0)
    np.testing.assert_allclose(np.array(factors[int(captured)]) * stated, DEVIATIONS * (1 + captured), rtol=0.1)
    done = replace(guesser, factors=factors)(measured, 25.0)
    distance = np.linalg.norm(done.xyz, axis=-1) / np.sqrt(done.cov[..., 0, 0])
    lengths, _ = guesser.doubts(measured, 25.0)
    for low, high in (*GAPS[:-1], (41, 1000), (np.inf, np.inf)):
        inside = (lengths >= low) & (lengths <= high)
        assert 0.85 < (distance[inside] <= RADIUS).mean() < 0.95


def test_between_true_and_captured_poses_factors_lie_between():
    lengths, factors = np.array([3.0, np.inf]), ((1.0,) * 4 + (2.0,), (4.0,) * 4 + (8.0,))
    for captured, expected in ((0, [0.1, 0.2]), (0.5, [0.2, 0.4]), (1, [0.4, 0.8])):
        np.testing.assert_allclose(inflated(np.full(2, 0.1), lengths, np.full(2, captured), factors), expected)


def test_kinds_of_poses_never_seen_take_the_factors_of_the_other(rng):
    true, captured = fit_factors(Guesser(0.01, rng), [(with_gaps(5, 15, 40, 60, 5), TRUTH)] * 5, 25.0)
    assert true == captured


def test_classes_never_seen_take_the_factor_of_all(rng):
    _, factors = fit_factors(Guesser(0.01, rng), [(with_gaps(15, 15), TRUTH)], 25.0)
    assert len(set(factors)) == 1


def test_nothing_is_calibrated_by_a_handful(rng):
    assert fit_factors(Guesser(0.01, rng), [(with_gaps(1), TRUTH)], 25.0) is None
    assert fit_factors(Guesser(0.01, rng), [], 25.0) is None


def test_what_is_not_known_does_not_count(rng):
    truth = Poses3D(SHELF14, np.full(TRUTH.xyz.shape, np.nan))
    assert fit_factors(Guesser(0.01, rng), [(with_gaps(40), truth)], 25.0) is None
