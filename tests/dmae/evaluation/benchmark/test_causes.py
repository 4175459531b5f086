"""Causes of gaps, on labels written by hand."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dmae.data.labels import OcclusionLabels
from dmae.data.labels import Visibility as V
from dmae.evaluation.benchmark.causes import Cause, causes


def cause_of(*views: list[V]) -> list[int]:
    """The causes of one joint that is hidden throughout: a list of labels, one a frame, for each view."""
    visibility = np.array(views).T[:, :, None, None]
    return causes(OcclusionLabels(visibility), np.ones((len(visibility), 1, 1), bool)).ravel().tolist()


@pytest.mark.parametrize(
    ("labels", "cause"),
    [
        ((V.HIDDEN_BY_SELF, V.HIDDEN_BY_SELF, V.VISIBLE), Cause.self),
        ((V.HIDDEN_BY_PERSON, V.HIDDEN_BY_SELF, V.VISIBLE), Cause.person),
        ((V.HIDDEN_BY_OBJECT, V.HIDDEN_BY_SELF, V.VISIBLE), Cause.thing),
        ((V.HIDDEN_BY_OBJECT, V.HIDDEN_BY_OBJECT, V.HIDDEN_BY_PERSON), Cause.thing),
        ((V.OUTSIDE_IMAGE, V.BEHIND_CAMERA, V.HIDDEN_BY_PERSON), Cause.edge),
        ((V.HIDDEN_BY_PERSON, V.HIDDEN_BY_SELF, V.HIDDEN_BY_SELF), Cause.self),
        ((V.VISIBLE, V.VISIBLE, V.HIDDEN_BY_OBJECT), Cause.burst),
    ],
)
def test_the_cause_is_what_would_let_two_cameras_see_the_joint_if_it_were_gone(labels, cause):
    assert cause_of(*([label] for label in labels)) == [cause]


def test_a_gap_has_one_cause_that_of_most_frames():
    things = [V.HIDDEN_BY_OBJECT] * 3 + [V.HIDDEN_BY_PERSON] * 2
    assert cause_of(things, things, [V.VISIBLE] * 5) == [Cause.thing] * 5
    seen = [V.VISIBLE] * 3 + [V.HIDDEN_BY_PERSON] * 2
    assert cause_of(seen, seen, [V.HIDDEN_BY_SELF] * 5) == [Cause.burst] * 5


def test_two_gaps_of_a_joint_have_causes_of_their_own():
    visibility = np.full((5, 2, 1, 1), V.VISIBLE)
    visibility[:2], visibility[3:] = V.HIDDEN_BY_OBJECT, V.OUTSIDE_IMAGE
    hidden = np.array([1, 1, 0, 1, 1], bool)[:, None, None]
    found = causes(OcclusionLabels(visibility), hidden)
    assert found.ravel().tolist() == [Cause.thing, Cause.thing, -1, Cause.edge, Cause.edge]


@given(st.integers(0, 10_000), st.permutations(range(4)))
def test_the_order_of_cameras_does_not_matter_and_holes_alone_have_causes(seed, order):
    rng = np.random.default_rng(seed)
    visibility = rng.integers(0, V.ABSENT, (6, 4, 2, 3))
    hidden = rng.random((6, 2, 3)) < 0.6
    found = causes(OcclusionLabels(visibility), hidden)
    np.testing.assert_array_equal(found >= 0, hidden)
    np.testing.assert_array_equal(found, causes(OcclusionLabels(visibility[:, list(order)]), hidden))


def test_labels_of_another_clip_are_refused():
    with pytest.raises(ValueError, match=r"\(4, 2, 1, 1\).*do not fit holes of \(5, 1, 1\)"):
        causes(OcclusionLabels(np.zeros((4, 2, 1, 1))), np.ones((5, 1, 1), bool))
