"""PCK against values worked out by hand."""

import numpy as np
import pytest

from dmae.metrics.matching import match
from dmae.metrics.pck import pck
from tests.support.shelf_walkers import aside, people


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
