"""MPJPE and errors by gap against values worked out by hand."""

import numpy as np
import pytest

from dmae.metrics.position_error import GAPS, error_by_gap, mpjpe
from dmae.numerics.paths import gap_lengths
from tests.support.shelf_walkers import people


def test_mpjpe_is_in_millimetres_over_what_both_have():
    truth = people(1, 1)
    pred = truth.copy()
    pred[0, 0, 0] += (0.03, 0.04, 0)
    pred[0, 0, 1] = np.nan
    assert mpjpe(pred, truth) == pytest.approx(50 / 13)
    counted = np.zeros((1, 1, 14), bool)
    assert np.isnan(mpjpe(pred, truth, counted))
    counted[0, 0, 0] = True
    assert mpjpe(pred, truth, counted) == pytest.approx(50)


def test_lengths_of_hidden_stretches():
    observed = np.array([0, 0, 1, 0, 1, 1, 0, 0, 0], bool)
    assert gap_lengths(observed).tolist() == [2, 2, 0, 1, 0, 0, 3, 3, 3]
    two = np.stack([observed, ~observed], -1)
    assert gap_lengths(two)[:, 1].tolist() == [0, 0, 1, 0, 2, 2, 0, 0, 0]


def test_every_length_belongs_to_one_bin():
    for length in range(1, 200):
        assert sum(low <= length <= (high or np.inf) for low, high in GAPS) == 1


def test_error_by_gap_by_hand():
    truth = people(30, 1)
    observed = np.ones((30, 1, 14), bool)
    observed[3:5, 0, 0] = False
    observed[10:20, 0, 0] = False
    filled = truth.copy()
    filled[3:5, 0, 0] += (0.01, 0, 0)
    filled[10:15, 0, 0] += (0.02, 0, 0)
    filled[15:20, 0, 0] = np.nan
    cov = np.full((*filled.shape, 3), np.nan)
    cov[10:14, 0, 0] = np.eye(3) * 0.0079**2
    cov[14, 0, 0] = np.eye(3) * 0.0081**2
    short, middle, long, longest = error_by_gap(filled, truth, gap_lengths(observed), cov)
    assert (short["hidden"], short["filled"], short["mpjpe"]) == (2, 2, pytest.approx(10))
    assert (middle["hidden"], middle["filled"], middle["mpjpe"]) == (10, 5, pytest.approx(20))
    assert long["hidden"] == longest["hidden"] == 0
    assert np.isnan(long["mpjpe"])
    # Of 20 mm, 2.5 times 8 mm, one of the five is sure enough.
    assert (middle["stated"], middle["held"]) == (5, pytest.approx(20))
    assert short["stated"] == 0 and np.isnan(short["held"])
    assert [gap["frames"] for gap in (short, middle, long, longest)] == ["1-5", "6-15", "16-40", ">40"]
