"""Capture of defective detections, and what must not change its result."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from dmae.data.cameras import CameraRig
from dmae.data.clip import Clip, Detections2D, Poses3D
from dmae.data.skeleton import BODY25
from dmae.metrics.comparison import match, take_matched
from dmae.reconstruction.config import CaptureConfig
from dmae.reconstruction.pipeline import capture, learn_noise
from tests.support.clips import looking_at_origin, looking_inwards
from tests.support.detected_people import crossing, detected_clip, errors, rows_of

DEFAULT = CaptureConfig()
SHORT = slice(40, 56)
"""The frames in which the three meet."""


def changed(clip: Clip, **values) -> Clip:
    """The clip with other `xy` or `score` of its detections."""
    detections = clip.detections
    xy, score = values.get("xy", detections.xy), values.get("score", detections.score)
    return replace(clip, detections=Detections2D(BODY25, xy, score))


def assert_same(found: Poses3D, expected: Poses3D, move=lambda xyz: xyz) -> None:
    """Equal up to the order of rows, and to rounding."""
    truth = move(expected.xyz.astype(float))
    assert found.xyz.shape == truth.shape
    matches = match(found.xyz, truth)
    same = take_matched(found.xyz, matches)
    np.testing.assert_array_equal(np.isnan(same), np.isnan(truth))
    np.testing.assert_allclose(same, truth, atol=2e-4)
    assert all(len(set(row[row >= 0])) == 1 for row in matches.T)


def short(seed: int, views: int = 4) -> Clip:
    return detected_clip(crossing()[SHORT], views, seed=seed)


@settings(max_examples=8, deadline=None)
@given(st.integers(0, 2**32 - 1), st.permutations(range(4)))
def test_the_order_of_views_does_not_matter(seed, order):
    clip = short(seed)
    assert_same(capture(clip.select(views=list(order)), DEFAULT), capture(clip, DEFAULT))


@settings(max_examples=8, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_the_order_of_detections_does_not_matter(seed):
    clip = short(seed)
    xy, score = clip.detections.xy, clip.detections.score
    order = np.random.default_rng(seed).permuted(np.tile(np.arange(3), (*xy.shape[:2], 1)), axis=-1)[..., None]
    shuffled = changed(clip, xy=np.take_along_axis(xy, order[..., None], 2), score=np.take_along_axis(score, order, 2))
    assert_same(capture(shuffled, DEFAULT), capture(clip, DEFAULT))


@settings(max_examples=8, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(0, 4))
@example(1156, 1)  # Whether scores say something was close, and depended on the camera that saw nobody
def test_a_camera_without_detections_does_not_matter(seed, dead):
    clip = short(seed, views=5)
    xy, score = clip.detections.xy.copy(), clip.detections.score.copy()
    xy[:, dead], score[:, dead] = np.nan, np.nan
    alive = [view for view in range(5) if view != dead]
    assert_same(capture(changed(clip, xy=xy, score=score), DEFAULT), capture(clip.select(views=alive), DEFAULT))


@settings(max_examples=8, deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(-np.pi, np.pi), st.tuples(*[st.floats(-50, 50)] * 3))
def test_people_turn_and_move_with_the_world(seed, angle, shift):
    clip = short(seed)
    R = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    world_from_old = np.eye(4)
    world_from_old[:3, :3], world_from_old[:3, 3] = R, shift
    rig = replace(clip.rig, cam_from_world=clip.rig.cam_from_world @ np.linalg.inv(world_from_old))
    moved = capture(replace(clip, rig=rig, truth=None), DEFAULT)
    assert_same(moved, capture(clip, DEFAULT), lambda xyz: xyz @ R.T + shift)


def test_cameras_without_overlap_find_no_people():
    rig = looking_at_origin(4)
    apart = rig.cam_from_world.copy()
    for view in range(4):
        apart[view, :3, 3] += apart[view, :3, :3] @ [30.0 * view, 7.0 * view**2, 0]
    clip = replace(detected_clip(crossing()[SHORT]), rig=replace(rig, cam_from_world=apart))
    assert not np.isfinite(capture(clip, DEFAULT).xyz).any()


def test_cameras_at_one_place_measure_no_depth():
    """Rays that never cross at an angle give no joint, instead of one anywhere along them."""
    rig: CameraRig = looking_inwards(np.array([[6, 0, 2], [6, 0.001, 2], [6, 0, 2.001]]))
    assert not np.isfinite(capture(detected_clip(crossing()[SHORT], noise=0.3, rig=rig), DEFAULT).xyz).any()


def test_zero_frames_are_a_valid_result():
    clip = detected_clip(crossing()).select(frames=slice(0, 0))
    assert capture(clip, DEFAULT).xyz.shape == (0, 0, 25, 3)


def test_a_single_frame_is_enough():
    clip = detected_clip(crossing(), miss=0).select(frames=[0])
    assert capture(clip, DEFAULT).xyz.shape == (1, 3, 25, 3)


@pytest.mark.parametrize("bad", [np.inf, -np.inf])
def test_coordinates_that_are_not_finite_are_absent(bad):
    clip = short(0)
    chance = np.random.default_rng(0).random(clip.detections.score.shape) < 0.1
    known = ~np.isnan(clip.detections.score)
    xy, score = clip.detections.xy.copy(), clip.detections.score.copy()
    xy[chance & known, 0] = bad
    absent = changed(clip, xy=np.where(chance[..., None], np.nan, xy), score=np.where(chance, np.nan, score))
    assert_same(capture(changed(clip, xy=xy), DEFAULT), capture(absent, DEFAULT))


@pytest.mark.parametrize("fisheye", [True, False])
def test_joints_where_a_lens_shows_nothing_are_absent(fisheye):
    rig = looking_at_origin(3)
    bent = replace(rig, dist=np.tile([-0.75, 0, 0, 0, 0], (3, 1)), fisheye=np.full(3, fisheye))
    clip = detected_clip(crossing()[50:56], rig=bent, miss=0)
    xy, score = clip.detections.xy.copy(), clip.detections.score.copy()
    xy[..., 4, :] = 2.0
    corner = changed(clip, xy=xy.copy())
    xy[..., 4, :] = score[..., 4] = np.nan
    poses, without = (capture(each, DEFAULT) for each in (corner, changed(clip, xy=xy, score=score)))
    assert poses.xyz.shape[1] == 3
    np.testing.assert_array_equal(poses.xyz, without.xyz)
    np.testing.assert_array_equal(poses.rays, without.rays)


def test_confidences_are_clipped_to_0_and_1():
    clip = short(0)
    score = clip.detections.score.copy()
    score[:, 0], score[:, 1] = np.where(np.isnan(score[:, 0]), np.nan, 7), np.where(np.isnan(score[:, 1]), np.nan, -3)
    nearest = np.where(np.isnan(score), np.nan, np.clip(score, 0, 1))
    assert_same(capture(changed(clip, score=score), DEFAULT), capture(changed(clip, score=nearest), DEFAULT))


def test_duplicate_detections_are_one_person():
    """Two views detect each person twice, a few pixels apart."""
    clip = detected_clip(crossing())
    rng = np.random.default_rng(1)
    xy, score = clip.detections.xy, clip.detections.score
    duplicate, confidence = np.full_like(xy, np.nan), np.full_like(score, np.nan)
    duplicate[:, :2], confidence[:, :2] = xy[:, :2] + rng.normal(0, 3, xy[:, :2].shape), score[:, :2]
    doubled = changed(clip, xy=np.concatenate([xy, duplicate], 2), score=np.concatenate([score, confidence], 2))
    poses = capture(doubled, DEFAULT)
    assert sorted(rows_of(poses, crossing())) == [[0], [1], [2]]
    assert poses.xyz.shape[1] == 3
    assert np.nanmedian(errors(poses, crossing())) < 0.03


SEEN = np.isfinite(short(0).detections.score)


@pytest.mark.parametrize(
    ("scores", "line"),
    [
        (np.where(SEEN, 0.0, np.nan), "confidences say nothing, so they are not used"),
        (np.where(SEEN, 2.0, np.nan), "confidences say nothing, so they are not used"),
        (np.where(SEEN, -1.0, np.nan), "confidences say nothing, so they are not used"),
        (np.where(np.arange(4)[:, None, None] == 1, np.where(SEEN, 1.0, np.nan), short(0).detections.score), ""),
        (np.where(np.arange(4)[:, None, None] == 1, 100, 1) * short(0).detections.score, ""),
        (100 * short(0).detections.score, ""),
        (100 * np.where(SEEN, np.random.default_rng(0).uniform(size=SEEN.shape), np.nan), "not used"),
    ],
    ids=["0", "2", "-1", "one camera constant", "one camera in percent", "percent", "percent, unrelated"],
)
def test_strange_confidences_lose_nobody_and_are_named(scores, line):
    clip = changed(short(0), score=scores)
    noise = learn_noise(clip, DEFAULT)
    poses = capture(clip, DEFAULT, noise)
    assert poses.xyz.shape[1] == 3
    assert np.isfinite(errors(poses, crossing()[SHORT])).mean() > 0.95
    assert line in noise.describe(clip.rig.names)


@pytest.mark.parametrize("scale", [1 / 960, 1 / 500])
def test_coordinates_that_are_no_pixels_are_refused(scale):
    with pytest.raises(ValueError, match="expected pixels, but no coordinate of a detected joint is above"):
        capture(changed(short(0), xy=scale * short(0).detections.xy), DEFAULT)


def test_absent_joints_at_zero_are_refused():
    """As arrays of OpenPose have them; taken for places, they cost nearly all people, without a word."""
    found = short(0).detections
    with pytest.raises(ValueError, match=r"% of the detected joints are at pixel \(0, 0\).*expected NaN"):
        capture(changed(short(0), xy=np.nan_to_num(found.xy), score=np.nan_to_num(found.score)), DEFAULT)


def test_scores_in_percent_do_not_make_a_still_look_sharper():
    """In a single frame the prior counts much; scores above 1 must not count as great certainty."""
    clip = detected_clip(crossing()[40:41], 4)
    alike = learn_noise(changed(clip, score=np.where(np.isnan(clip.detections.score), np.nan, 1.0)), DEFAULT)
    drawn = np.random.default_rng(0).uniform(0, 100, clip.detections.score.shape)
    percent = learn_noise(changed(clip, score=np.where(np.isnan(clip.detections.score), np.nan, drawn)), DEFAULT)
    assert 0.9 < percent.usual_m / alike.usual_m < 1.15
