"""tests.dmae.numerics.test_paths."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import PchipInterpolator

from dmae.numerics.paths import hold, linear, local_parabola, pchip


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(0.05, 0.97), st.booleans())
def test_pchip_agrees_with_scipy(seed, hidden, steps):
    """With straight, turning and level sections; with two samples, one, and none."""
    rng = np.random.default_rng(seed)
    values = np.cumsum(rng.normal(size=(40, 3, 2)), 0)
    if steps:
        values = np.round(values)
    values[rng.random((40, 3)) < hidden] = np.nan
    found = pchip(values)
    for column in range(3):
        known = np.flatnonzero(~np.isnan(values[:, column, 0]))
        if not len(known):
            assert np.isnan(found[:, column]).all()
            continue
        inside = np.arange(known[0], known[-1] + 1)
        expected = values[known, column]
        if len(known) > 1:
            expected = PchipInterpolator(known, expected)(inside)
        np.testing.assert_allclose(found[inside, column], expected, atol=1e-12)
        np.testing.assert_array_equal(
            found[: known[0], column], np.broadcast_to(values[known[0], column], (known[0], 2))
        )
        assert (found[known[-1] :, column] == values[known[-1], column]).all()


@pytest.mark.parametrize("through", [hold, linear, pchip])
@pytest.mark.parametrize("shape", [(0, 2, 3), (5, 0, 3), (1, 2, 3), (6, 2, 4, 3), (6, 1)])
def test_arrays_of_any_shape_are_filled_and_known_values_stay(through, shape):
    values = np.random.default_rng(0).normal(size=shape)
    values[1:3] = np.nan
    found = through(values)
    assert found.shape == shape
    assert not np.isnan(found).any()
    np.testing.assert_array_equal(np.delete(found, (1, 2), 0), np.delete(values, (1, 2), 0)) if len(
        values
    ) > 2 else None


def test_some_frames_are_smoothed_as_in_the_whole_recording():
    rng = np.random.default_rng(0)
    values = np.where(rng.random((60, 4, 1)) < 0.2, np.nan, rng.normal(size=(60, 4, 3)))
    whole = local_parabola(values, 2.5)
    np.testing.assert_array_equal(local_parabola(values, 2.5, slice(20, 33)), whole[20:33])
    assert np.nanmax(np.abs(whole - values)) > 0.1
