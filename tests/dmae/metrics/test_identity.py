"""How well persons keep their identity, by hand and against motmetrics."""

import numpy as np
import pytest

from dmae.metrics.comparison import GATE, distances, match
from dmae.metrics.identity import identity_switches, idf1
from dmae.numerics.statistics import mean_known
from tests.support.shelf_walkers import aside, people


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


def test_zero_people_have_no_identity_scores():
    nobody = np.full((3, 1, 14, 3), np.nan)
    assert np.isnan(idf1(nobody, nobody))
    assert idf1(nobody[:, :0], people(3)) == 0


def test_switches_are_counted_over_absences():
    assert identity_switches(np.array([[0, 1], [-1, 1], [0, 1], [2, -1], [2, 1], [0, 3]])) == 3
    assert identity_switches(np.full((3, 2), -1)) == 0


def motmetrics_scores(pred: np.ndarray, truth: np.ndarray) -> tuple[float, int]:
    """IDF1, %, and the number of identity switches by motmetrics, from the same distances."""
    motmetrics = pytest.importorskip("motmetrics")
    accumulator = motmetrics.MOTAccumulator()
    distance = mean_known(distances(pred, truth), -1)
    here, predicted = (~np.isnan(xyz).all((-1, -2)) for xyz in (truth, pred))
    for frame, pairs in enumerate(np.where(distance <= GATE, distance, np.nan)):
        true, found = np.flatnonzero(here[frame]), np.flatnonzero(predicted[frame])
        accumulator.update(true, found, pairs[np.ix_(true, found)], frame)
    scores = motmetrics.metrics.create().compute(accumulator, metrics=["idf1", "num_switches"])
    return 100 * float(scores["idf1"].iloc[0]), int(scores["num_switches"].iloc[0])


@pytest.mark.parametrize("seed", range(6))
def test_motmetrics_agrees(seed):
    """Tracks that are cut, swapped, missed and joined by false positives."""
    rng = np.random.default_rng(seed)
    truth = people(40, 4)
    pred = np.concatenate([truth, aside(people(40, 1), 3)], 1) + rng.normal(0, 0.05, (40, 5, 1, 3))
    for _ in range(4):
        start, (a, b) = rng.integers(40), rng.choice(4, 2, replace=False)
        pred[start:, [a, b]] = pred[start:, [b, a]]
    pred[rng.random((40, 5)) < 0.15] = np.nan
    pred[rng.random((40, 5)) < 0.1] += (2.0, 2.0, 0)
    expected_idf1, expected_switches = motmetrics_scores(pred, truth)
    assert expected_switches > 0
    assert idf1(pred, truth) == pytest.approx(expected_idf1)
    assert identity_switches(match(pred, truth)) == expected_switches
