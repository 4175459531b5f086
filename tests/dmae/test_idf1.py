"""How well people keep their identity."""

import numpy as np
import pytest

from dmae.metrics import idf1

from .test_metrics import aside, people


def test_who_changes_rows_half_way_is_identified_in_half_the_frames():
    truth = people(8)
    pred = truth.copy()
    assert idf1(pred, truth) == 100
    pred[4:] = pred[4:, ::-1]
    assert idf1(pred, truth) == pytest.approx(50)


def test_the_longer_part_of_a_split_track_counts():
    truth = people(8, 1)
    pred = np.full((8, 2, 14, 3), np.nan)
    pred[:6, 0], pred[6:, 1] = truth[:6, 0], truth[6:, 0]
    assert idf1(pred, truth) == pytest.approx(100 * 2 * 6 / (8 + 8))


def test_missed_frames_and_ghosts_count_once_and_the_unannotated_not_at_all():
    truth = people(10, 1)
    truth[8:] = np.nan
    pred = np.concatenate([people(10, 1), aside(people(10, 1), 3)], 1)
    pred[:2, 0], pred[4:, 1] = np.nan, np.nan
    assert idf1(pred, truth) == pytest.approx(100 * 2 * 6 / (8 + 6 + 4))


def test_what_is_further_off_than_the_gate_is_not_together():
    truth = people(4, 1)
    assert idf1(aside(truth, 0.49), truth) == 100
    assert idf1(aside(truth, 0.51), truth) == 0


def test_the_assignment_is_the_best_of_the_whole_clip():
    """Row 0 is with person 0 for 3 frames and person 1 for 4, row 1 with person 0 for 4 and nobody for 3."""
    truth = people(7, 2)
    pred = np.full_like(truth, np.nan)
    pred[:3, 0], pred[3:, 0] = truth[:3, 0], truth[3:, 1]
    pred[:3, 1], pred[3:, 1] = aside(truth[:3, 0], 5), truth[3:, 0]
    assert idf1(pred, truth) == pytest.approx(100 * 2 * 8 / (14 + 14))


def test_nobody():
    nobody = np.full((3, 1, 14, 3), np.nan)
    assert np.isnan(idf1(nobody, nobody))
    assert idf1(nobody[:, :0], people(3)) == 0
