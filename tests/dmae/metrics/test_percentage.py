"""Percentages of known values."""

import numpy as np
import pytest

from dmae.data.clip import Source
from dmae.metrics.percentage import source_shares
from dmae.numerics.statistics import mean_known


def test_shares_add_up():
    source = np.array([[[Source.MEASURED, Source.COMPLETED, Source.ABSENT, Source.MEASURED]]])
    known = np.array([[[True, True, True, False]]])
    found = source_shares(source, known)
    assert found == pytest.approx({"absent": 100 / 3, "measured": 100 / 3, "denoised": 0, "completed": 100 / 3})


def test_mean_of_nothing_is_nan_without_a_warning():
    assert np.isnan(mean_known(np.array([])))
    np.testing.assert_array_equal(mean_known(np.array([[1, np.nan], [3, np.nan]])), [2, np.nan])
