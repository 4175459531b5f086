"""Findings of the report on clips with known faults."""

from dataclasses import replace

import numpy as np
import pytest

from dmae.data.clip import Detections2D, Poses3D, Source
from dmae.data.labels import Visibility
from dmae.evaluation.report.findings import (
    BY_CAUSE,
    BY_GAP,
    BY_JOINT,
    BY_MEASURING,
    BY_SEEING,
    PROBABILITIES,
    JointGroup,
    State,
    added,
    examine,
    peaks,
)
from dmae.evaluation.report.page import people_section, share, summary
from dmae.formats.poses import REGIONS
from dmae.numerics.paths import runs
from tests.support.clips import walkers
from tests.support.reported_clips import ERROR_M, completed_clip


@pytest.fixture(scope="module")
def clip():
    return completed_clip()


@pytest.fixture(scope="module")
def found(clip):
    return examine(clip)


def test_errors_are_those_of_the_completed_joints(found):
    assert found.state == State.completed
    assert found.against_truth["measured"].mean == 0
    assert found.against_truth["completed"].joints == 20
    assert found.against_truth["completed"].mean == pytest.approx(1000 * ERROR_M, abs=1e-3)
    assert found.share(Source.COMPLETED) == 20 / (30 * 2 * 25)
    np.testing.assert_allclose(found.error[[9, 10]], (0, 1000 * ERROR_M * 2 / 50), atol=1e-3)


def test_every_breakdown_counts_every_joint_once(found, clip):
    everything = clip.truth.source.size
    assert set(found.breakdowns) == {BY_GAP, BY_JOINT, BY_SEEING, BY_CAUSE}
    for groups in found.breakdowns.values():
        assert sum(each.joints for each in groups.values()) == everything


def test_gaps_and_joints_hold_their_errors(found):
    gap = found.breakdowns[BY_GAP]
    assert {name: each.joints for name, each in gap.items()} == {"measured": 1480, "6–15 frames": 20}
    assert gap["6–15 frames"].mean == pytest.approx(100, abs=1e-3)
    elbow = found.breakdowns[BY_JOINT]["r_elbow"]
    assert (elbow.joints, elbow.completed) == (60, 10)
    assert elbow.mean == pytest.approx(100 / 6, abs=1e-3)


def test_seeing_cameras_and_causes_are_those_of_the_labels(found, clip):
    seeing = clip.occlusion.visible_views
    for number in range(5):
        group = found.breakdowns[BY_SEEING].get("none" if number == 0 else str(number))
        assert (group.joints if group else 0) == (seeing == number).sum()
    visibility = clip.occlusion.visibility
    counts = {cause: (visibility == cause).sum(1) for cause in Visibility}
    objects, others = counts[Visibility.HIDDEN_BY_OBJECT], counts[Visibility.HIDDEN_BY_PERSON]
    rest = [counts[c] for c in (Visibility.HIDDEN_BY_SELF, Visibility.OUTSIDE_IMAGE, Visibility.BEHIND_CAMERA)]
    mostly = (objects > others) & np.all([objects >= each for each in rest], axis=0)
    assert found.breakdowns[BY_CAUSE]["mostly hidden by an object"].joints == mostly.sum()


def test_without_truth_counts_remain_and_no_error_is_stated(clip):
    found = examine(replace(clip, truth=None, occlusion=None))
    assert not found.has_truth and found.error is None and not found.against_truth and not found.regions
    assert {name: each.joints for name, each in found.breakdowns[BY_MEASURING].items()} == {"none": 20, "4": 1480}
    assert all(each.mean is None for each in found.breakdowns[BY_GAP].values())
    assert "no error is stated" in " ".join(summary([found]))


def test_without_truth_stated_regions_are_said_to_be_too_small(clip):
    alone = replace(clip, truth=None, occlusion=None, detection_labels=None)
    assert REGIONS[1:] in " ".join(summary([examine(alone)]))
    unknown = replace(alone, poses=replace(alone.poses, cov=np.full_like(alone.poses.cov, np.nan)))
    assert REGIONS[1:] not in " ".join(summary([examine(unknown)]))


def test_right_uncertainty_is_found_as_stated(clip):
    rng = np.random.default_rng(0)
    truth = walkers(200)
    cov = np.diag([4e-4, 1e-4, 2.5e-3])
    xyz = truth.xyz + rng.multivariate_normal(np.zeros(3), cov, truth.xyz.shape[:3])
    poses = Poses3D(truth.skeleton, xyz, cov=np.broadcast_to(cov, (*xyz.shape, 3)))
    blank = Detections2D(truth.skeleton, np.full((200, 4, 1, 25, 2), np.nan), np.full((200, 4, 1, 25), np.nan))
    clip = replace(clip, detections=blank, truth=truth, poses=poses, occlusion=None, detection_labels=None)
    (counts,) = examine(clip).regions.values()
    assert counts[0] == 200 * 2 * 25
    np.testing.assert_allclose(counts[1:] / counts[0], PROBABILITIES, atol=0.015)


def test_a_camera_that_is_off_stands_out_in_reprojection(clip):
    xy = clip.detections.xy.copy()
    xy[:, 1] += (3, 4)
    moved = replace(clip, detections=Detections2D(clip.detections.skeleton, xy, clip.detections.score))
    found = examine(moved)
    means = {camera: each.mean for camera, each in found.residuals["camera"].items()}
    assert means["cam1"] == pytest.approx(5, abs=1e-3)
    assert max(means[camera] for camera in ("cam0", "cam2", "cam3")) < 1e-3
    assert found.residuals["all"]["all"].mean == pytest.approx(5 / 4, rel=0.05)
    assert {"P1", "P2"} == set(found.residuals["person"])
    moment = next(each for each in found.moments if each.kind == "reprojection")
    assert moment.what.endswith(", cam1") and moment.amount == "5 px"


def test_completed_joints_reproject_apart_from_measured_ones(found, clip):
    pixels, _ = clip.rig.project(clip.poses.xyz)
    true, _ = clip.rig.project(clip.truth.xyz)
    off = np.linalg.norm(pixels - true, axis=-1)[10:20, :, 1][..., clip.truth.skeleton.index("r_elbow", "r_wrist")]
    mean = found.residuals_completed["all"]["all"].mean
    assert off.min() < mean < off.max()
    assert found.residuals["all"]["all"].mean < 1e-3


def test_the_worst_moments_are_where_it_errs(found):
    error = next(each for each in found.moments if each.kind == "error")
    assert 10 <= error.frame < 20 and error.person == 1 and error.amount == "100 mm"
    assert error.what in ("r_elbow, completed", "r_wrist, completed")


def test_people_who_are_not_captured_and_their_detections_are_counted(clip):
    gone = np.zeros(clip.poses.source.shape, bool)
    gone[:6, 1] = True
    found = examine(replace(clip, poses=clip.poses.without(gone)))
    assert list(found.captured) == [30, 24]
    lost = np.isfinite(clip.detections.score[:6]).any(-1).sum() / 2
    assert found.unused - examine(clip).unused == lost > 0
    (section,) = people_section([found])
    assert section.tables[0].rows == [("P1", "30", "100.0", "0"), ("P2", "24", "80.0", "0")]
    assert f"{found.unused:,} of {found.detections:,} detections fit no captured person" in " ".join(summary([found]))
    assert not people_section([examine(clip)])
    # Frames of completed joints alone are named apart.
    source, xyz = clip.poses.source.copy(), clip.poses.xyz.copy()
    source[:4, 1], xyz[:4, 1] = Source.ABSENT, np.nan
    source[4:6, 1] = Source.COMPLETED
    completed = Poses3D(clip.poses.skeleton, xyz, source)
    (section,) = people_section([examine(replace(clip, poses=completed))])
    assert section.tables[0].rows == [("P1", "30", "100.0", "0"), ("P2", "24", "80.0", "2")]


def test_a_person_that_is_missed_is_a_moment(clip):
    gone = np.zeros(clip.poses.source.shape, bool)
    gone[5:10, 0] = True
    found = examine(replace(clip, poses=clip.poses.without(gone)))
    (moment,) = (each for each in found.moments if each.kind == "missed")
    assert (moment.frame, moment.person, moment.what, moment.amount) == (5, None, "true P1", "0.20 s")
    assert found.breakdowns[BY_GAP]["whole person missed"].joints == 5 * 25
    assert "8.3\N{NO-BREAK SPACE}% of the true joints were not found." in " ".join(summary([found]))


def test_peaks_are_apart_and_runs_have_ends():
    values = np.array([[1.0, np.nan], [5, 2], [4, 9], [3, np.nan]])
    assert peaks(values, 5, apart=1) == [(2, 1), (1, 0), (3, 0)]
    assert peaks(np.full((3, 0), np.nan), 5, apart=1) == []
    assert runs(np.array([1, 1, 0, 1], bool)) == [(0, 2), (3, 4)]
    assert runs(np.array([0, 0, 1, 1], bool)) == [(2, 4)]


def test_the_summary_is_true_of_each_state(clip, found):
    measured = replace(clip, poses=Poses3D(clip.truth.skeleton, clip.truth.xyz))
    said = " ".join(summary([examine(measured)]))
    assert "cameras measured 100.0\N{NO-BREAK SPACE}%. No joint is completed." in said
    assert (
        "20 frames" not in said and "30 frames at 25 frames/s (1.2 s) from 4 cameras, with 2 captured people." in said
    )
    assert "(measured joints 0\N{NO-BREAK SPACE}mm, completed joints 100\N{NO-BREAK SPACE}mm)" in " ".join(
        summary([found])
    )
    assert "the mean error of joints of body25 is" in " ".join(summary([found]))
    # What was measured and rejected is not called unmeasured.
    views = clip.poses.views.copy()
    views[10:15, 1] = 2
    said = " ".join(summary([examine(replace(clip, poses=replace(clip.poses, views=views)))]))
    assert "0.7\N{NO-BREAK SPACE}% are completed: not measured, as fewer than two cameras agree on them." in said
    assert "0.7\N{NO-BREAK SPACE}% are rejected and replaced: measured, but contradicted" in said
    # No share is told twice.
    for smoothed, then in (
        (slice(None), "100.0\N{NO-BREAK SPACE}% ("),
        (slice(15), "100.0\N{NO-BREAK SPACE}% (50.0\N{NO-BREAK SPACE}% "),
    ):
        source = measured.poses.source.copy()
        source[smoothed] = Source.DENOISED
        said = " ".join(summary([examine(replace(measured, poses=replace(measured.poses, source=source)))]))
        assert f"cameras measured {then}smoothed or denoised afterwards). No joint is completed." in said
    uncaptured = examine(replace(clip, poses=None))
    assert "It is not captured yet: run dmae capture." in summary([uncaptured])[0]
    assert "2 clips: 60 frames" in summary([found, uncaptured])[0]
    assert "1 clip is not captured yet" in summary([found, uncaptured])[0]
    gone = clip.poses.without(np.ones(clip.poses.source.shape, bool))
    assert "capture found no person" in summary([examine(replace(clip, poses=gone))])[0]
    empty = examine(clip.select(frames=slice(0, 0)))
    assert empty.state == State.empty and "It has no frames" in summary([empty])[0]
    assert "no clip" in summary([])[0]


def test_shares_are_never_rounded_to_none_or_all():
    assert share(1, 100_000) == "under 0.1\N{NO-BREAK SPACE}%"
    assert share(99_999, 100_000) == "over 99.9\N{NO-BREAK SPACE}%"
    assert (share(0, 5), share(5, 5)) == ("0.0\N{NO-BREAK SPACE}%", "100.0\N{NO-BREAK SPACE}%")


def test_a_real_recording_is_examined(data_folder):
    import dmae

    clip = dmae.read(data_folder / "shelf")
    found = examine(replace(clip, poses=dmae.capture(clip)))
    assert found.state == State.captured and found.has_truth
    assert found.against_truth["measured"].mean < 60
    assert found.residuals["all"]["all"].mean < 15


def test_quantiles_and_means_are_numpys_within_a_unit():
    rng = np.random.default_rng(0)
    error = rng.gamma(2, 30, 5000)
    found = JointGroup.of(error, np.full(error.shape, Source.MEASURED))
    assert found.mean == np.float64(error.sum() / len(error)) or abs(found.mean - error.mean()) < 1e-9
    for part in (0.1, 0.5, 0.9, 0.99):
        assert abs(found.quantile(part) - np.quantile(error, part)) <= 1


def test_parts_add_up_to_the_whole():
    rng = np.random.default_rng(1)
    error, source = rng.uniform(0, 3000, 400), rng.integers(0, 4, 400)
    error[source == Source.ABSENT] = np.nan
    whole, parts = (
        JointGroup.of(error, source),
        JointGroup.of(error[:150], source[:150]) + JointGroup.of(error[150:], source[150:]),
    )
    assert (parts.joints, parts.completed, parts.missing, parts.compared) == (
        400,
        (source == Source.COMPLETED).sum(),
        (source == Source.ABSENT).sum(),
        np.isfinite(error).sum(),
    )
    assert np.isclose(parts.mean, whole.mean)
    np.testing.assert_array_equal(parts.histogram, whole.histogram)


def test_a_tally_of_nothing_has_no_error():
    none = JointGroup.of(np.full(3, np.nan), np.full(3, Source.MEASURED))
    assert none.mean is None and none.quantile(0.9) is None


def test_groups_of_the_same_name_add_up():
    one = JointGroup.of(np.array([1.0]), np.array([Source.MEASURED]))
    both = added({"a": one, "b": one}, {"b": one, "c": one})
    assert {name: each.joints for name, each in both.items()} == {"a": 1, "b": 2, "c": 1}
    nested = added({"by": {"a": one}}, {"by": {"a": one}, "of": {"b": one}})
    assert nested["by"]["a"].joints == 2 and nested["of"]["b"] is one


def test_regions_are_widened_by_the_error_that_the_truth_states():
    """100 mm off, with a stated error of 20 mm: outside, unless the truth was placed as badly."""
    clip = completed_clip()
    cov = np.where(clip.poses.source[..., None, None] == Source.COMPLETED, 0.02**2 * np.eye(3), np.nan)
    clip = replace(clip, poses=replace(clip.poses, cov=cov))
    rough = np.full((*clip.truth.source.shape, 3, 3), 0.05**2) * np.eye(3)
    said = [
        " ".join(summary([examine(replace(clip, truth=truth))]))
        for truth in (clip.truth, replace(clip.truth, cov=rough))
    ]
    assert "0 of 20 completed joints lie within their stated 90\N{NO-BREAK SPACE}% regions." in said[0]
    assert "20 of 20 completed joints" in said[1]
    assert "widened by the error of the truth itself, 77\N{NO-BREAK SPACE}mm" in said[1]
