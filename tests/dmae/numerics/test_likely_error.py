"""Likely errors, and poses without the joints that have a large one."""

import numpy as np
import pytest

from dmae.data.clip import Poses3D, Source
from dmae.data.skeleton import BODY25
from dmae.numerics.statistics import likely_error, without_unlikely
from tests.support.clips import walkers


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
