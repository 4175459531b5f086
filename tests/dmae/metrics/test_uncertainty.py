"""Regions that covariances state."""

import numpy as np
import pytest

from dmae.metrics.uncertainty import in_region


def test_nine_in_ten_of_a_gaussian_are_within_its_regions():
    rng = np.random.default_rng(0)
    root = rng.normal(size=(3, 3))
    error = rng.normal(size=(20000, 3)) @ root.T
    assert in_region(error, np.broadcast_to(root @ root.T, (20000, 3, 3))).mean() == pytest.approx(0.9, abs=0.01)
    assert np.isnan(in_region(np.full((1, 3), np.nan), np.eye(3)[None])).all()
