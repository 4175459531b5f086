"""Causes of gaps, on labels written by hand."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dmae.completion.methods import find_method
from dmae.data.clip import Poses3D
from dmae.data.labels import OcclusionLabels, Visibility
from dmae.data.labels import Visibility as V
from dmae.data.skeleton import BODY25, SKELETONS
from dmae.evaluation.benchmark.holes import (
    ANGLE_AXES,
    AXES,
    PARTS,
    SHAPE,
    Cause,
    angle_cells,
    capture_cells,
    causes,
    completion_cells,
    holes_of_capture,
    holes_of_sight,
    part_of,
)
from dmae.metrics.angles import leg_angles
from tests.support.clips import full_clip


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


# Holes of capture and of sight, and the cells that they are counted in.

WRIST = BODY25.index("r_wrist")[0]


def seen_clip(frames: int = 60):
    """Two people whom all four cameras see, and their poses as captured."""
    clip = full_clip(frames)
    visibility = np.full_like(clip.occlusion.visibility, Visibility.VISIBLE)
    return replace(clip, occlusion=OcclusionLabels(visibility)), clip.truth


def without(poses: Poses3D, frames, person, joints) -> Poses3D:
    dropped = np.zeros(poses.source.shape, bool)
    dropped[frames, person, joints] = True
    return poses.without(dropped)


def scored(clip, given: Poses3D, poses: Poses3D) -> dict:
    linear = find_method("linear").function(given, clip.fps)
    return completion_cells(holes_of_capture(clip, given), given, linear, poses)


def test_errors_of_angles_are_told_by_the_hole_among_the_joints_that_show_them():
    clip, truth = seen_clip()
    knee, ankle = BODY25.index("r_knee", "r_ankle")
    given = without(truth, slice(10, 30), 0, knee)
    holes, true = holes_of_capture(clip, given), leg_angles(truth)[0]
    exact = _angles(angle_cells(holes, true, given, truth))
    # The hip, the knee and the ankle on this side are shown by the knee.
    np.testing.assert_array_equal(exact["angles"][:, 3, 1 + Cause.burst], [20, 20, 20])
    assert exact["angles"].sum() == true.size and exact["degrees"].sum() < 1e-3 * true.size
    turned = truth.xyz.copy()
    turned[10:30, 0, ankle, 0] += 0.05  # m
    bent = _angles(angle_cells(holes, true, given, replace(truth, xyz=turned)))
    degrees, burst = bent["degrees"][1], (3, 1 + Cause.burst)
    assert degrees[burst] > 1.5 * bent["determined"][1][burst] and degrees[0, 0] < bent["determined"][1][0, 0]
    assert degrees.sum() == degrees[burst] + degrees[0, 0]
    # Without the knee its angle is unknown; the hip and the ankle still determine theirs, within 15 degrees.
    lacking = _angles(angle_cells(holes, true, given, given))
    assert lacking["angles"].sum() == true.size
    assert lacking["determined"][(slice(None), *burst)].tolist() == [20, 0, 20]


def _angles(cells: dict) -> dict[str, np.ndarray]:
    """By angle, length class (0 for none) and cause (0 for none)."""
    return {name: np.reshape(each, [len(classes) for classes in ANGLE_AXES.values()]) for name, each in cells.items()}


def test_holes_are_what_capture_lacks_with_length_cause_and_part():
    clip, truth = seen_clip()
    given = without(truth, slice(10, 30), 0, WRIST)
    holes = holes_of_capture(clip, given)
    expected = np.zeros(holes.hidden.shape, bool)
    expected[10:30, 0, WRIST] = True
    np.testing.assert_array_equal(holes.hidden, expected)
    assert (holes.cause[expected] == Cause.burst).all() and (holes.cause[~expected] == -1).all()
    assert AXES["frames"][holes.length[15, 0, WRIST]] == "16-40"
    assert AXES["part"][holes.part[WRIST]] == "arm"


def test_a_person_of_whom_nothing_was_captured_for_a_while_is_one_hole():
    clip, truth = seen_clip()
    holes = holes_of_capture(clip, without(truth, slice(20, 25), 1, slice(None)))
    assert holes.hidden[20:25, 1].all() and holes.hidden.sum() == 5 * 25
    assert (holes.matches[:, 1] == 1).all()


def test_a_person_who_was_never_captured_has_no_holes():
    clip, truth = seen_clip()
    holes = holes_of_capture(clip, Poses3D(BODY25, truth.xyz[:, :1]))
    assert not holes.hidden.any() and (holes.matches[:, 1] == -1).all()


def test_sight_depends_on_labels_alone():
    clip, _ = seen_clip()
    visibility = clip.occlusion.visibility.copy()
    visibility[5:9, 1:, 1, WRIST] = Visibility.HIDDEN_BY_PERSON
    sight = holes_of_sight(replace(clip, occlusion=OcclusionLabels(visibility)), BODY25)
    assert sight.hidden[5:9, 1, WRIST].all() and sight.hidden.sum() == 4
    assert (sight.cause[sight.hidden] == Cause.person).all()


@pytest.mark.parametrize("skeleton", SKELETONS.values(), ids=lambda skeleton: skeleton.name)
def test_every_joint_of_every_skeleton_belongs_to_a_part(skeleton):
    assert {part_of(joint) for joint in skeleton.joints} <= set(range(len(PARTS)))


@pytest.fixture
def waving():
    """A clip of two people who wave, and their poses as captured, with one hole of 20 frames."""
    clip, truth = seen_clip()
    wave = truth.xyz.copy()
    wave[..., WRIST, 2] += 0.3 * np.sin(np.arange(60) / 4)[:, None]
    clip = replace(clip, truth=Poses3D(BODY25, wave))
    return clip, without(clip.truth, slice(10, 30), 0, WRIST)


def test_the_truth_scores_nothing_and_linear_filling_its_own_error(waving):
    clip, given = waving
    perfect = scored(clip, given, clip.truth)
    assert sum(perfect["holes"]) == sum(perfect["filled"]) == 20
    assert sum(perfect["mm"]) == 0 and perfect["seen_mm"] == 0
    linear = find_method("linear").function(given, clip.fps)
    error = 1000 * np.linalg.norm(linear.xyz - clip.truth.xyz, axis=-1)[10:30, 0, WRIST].sum()
    assert error > 500
    assert sum(scored(clip, given, linear)["mm"]) == pytest.approx(error, abs=0.1)


def test_an_open_hole_has_the_error_of_linear_filling(waving):
    clip, given = waving
    half = without(clip.truth, slice(20, 30), 0, WRIST)
    linear = find_method("linear").function(given, clip.fps)
    error = 1000 * np.linalg.norm(linear.xyz - clip.truth.xyz, axis=-1)[20:30, 0, WRIST].sum()
    found = scored(clip, given, half)
    assert sum(found["filled"]) == 10 and sum(found["holes"]) == 20
    assert sum(found["mm"]) == pytest.approx(error, abs=0.1)
    nothing = scored(clip, given, given)
    assert sum(nothing["filled"]) == 0 and sum(nothing["mm"]) == sum(scored(clip, given, linear)["mm"])


def test_regions_are_counted_where_they_are_stated():
    clip, truth = seen_clip()
    given = without(truth, slice(10, 30), 0, WRIST)
    off = truth.xyz.copy()
    off[10:30, 0, WRIST, 0] += 0.05
    for deviation, held in ((0.01, 0), (0.05, 20)):
        cov = np.full((*off.shape, 3), np.nan)
        cov[10:30, 0, WRIST] = deviation**2 * np.eye(3)
        found = scored(clip, given, Poses3D(BODY25, off, cov=cov))
        assert (sum(found["stated"]), sum(found["held"])) == (20, held)
        assert sum(found["mm"]) == pytest.approx(20 * 50, abs=0.1)


def test_capture_is_scored_on_what_was_seen_and_unseen():
    clip, truth = seen_clip()
    visibility = clip.occlusion.visibility.copy()
    visibility[5:9, 1:, 1, WRIST] = Visibility.HIDDEN_BY_PERSON
    sight = holes_of_sight(replace(clip, occlusion=OcclusionLabels(visibility)), BODY25)
    perfect = capture_cells(sight, truth)
    assert perfect["correct"] == perfect["limbs"] and perfect["extra"] == 0
    assert sum(perfect["near"]) == sum(perfect["filled"]) == sum(perfect["holes"]) == 4
    assert perfect["seen_near"] == perfect["seen"] == truth.source.size - 4
    lacking = capture_cells(sight, without(truth, slice(5, 9), 1, WRIST))
    assert sum(lacking["filled"]) == 0 and len(lacking["mm"]) == np.prod(SHAPE)
    ghost = Poses3D(BODY25, np.concatenate([truth.xyz, truth.xyz[:, :1] + 5], 1))
    assert capture_cells(sight, ghost)["extra"] == len(clip)


def test_a_clip_without_labels_is_refused():
    clip, truth = seen_clip()
    with pytest.raises(ValueError, match="expected truth and labels"):
        holes_of_capture(replace(clip, occlusion=None), truth)
