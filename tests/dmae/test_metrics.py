"""Scores against values worked out by hand."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dmae.clip import Source
from dmae.metrics import (
    GAPS,
    correct_limbs,
    error_by_gap,
    gap_lengths,
    identity_switches,
    in_region,
    limb_ends,
    limb_names,
    match,
    match_nearest,
    mean_known,
    mpjpe,
    pck,
    percent,
    published_pcp,
    shares,
    take_matched,
)
from dmae.skeleton import BODY25, SHELF14

from .examples import t_pose, walkers


def people(frames=6, persons=2) -> np.ndarray:
    return walkers(frames, persons, SHELF14).xyz.astype(float)


def aside(xyz: np.ndarray, metres: float) -> np.ndarray:
    return xyz + np.array([metres, 0, 0])


def pcp(pred, truth) -> np.ndarray:
    """(T, L) strict PCP in percent."""
    correct, known = correct_limbs(take_matched(pred, match(pred, truth)), truth, SHELF14)
    return percent(correct, known, 0)


class TestLimbs:
    def test_shelf_counts_nine_bones_and_the_torso(self):
        assert len(limb_names(SHELF14)) == 10
        ends = dict(zip(limb_names(SHELF14), limb_ends(t_pose(SHELF14), SHELF14), strict=True))
        np.testing.assert_allclose(ends["mid_hip-bottom_head"], [(0, 0, 0.95), (0, 0, 1.545)])
        np.testing.assert_allclose(ends["l_shoulder-l_elbow"], [(0, 0.18, 1.45), (0, 0.46, 1.45)])

    def test_other_skeletons_count_their_bones(self):
        assert len(limb_names(BODY25)) == 24
        start, end = limb_ends(t_pose(BODY25), BODY25)[limb_names(BODY25).index("l_knee-l_ankle")]
        np.testing.assert_allclose([start, end], [(0.02, 0.1, 0.5), (0, 0.1, 0.08)])


class TestPcp:
    def test_exactly_half_the_length_is_correct_and_a_millimetre_more_is_not(self):
        truth = people(1, 1)
        wrist, elbow = SHELF14.index("l_wrist", "l_elbow")
        length = np.linalg.norm(truth[0, 0, wrist] - truth[0, 0, elbow])
        limb = limb_names(SHELF14).index("l_elbow-l_wrist")
        for excess, score in ((0, 100), (1e-3, 0)):
            pred = truth.copy()
            # Only the wrist is off, so it may be off by the length: (0 + length) / 2 = 0.5 length.
            pred[0, 0, wrist, 2] += length + 2 * excess
            assert pcp(pred, truth)[0, limb] == score
            assert np.delete(pcp(pred, truth)[0], limb).tolist() == [100] * 9

    def test_both_ends_are_averaged(self):
        truth = people(1, 1)
        hip, knee = SHELF14.index("r_hip", "r_knee")
        length = np.linalg.norm(truth[0, 0, hip] - truth[0, 0, knee])
        pred = truth.copy()
        pred[0, 0, [hip, knee], 1] += np.array([0.2, 0.7]) * length
        assert pcp(pred, truth)[0, limb_names(SHELF14).index("r_hip-r_knee")] == 100
        pred[0, 0, hip, 1] += 0.15 * length
        assert pcp(pred, truth)[0, limb_names(SHELF14).index("r_hip-r_knee")] == 0

    def test_a_missed_person_scores_nothing_on_every_limb(self):
        truth = people(4, 2)
        pred = truth.copy()
        pred[1, 1] = np.nan
        assert (pcp(pred, truth)[0] == 100).all()
        assert (pcp(pred, truth)[1] == 75).all()
        assert (pcp(pred[:, :0], truth) == 0).all()

    def test_a_missed_joint_fails_its_limbs(self):
        truth = people(1, 1)
        pred = truth.copy()
        pred[0, 0, SHELF14.index("l_elbow")] = np.nan
        failed = {name for name, score in zip(limb_names(SHELF14), pcp(pred, truth)[0], strict=True) if score == 0}
        assert failed == {"l_elbow-l_wrist", "l_shoulder-l_elbow"}

    def test_what_is_not_annotated_counts_for_nothing(self):
        truth = people(4, 2)
        pred = truth.copy()
        pred[2] += 5
        truth[2] = np.nan
        truth[0, 0, SHELF14.index("top_head")] = np.nan
        pred[1, 0, SHELF14.index("top_head")] = np.nan
        scores = pcp(pred, truth)
        # Of three annotated frames the head has two, one of which is wrong.
        assert scores[0, limb_names(SHELF14).index("bottom_head-top_head")] == 50
        assert np.delete(scores, limb_names(SHELF14).index("bottom_head-top_head"), 1).tolist() == [[100] * 9] * 2

    def test_a_person_never_annotated_has_no_score(self):
        truth = people(2, 2)
        truth[:, 1] = np.nan
        assert np.isnan(pcp(people(2, 2), truth)[1]).all()

    @given(st.permutations(range(4)), st.integers(0, 2**32 - 1))
    def test_order_of_predictions_does_not_matter(self, order, seed):
        rng = np.random.default_rng(seed)
        truth = people(3, 3)
        pred = np.concatenate([truth + rng.normal(0, 0.1, truth.shape), rng.normal(size=(3, 1, 14, 3))], 1)
        pred[rng.random(pred.shape[:3]) < 0.2] = np.nan
        shuffled = pred[:, list(order)]
        np.testing.assert_array_equal(pcp(shuffled, truth), pcp(pred, truth))
        assert pck(shuffled, truth, match(shuffled, truth)) == pck(pred, truth, match(pred, truth))
        assert identity_switches(match(shuffled, truth)) == identity_switches(match(pred, truth))

    @given(st.integers(0, 2**32 - 1))
    def test_perfect_is_a_hundred(self, seed):
        rng = np.random.default_rng(seed)
        truth = people(4, 3)
        truth[rng.random(truth.shape[:3]) < 0.3] = np.nan
        scores = pcp(truth, truth)
        assert (scores[~np.isnan(scores)] == 100).all()
        assert pck(truth, truth, match(truth, truth)) == {"recall": 100, "precision": 100}
        assert mpjpe(take_matched(truth, match(truth, truth)), truth) == 0
        assert identity_switches(match(truth, truth)) == 0


class TestMatch:
    def test_swapped_persons_are_found(self):
        truth = people()
        assert match(truth[:, ::-1], truth).tolist() == [[1, 0]] * 6

    def test_gate_is_on_the_mean_distance(self):
        truth = people(1, 1)
        assert match(aside(truth, 0.499), truth).tolist() == [[0]]
        assert match(aside(truth, 0.501), truth).tolist() == [[-1]]
        assert match(aside(truth, 0.501), truth, gate=0.6).tolist() == [[0]]

    def test_one_prediction_serves_one_person(self):
        truth = people(1, 2)
        truth[0, 1] = aside(truth[0, 0], 0.2)
        pred = aside(truth[:, :1], 0.05)
        assert match(pred, truth).tolist() == [[0, -1]]
        assert match_nearest(pred, truth).tolist() == [[0, 0]]

    def test_the_nearest_may_be_far_unless_gated(self):
        truth = people(1, 1)
        assert match_nearest(aside(truth, 7), truth).tolist() == [[0]]
        assert match_nearest(aside(truth, 7), truth, gate=0.5).tolist() == [[-1]]

    def test_the_assignment_is_the_best_for_all(self):
        """Greedy would give 0 its nearest, 1, and leave 1 with nothing in the gate."""
        truth = np.tile(t_pose(SHELF14), (1, 2, 1, 1))
        truth[0, 1, :, 0] += 0.5
        pred = truth[:, [0, 0]].copy()
        pred[0, :, :, 0] = truth[0, 0, :, 0] + np.array([-0.3, 0.2])[:, None]
        assert match(pred, truth).tolist() == [[0, 1]]

    def test_a_stray_hand_does_not_take_a_body_s_place(self):
        truth = people(1, 1)
        hand = np.full_like(truth, np.nan)
        hand[0, 0, SHELF14.index("l_wrist")] = truth[0, 0, SHELF14.index("l_wrist")]
        assert match(np.concatenate([hand, aside(truth, 0.05)], 1), truth).tolist() == [[1]]

    def test_nobody_matches_nobody(self):
        truth = people(2, 2)
        assert (match(truth[:, :0], truth) == -1).all()
        assert match(truth, truth[:, :0]).shape == (2, 0)
        assert (match(np.full_like(truth, np.nan), truth) == -1).all()
        assert (match_nearest(truth[:, :0], truth) == -1).all()


class TestPck:
    def test_recall_and_precision_by_hand(self):
        truth = people(1, 2)
        pred = truth.copy()
        pred[0, 0, 0] += (0.19, 0, 0)
        pred[0, 0, 1] += (0.21, 0, 0)
        pred[0, 1, :4] = np.nan
        scores = pck(pred, truth, match(pred, truth))
        assert scores["recall"] == pytest.approx(100 * 23 / 28)
        assert scores["precision"] == pytest.approx(100 * 23 / 24)

    def test_a_ghost_costs_precision_only(self):
        truth = people(2, 1)
        ghost = aside(truth, 3)
        pred = np.concatenate([truth, ghost], 1)
        assert pck(pred, truth, match(pred, truth)) == {"recall": 100, "precision": 50}

    def test_frames_without_truth_count_for_nothing(self):
        truth = people(2, 1)
        truth[1] = np.nan
        pred = np.concatenate([people(2, 1), aside(people(2, 1), 3)], 1)
        assert pck(pred, truth, match(pred, truth)) == {"recall": 100, "precision": 50}

    def test_joints_of_a_matched_person_without_truth_count_neither_way(self):
        truth = people(1, 1)
        pred = truth.copy()
        truth[0, 0, :7] = np.nan
        assert pck(pred, truth, match(pred, truth)) == {"recall": 100, "precision": 100}

    def test_nothing_predicted_has_no_precision(self):
        truth = people(1, 1)
        scores = pck(truth[:, :0], truth, match(truth[:, :0], truth))
        assert scores["recall"] == 0
        assert np.isnan(scores["precision"])


class TestErrors:
    def test_mpjpe_is_in_millimetres_over_what_both_have(self):
        truth = people(1, 1)
        pred = truth.copy()
        pred[0, 0, 0] += (0.03, 0.04, 0)
        pred[0, 0, 1] = np.nan
        assert mpjpe(pred, truth) == pytest.approx(50 / 13)
        counted = np.zeros((1, 1, 14), bool)
        assert np.isnan(mpjpe(pred, truth, counted))
        counted[0, 0, 0] = True
        assert mpjpe(pred, truth, counted) == pytest.approx(50)

    def test_switches_are_counted_over_absences(self):
        assert identity_switches(np.array([[0, 1], [-1, 1], [0, 1], [2, -1], [2, 1], [0, 3]])) == 3
        assert identity_switches(np.full((3, 2), -1)) == 0

    def test_shares_add_up(self):
        source = np.array([[[Source.MEASURED, Source.COMPLETED, Source.ABSENT, Source.MEASURED]]])
        known = np.array([[[True, True, True, False]]])
        found = shares(source, known)
        assert found == pytest.approx({"absent": 100 / 3, "measured": 100 / 3, "denoised": 0, "completed": 100 / 3})

    def test_lengths_of_hidden_stretches(self):
        observed = np.array([0, 0, 1, 0, 1, 1, 0, 0, 0], bool)
        assert gap_lengths(observed).tolist() == [2, 2, 0, 1, 0, 0, 3, 3, 3]
        two = np.stack([observed, ~observed], -1)
        assert gap_lengths(two)[:, 1].tolist() == [0, 0, 1, 0, 2, 2, 0, 0, 0]

    def test_every_length_belongs_to_one_bin(self):
        for length in range(1, 200):
            assert sum(low <= length <= (high or np.inf) for low, high in GAPS) == 1

    def test_error_by_gap_by_hand(self):
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


def test_nine_in_ten_of_a_gaussian_are_within_its_regions():
    rng = np.random.default_rng(0)
    root = rng.normal(size=(3, 3))
    error = rng.normal(size=(20000, 3)) @ root.T
    assert in_region(error, np.broadcast_to(root @ root.T, (20000, 3, 3))).mean() == pytest.approx(0.9, abs=0.01)
    assert np.isnan(in_region(np.full((1, 3), np.nan), np.eye(3)[None])).all()


def test_published_protocols_differ_as_described():
    truth = people(4, 2)
    pred = truth.copy()
    pred[0, 1] = np.nan
    # Strict: actor 1 is missed in one frame of four. 4da does not count it, hkbu does, mvpose takes actor 0.
    scores = published_pcp(pred, truth, SHELF14, [0, 1])
    assert scores["4da"] == 100
    assert scores["hkbu"] == pytest.approx(87.5)
    assert scores["mvpose"] == pytest.approx(87.5)


def test_mean_of_nothing_is_nan_without_a_warning():
    assert np.isnan(mean_known(np.array([])))
    np.testing.assert_array_equal(mean_known(np.array([[1, np.nan], [3, np.nan]])), [2, np.nan])
