"""Percentages of known values."""

import numpy as np
import pytest

from dmae.data.clip import Source
from dmae.metrics.comparison import match
from dmae.metrics.position import GAPS, error_by_gap, in_region, mpjpe, pck, source_shares
from dmae.numerics.paths import gap_lengths
from dmae.numerics.statistics import mean_known
from tests.support.shelf_walkers import aside, people


def test_shares_add_up():
    source = np.array([[[Source.MEASURED, Source.COMPLETED, Source.ABSENT, Source.MEASURED]]])
    known = np.array([[[True, True, True, False]]])
    found = source_shares(source, known)
    assert found == pytest.approx({"absent": 100 / 3, "measured": 100 / 3, "denoised": 0, "completed": 100 / 3})


def test_mean_of_nothing_is_nan_without_a_warning():
    assert np.isnan(mean_known(np.array([])))
    np.testing.assert_array_equal(mean_known(np.array([[1, np.nan], [3, np.nan]])), [2, np.nan])


# PCK against values worked out by hand.


def test_recall_and_precision_by_hand():
    truth = people(1, 2)
    pred = truth.copy()
    pred[0, 0, 0] += (0.19, 0, 0)
    pred[0, 0, 1] += (0.21, 0, 0)
    pred[0, 1, :4] = np.nan
    scores = pck(pred, truth, match(pred, truth))
    assert scores["recall"] == pytest.approx(100 * 23 / 28)
    assert scores["precision"] == pytest.approx(100 * 23 / 24)


def test_a_ghost_costs_precision_only():
    truth = people(2, 1)
    ghost = aside(truth, 3)
    pred = np.concatenate([truth, ghost], 1)
    assert pck(pred, truth, match(pred, truth)) == {"recall": 100, "precision": 50}


def test_frames_without_truth_count_for_nothing():
    truth = people(2, 1)
    truth[1] = np.nan
    pred = np.concatenate([people(2, 1), aside(people(2, 1), 3)], 1)
    assert pck(pred, truth, match(pred, truth)) == {"recall": 100, "precision": 50}


def test_joints_of_a_matched_person_without_truth_count_neither_way():
    truth = people(1, 1)
    pred = truth.copy()
    truth[0, 0, :7] = np.nan
    assert pck(pred, truth, match(pred, truth)) == {"recall": 100, "precision": 100}


def test_nothing_predicted_has_no_precision():
    truth = people(1, 1)
    scores = pck(truth[:, :0], truth, match(truth[:, :0], truth))
    assert scores["recall"] == 0
    assert np.isnan(scores["precision"])


# MPJPE and errors by gap against values worked out by hand.


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


# Regions that covariances state.


def test_nine_in_ten_of_a_gaussian_are_within_its_regions():
    rng = np.random.default_rng(0)
    root = rng.normal(size=(3, 3))
    error = rng.normal(size=(20000, 3)) @ root.T
    assert in_region(error, np.broadcast_to(root @ root.T, (20000, 3, 3))).mean() == pytest.approx(0.9, abs=0.01)
    assert np.isnan(in_region(np.full((1, 3), np.nan), np.eye(3)[None])).all()
    # A method of somebody else may state that it has no error.
    np.testing.assert_array_equal(in_region(np.zeros((2, 3)), np.stack([np.zeros((3, 3)), np.eye(3)])), [np.nan, 1])
