"""Assignment of predictions to true persons."""

import numpy as np

from dmae.data.skeleton import SHELF14
from dmae.metrics.comparison import match, match_claimed, match_nearest
from tests.support.clips import t_pose
from tests.support.shelf_walkers import aside, people


def test_swapped_persons_are_found():
    truth = people()
    assert match(truth[:, ::-1], truth).tolist() == [[1, 0]] * 6


def test_gate_is_on_the_mean_distance():
    truth = people(1, 1)
    assert match(aside(truth, 0.499), truth).tolist() == [[0]]
    assert match(aside(truth, 0.501), truth).tolist() == [[-1]]
    assert match(aside(truth, 0.501), truth, gate=0.6).tolist() == [[0]]


def test_one_prediction_serves_one_person():
    truth = people(1, 2)
    truth[0, 1] = aside(truth[0, 0], 0.2)
    pred = aside(truth[:, :1], 0.05)
    assert match(pred, truth).tolist() == [[0, -1]]
    assert match_nearest(pred, truth).tolist() == [[0, 0]]


def test_the_nearest_may_be_far_unless_gated():
    truth = people(1, 1)
    assert match_nearest(aside(truth, 7), truth).tolist() == [[0]]
    assert match_claimed(aside(truth, 7), truth).tolist() == [[-1]]
    assert match_claimed(aside(truth, 0.499), truth).tolist() == [[0]]
    assert match_claimed(aside(truth, 0.501), truth).tolist() == [[-1]]


def test_a_prediction_claims_one_person_and_the_first_claim_counts():
    """Both predictions are nearest to the first person; the second person, also near, goes without."""
    truth = people(1, 2)
    truth[0, 1] = aside(truth[0, 0], 0.3)
    pred = np.stack([aside(truth[0, 0], 0.12), aside(truth[0, 0], 0.05)])[None]
    assert match_claimed(pred, truth).tolist() == [[0, -1]]
    assert match_claimed(pred[:, ::-1], truth).tolist() == [[0, -1]]
    assert match_nearest(pred, truth).tolist() == [[1, 0]]


def test_the_assignment_is_the_best_for_all():
    """Greedy would give 0 its nearest, 1, and leave 1 with nothing in the gate."""
    truth = np.tile(t_pose(SHELF14), (1, 2, 1, 1))
    truth[0, 1, :, 0] += 0.5
    pred = truth[:, [0, 0]].copy()
    pred[0, :, :, 0] = truth[0, 0, :, 0] + np.array([-0.3, 0.2])[:, None]
    assert match(pred, truth).tolist() == [[0, 1]]


def test_a_stray_hand_does_not_take_a_body_s_place():
    truth = people(1, 1)
    hand = np.full_like(truth, np.nan)
    hand[0, 0, SHELF14.index("l_wrist")] = truth[0, 0, SHELF14.index("l_wrist")]
    assert match(np.concatenate([hand, aside(truth, 0.05)], 1), truth).tolist() == [[1]]


def test_nobody_matches_nobody():
    truth = people(2, 2)
    assert (match(truth[:, :0], truth) == -1).all()
    assert match(truth, truth[:, :0]).shape == (2, 0)
    assert (match(np.full_like(truth, np.nan), truth) == -1).all()
    for lenient in (match_nearest, match_claimed):
        assert (lenient(truth[:, :0], truth) == -1).all()
        assert (lenient(np.full_like(truth, np.nan), truth) == -1).all()
        assert lenient(truth, truth[:, :0]).shape == (2, 0)
