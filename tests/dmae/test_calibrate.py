"""Stated uncertainty: brought to the errors there are, class by class, on whatever scale it was stated."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from dmae.calibrate import RADIUS, SHARE, fit_factors, inflated
from dmae.clip import Poses3D, Source
from dmae.metrics import GAPS, gap_lengths
from dmae.skeleton import SHELF14

TRUTH = Poses3D(SHELF14, np.zeros((400, 4, 14, 3)))
DEVIATIONS = np.array([0.01, 0.02, 0.04, 0.08])
"""m, by class of gap."""


@pytest.fixture
def rng():
    return np.random.default_rng(0)


def with_gaps(*lengths: int) -> Poses3D:
    """Everyone measured but for gaps of those lengths."""
    observed = np.ones(len(TRUTH.xyz), bool)
    for start, length in zip(range(10, 400, 80), lengths, strict=False):
        observed[start : start + length] = False
    return Poses3D(SHELF14, np.where(observed[:, None, None, None], TRUTH.xyz, np.nan))


def guesser(stated: float, factors: tuple[float, ...] = (1.0,) * len(GAPS), *, rng: np.random.Generator):
    """Completes with Gaussian errors of `DEVIATIONS`, and states one scale for all of them."""

    def complete(poses: Poses3D, _: float) -> Poses3D:
        absent, lengths = poses.source == Source.ABSENT, gap_lengths(poses.measured)
        errors = rng.normal(size=poses.xyz.shape) * DEVIATIONS[np.searchsorted([5, 15, 40], lengths)][..., None]
        deviation = inflated(np.full(lengths.shape, stated), lengths, factors)
        return replace(
            poses,
            xyz=np.where(absent[..., None], errors, poses.xyz),
            source=np.where(absent, Source.COMPLETED, poses.source),
            cov=np.where(absent[..., None, None], deviation[..., None, None] ** 2 * np.eye(3), np.nan),
        )

    return complete


def test_the_radius_is_that_of_a_gaussian_in_three_dimensions():
    assert abs(RADIUS**2 - chi2(3).ppf(SHARE)) < 1e-3


@pytest.mark.parametrize("stated", [0.001, 0.03, 2.0])
def test_regions_hold_what_they_say_in_every_class(stated, rng):
    measured = with_gaps(5, 15, 40, 60, 5)
    factors = fit_factors(guesser(stated, rng=rng), [(measured, TRUTH)] * 5, 25.0)
    np.testing.assert_allclose(np.array(factors) * stated, DEVIATIONS, rtol=0.1)
    done = guesser(stated, factors, rng=rng)(measured, 25.0)
    distance = np.linalg.norm(done.xyz, axis=-1) / np.sqrt(done.cov[..., 0, 0])
    lengths = gap_lengths(measured.measured)
    for low, high in GAPS:
        inside = (lengths >= low) & (lengths <= (high or np.inf))
        assert 0.85 < (distance[inside] <= RADIUS).mean() < 0.95


def test_classes_never_seen_take_the_factor_of_all(rng):
    factors = fit_factors(guesser(0.01, rng=rng), [(with_gaps(15, 15), TRUTH)], 25.0)
    assert factors[0] == factors[1] == factors[2] == factors[3]


def test_nothing_is_calibrated_by_a_handful(rng):
    assert fit_factors(guesser(0.01, rng=rng), [(with_gaps(1), TRUTH)], 25.0) is None
    assert fit_factors(guesser(0.01, rng=rng), [], 25.0) is None


def test_what_is_not_known_does_not_count(rng):
    truth = Poses3D(SHELF14, np.full(TRUTH.xyz.shape, np.nan))
    assert fit_factors(guesser(0.01, rng=rng), [(with_gaps(40), truth)], 25.0) is None
