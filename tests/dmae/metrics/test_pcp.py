"""Strict PCP against values worked out by hand."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dmae.data.skeleton import BODY25, SHELF14
from dmae.metrics.comparison import match, take_matched
from dmae.metrics.identity import identity_switches
from dmae.metrics.pcp import better_limbs, correct_limbs, count_limbs, limb_ends, limb_names, published_pcp
from dmae.metrics.position import mpjpe, pck, percent
from dmae.metrics.registry import protocol
from tests.support.clips import t_pose
from tests.support.shelf_walkers import aside, people


def pcp(pred, truth) -> np.ndarray:
    """(T, L) strict PCP in percent."""
    correct, known = correct_limbs(take_matched(pred, match(pred, truth)), truth, SHELF14)
    return percent(correct, known, 0)


def test_shelf_counts_nine_bones_and_the_torso():
    assert len(limb_names(SHELF14)) == 10
    ends = dict(zip(limb_names(SHELF14), limb_ends(t_pose(SHELF14), SHELF14), strict=True))
    np.testing.assert_allclose(ends["mid_hip-bottom_head"], [(0, 0, 0.95), (0, 0, 1.545)])
    np.testing.assert_allclose(ends["l_shoulder-l_elbow"], [(0, 0.18, 1.45), (0, 0.46, 1.45)])


def test_other_skeletons_count_their_bones():
    assert len(limb_names(BODY25)) == 24
    start, end = limb_ends(t_pose(BODY25), BODY25)[limb_names(BODY25).index("l_knee-l_ankle")]
    np.testing.assert_allclose([start, end], [(0.02, 0.1, 0.5), (0, 0.1, 0.08)])


def test_exactly_half_the_length_is_correct_and_a_millimetre_more_is_not():
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


def test_both_ends_are_averaged():
    truth = people(1, 1)
    hip, knee = SHELF14.index("r_hip", "r_knee")
    length = np.linalg.norm(truth[0, 0, hip] - truth[0, 0, knee])
    pred = truth.copy()
    pred[0, 0, [hip, knee], 1] += np.array([0.2, 0.7]) * length
    assert pcp(pred, truth)[0, limb_names(SHELF14).index("r_hip-r_knee")] == 100
    pred[0, 0, hip, 1] += 0.15 * length
    assert pcp(pred, truth)[0, limb_names(SHELF14).index("r_hip-r_knee")] == 0


def test_a_missed_person_scores_nothing_on_every_limb():
    truth = people(4, 2)
    pred = truth.copy()
    pred[1, 1] = np.nan
    assert (pcp(pred, truth)[0] == 100).all()
    assert (pcp(pred, truth)[1] == 75).all()
    assert (pcp(pred[:, :0], truth) == 0).all()


def test_a_missed_joint_fails_its_limbs():
    truth = people(1, 1)
    pred = truth.copy()
    pred[0, 0, SHELF14.index("l_elbow")] = np.nan
    failed = {name for name, score in zip(limb_names(SHELF14), pcp(pred, truth)[0], strict=True) if score == 0}
    assert failed == {"l_elbow-l_wrist", "l_shoulder-l_elbow"}


def test_what_is_not_annotated_counts_for_nothing():
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


def test_a_person_never_annotated_has_no_score():
    truth = people(2, 2)
    truth[:, 1] = np.nan
    assert np.isnan(pcp(people(2, 2), truth)[1]).all()


@given(st.permutations(range(4)), st.integers(0, 2**32 - 1))
def test_order_of_predictions_does_not_matter(order, seed):
    rng = np.random.default_rng(seed)
    truth = people(3, 3)
    pred = np.concatenate([truth + rng.normal(0, 0.1, truth.shape), rng.normal(size=(3, 1, 14, 3))], 1)
    pred[rng.random(pred.shape[:3]) < 0.2] = np.nan
    shuffled = pred[:, list(order)]
    np.testing.assert_array_equal(pcp(shuffled, truth), pcp(pred, truth))
    assert pck(shuffled, truth, match(shuffled, truth)) == pck(pred, truth, match(pred, truth))
    assert identity_switches(match(shuffled, truth)) == identity_switches(match(pred, truth))


@given(st.integers(0, 2**32 - 1))
def test_perfect_is_a_hundred(seed):
    rng = np.random.default_rng(seed)
    truth = people(4, 3)
    truth[rng.random(truth.shape[:3]) < 0.3] = np.nan
    scores = pcp(truth, truth)
    assert (scores[~np.isnan(scores)] == 100).all()
    assert pck(truth, truth, match(truth, truth)) == {"recall": 100, "precision": 100}
    assert mpjpe(take_matched(truth, match(truth, truth)), truth) == 0
    assert identity_switches(match(truth, truth)) == 0


# PCP by protocol: cases computed by hand that tell the protocols apart.

KNEE = SHELF14.index("l_knee")[0]


def pcp_by(name: str, pred: np.ndarray, truth: np.ndarray) -> list[float]:
    """PCP of each person, %; None for a person without a limb that counts."""
    correct, counted = count_limbs(protocol[name], pred, truth, SHELF14)
    return [
        100 * float((right & known).sum() / known.sum()) if known.any() else None
        for right, known in zip(correct.swapaxes(0, 1), counted.swapaxes(0, 1), strict=True)
    ]


def missed_once() -> tuple[np.ndarray, np.ndarray]:
    """Two persons in four frames; the second is missed in the first frame."""
    truth = people(4, 2)
    pred = truth.copy()
    pred[0, 1] = np.nan
    return pred, truth


def empty_once() -> tuple[np.ndarray, np.ndarray]:
    """A person in four frames, of which the first has no prediction."""
    truth = people(4, 1)
    pred = truth.copy()
    pred[0] = np.nan
    return pred, truth


def shared() -> tuple[np.ndarray, np.ndarray]:
    """Two persons 4 cm apart, and one prediction, which is the first of them."""
    truth = people(1, 2)
    truth[0, 1] = aside(truth[0, 0], 0.04)
    return truth[:, :1].copy(), truth


def far() -> tuple[np.ndarray, np.ndarray]:
    """A prediction 0.6 m off, so that only limbs longer than 1.2 m would be correct."""
    truth = people(1, 1)
    return aside(truth, 0.6), truth


def lacking() -> tuple[np.ndarray, np.ndarray]:
    """A prediction without an ankle, one of ten limbs, and a whole stranger, who is not annotated, 2 m away."""
    truth = people(1, 1)
    pred = np.concatenate([truth, aside(truth, 2)], 1)
    pred[:, 0, SHELF14.index("l_ankle")] = np.nan
    return pred, truth


def at_half() -> tuple[np.ndarray, np.ndarray]:
    """The left knee off by 0.5 m: exactly half of a thigh of 0.5 m, and less than half of a shank of 0.75 m."""
    truth = people(1, 1).round(3)
    truth[0, 0, KNEE] = truth[0, 0, SHELF14.index("l_hip")[0]] - (0, 0, 0.5)
    truth[0, 0, SHELF14.index("l_ankle")[0]] = truth[0, 0, KNEE] - (0, 0, 0.75)
    pred = truth.copy()
    pred[0, 0, KNEE, 0] += 0.5
    return pred, truth


@pytest.mark.parametrize(
    ("case", "expected"),
    [
        (missed_once, {"strict": [100, 75], "mvpose": [100, 75], "voxelpose": [100, 75], "4da": [100, 100],
                       "hkbu": [100, 75]}),
        (empty_once, {"strict": [75], "mvpose": [75], "voxelpose": [100], "4da": [100], "hkbu": [75]}),
        (shared, {"strict": [100, 0], "mvpose": [100, 100], "voxelpose": [100, 100], "4da": [100, None],
                  "hkbu": [100, 0]}),
        (lacking, {"strict": [90], "mvpose": [90], "voxelpose": [90], "4da": [90], "hkbu": [90]}),
        (far, {"strict": [0], "mvpose": [0], "voxelpose": [0], "4da": [0], "hkbu": [0]}),
        (at_half, {"strict": [100], "mvpose": [100], "voxelpose": [100], "4da": [90], "hkbu": [90]}),
    ],
    ids=lambda value: getattr(value, "__name__", ""),
)  # fmt: skip
def test_protocols_differ_as_described(case, expected):
    assert set(expected) == set(protocol)
    assert {name: pcp_by(name, *case()) for name in protocol} == expected


def test_averages_are_of_the_published_protocols():
    scores = published_pcp(*missed_once(), SHELF14, [0, 1])
    assert scores == {"mvpose": 87.5, "voxelpose": 87.5, "4da": 100, "hkbu": 87.5}


def test_the_better_of_two_is_chosen_for_each_person_and_frame():
    """Each of the two predictions has one leg right in one frame: the better of two has it in both frames."""
    truth = people(2, 1)
    first, second = truth.copy(), truth.copy()
    first[0, 0, KNEE] += 1
    second[1, 0, KNEE] += 1
    scores = []
    for correct, counted in (
        count_limbs(protocol["hkbu"], first, truth, SHELF14),
        count_limbs(protocol["hkbu"], second, truth, SHELF14),
        better_limbs(protocol["hkbu"], first, second, truth, SHELF14),
    ):
        scores.append(100 * correct[counted].mean())
    assert scores == [90, 90, 100]
