"""Errors of hidden joints of their own, exchanged bodies, and people who are missed for their hidden joints."""

import numpy as np
import pytest
from scipy.stats import spearmanr

from dmae.data.labels import JointError, Visibility
from dmae.data.skeleton import BODY25
from synth.detector.errors_of_joints import Misses
from synth.detector.parts import PartConfig
from tests.support.clips import looking_at_origin
from tests.support.detectors import by_person, everywhere, occlusion_of, run, three_persons

LEFT = [i for i, joint in enumerate(BODY25.joints) if joint.startswith("l_")]
RIGHT = [i for i, joint in enumerate(BODY25.joints) if joint.startswith("r_")]
SEEN = PartConfig(miss=[0, 0, 0, 0])


@pytest.fixture(scope="module")
def scene() -> tuple:
    """Three persons in three cameras, the left joints of the first two hidden, and the pixels of all."""
    truth, rig = three_persons(), looking_at_origin(3)
    columns = truth.skeleton.index(*(f"body25.{joint}" for joint in BODY25.joints))
    return truth, occlusion_of(truth, rig), rig, rig.project(truth.xyz[:, :, columns])[0]


def offsets(scene, part: PartConfig, options: dict | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Distances of detected joints from the true ones (F, V, P, 25) px, and confidences."""
    truth, seen, rig, pixels = scene
    xy, score = by_person(run(truth, seen, rig, everywhere(part, options)))
    return np.linalg.norm(xy - pixels, axis=-1), score


def test_hidden_joints_have_an_error_and_a_tail_of_their_own(scene):
    off, _ = offsets(scene, PartConfig(miss=[0, 0, 0, 0], noise=0.005, hidden_noise=0.04, hidden_tail=2.0))
    hidden, visible = off[:, :, 0][..., LEFT], off[:, :, 0][..., RIGHT]
    assert np.nanmedian(hidden) == pytest.approx(8 * np.nanmedian(visible), rel=0.25)
    tails = [np.nanquantile(each, 0.95) / np.nanmedian(each) for each in (hidden, visible)]
    assert tails[0] > 1.5 * tails[1]
    # The last person has no hidden joints.
    np.testing.assert_allclose(np.nanmedian(off[:, :, 2]), np.nanmedian(visible), rtol=0.3)


def test_hidden_noise_takes_the_place_of_the_factor(scene):
    factor, _ = offsets(scene, PartConfig(miss=[0, 0, 0, 0], noise=0.01), {"noise.hidden": 3.0})
    own, _ = offsets(scene, PartConfig(miss=[0, 0, 0, 0], noise=0.01, hidden_noise=0.03), {"noise.hidden": 9.0})
    np.testing.assert_allclose(own, factor, rtol=1e-5)


def test_hidden_joints_have_a_confidence_of_their_own(scene):
    _, score = offsets(scene, PartConfig(miss=[0, 0, 0, 0], score=[90, 10], hidden_score=[60, 40]))
    assert np.nanmean(score[:, :, 0][..., LEFT]) == pytest.approx(0.6, abs=0.02)
    assert np.nanmean(score[:, :, 0][..., RIGHT]) == pytest.approx(0.9, abs=0.02)


def test_joints_behind_others_have_errors_and_confidences_of_their_own(scene):
    hidden = {"hidden_noise": 0.01, "hidden_score": [80, 20]}
    off, score = offsets(scene, PartConfig(miss=[0] * 4, **hidden, covered_noise=0.08, covered_score=[30, 70]))
    # The first person hides its left joints itself, the last person hides those of the second.
    by_self, by_other = np.index_exp[:, :, 0, LEFT], np.index_exp[:, :, 1, LEFT]
    assert np.nanmedian(off[by_other]) == pytest.approx(8 * np.nanmedian(off[by_self]), rel=0.25)
    assert (np.nanmean(score[by_self]), np.nanmean(score[by_other])) == pytest.approx((0.8, 0.3), abs=0.02)
    same, _ = offsets(scene, PartConfig(miss=[0] * 4, **hidden, covered_noise=0.01))
    np.testing.assert_array_equal(same, offsets(scene, PartConfig(miss=[0] * 4, **hidden))[0])


@pytest.mark.parametrize(("factor", "low", "high"), [(0.0, -0.03, 0.03), (1.0, 0.6, 0.95)])
def test_confidence_follows_the_error_by_kind_of_joint(scene, factor: float, low: float, high: float):
    part = PartConfig(miss=[0] * 4, noise=0.02, score=[8, 4], score_correlation=factor)
    off, score = offsets(scene, part, {"scores.error_correlation": 0.9, "times.correlation": 0.01})
    found = ~np.isnan(score[:, :, 2])
    assert low < -spearmanr(off[:, :, 2][found], score[:, :, 2][found]).statistic < high


def test_a_hidden_trunk_loses_a_person_rather_than_hidden_legs():
    legs, trunk = np.zeros((2, 25), bool)
    legs[BODY25.index("l_knee", "r_knee", "l_ankle", "r_ankle")] = True
    trunk[BODY25.index("neck", "mid_hip", "l_shoulder", "r_shoulder")] = True
    equal, weighed = (Misses(hidden_person=1.0, steepness=1.0, trunk_weight=weight) for weight in (1.0, 3.0))
    assert equal.person_probability(legs) == equal.person_probability(trunk) == pytest.approx(4 / 25)
    # Eleven joints of head and trunk weigh 3, fourteen of arms and legs 1.
    assert weighed.person_probability(legs) == pytest.approx(4 / 47)
    assert weighed.person_probability(trunk) == pytest.approx(12 / 47)


def test_sides_of_whole_bodies_are_exchanged_for_seconds(scene):
    truth, seen, rig, _ = scene
    found = run(truth, seen, rig, everywhere(SEEN, {"inversions.body": 0.3, "inversions.seconds": 2.0}))
    inverted = found.labels.error == JointError.INVERTED
    there = found.labels.person >= 0
    sided = [i for i, partner in enumerate(BODY25.mirror) if partner != i]
    whole = inverted[..., sided].all(-1)
    assert (whole == inverted[..., sided].any(-1))[there].all()
    assert not inverted[..., BODY25.index("nose", "neck", "mid_hip")].any()
    assert whole[there].mean() == pytest.approx(0.3, abs=0.12)
    events = np.zeros((*there.shape[:2], 3), bool)
    frame, view, place = np.nonzero(there)
    events[frame, view, found.labels.person[frame, view, place]] = whole[frame, view, place]
    changes = (events[1:] != events[:-1]).mean()
    # White noise would change in 42 % of the frames.
    assert changes < 0.1


def test_people_are_missed_from_a_share_of_hidden_joints_on(scene):
    truth, seen, rig, _ = scene
    options = {"misses.hidden_person": 1.0, "misses.lost_from": 0.4, "misses.steepness": 20.0}
    found = run(truth, seen, rig, everywhere(SEEN, options))
    hidden = (seen.visibility != Visibility.VISIBLE)[..., :25].mean(-1)
    share = [(found.labels.person == person).any(-1).mean() for person in range(3)]
    # Of the first two, 11 of 25 joints are hidden; of the last, none.
    assert hidden[:, :, :2].min() >= 0.4
    assert share[:2] == [0, 0]
    assert share[2] > 0.99


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"misses.lost_from": 0.0}, "lost_from: expected more than 0 and at most 1"),
        ({"misses.steepness": -1.0}, "steepness: expected 0 or more"),
        ({"inversions.seconds": 0.0}, "seconds: expected more than 0 s"),
        ({"inversions.body": 1.5}, "body: expected a number from 0 to 1"),
    ],
)
def test_impossible_numbers_are_refused(options, message):
    with pytest.raises(ValueError, match=message):
        everywhere(SEEN, options)


@pytest.mark.parametrize(
    "wrong",
    [
        {"hidden_noise": -0.1},
        {"hidden_tail": -1.0},
        {"hidden_score": [0.0, 2.0]},
        {"covered_noise": -0.1},
        {"score_correlation": -1.0},
    ],
)
def test_impossible_parts_are_refused(wrong):
    with pytest.raises(ValueError, match="detector part"):
        PartConfig(**wrong)
