"""Left and right exchanged by a detector, corrected by the other cameras and the frames around."""

from dataclasses import replace

import numpy as np
import pytest

from dmae.data.clip import Clip
from dmae.data.skeleton import BODY25
from dmae.reconstruction.config import CaptureConfig
from dmae.reconstruction.evidence import Evidence
from dmae.reconstruction.pipeline import capture
from dmae.reconstruction.sides import Sides, exchanged_detections, turn
from tests.support.detected_people import detected_clip, errors, walk
from tests.support.stressed_clips import strollers

MIRROR = list(BODY25.mirror)
LIMBS = BODY25.index("l_wrist", "r_wrist", "l_elbow", "r_elbow", "l_knee", "r_knee", "l_ankle", "r_ankle")


def exchanged(clip: Clip, frames: slice, views: list[int], joints: list[int] | None = None) -> Clip:
    """The clip with left and right exchanged in some frames and views, of all joints or of some."""
    order = np.arange(len(BODY25))
    order[joints or range(len(BODY25))] = np.array(MIRROR)[joints or range(len(BODY25))]
    xy, score = clip.detections.xy.copy(), clip.detections.score.copy()
    for view in views:
        xy[frames, view] = xy[frames, view][:, :, order]
        score[frames, view] = score[frames, view][:, :, order]
    return replace(clip, detections=replace(clip.detections, xy=xy, score=score))


def one_walker(views: int = 4) -> Clip:
    return detected_clip(walk((-0.5, -0.3), (0.5, 0.3))[:, None], views)


def test_pairs_are_left_and_right():
    pairs = Sides.of(BODY25).pairs
    assert all(BODY25.joints[left][2:] == BODY25.joints[right][2:] for left, right in pairs)
    assert len(pairs) == 11 and not set(BODY25.index("nose", "neck", "mid_hip")) & set(pairs.ravel().tolist())


@pytest.mark.parametrize("frames", [slice(40, 41), slice(30, 60)], ids=["a frame", "seconds"])
def test_a_camera_that_exchanges_sides_changes_nothing(frames):
    clip = one_walker()
    truth = clip.truth.xyz
    wrong = exchanged(clip, frames, [1])
    before, after = (errors(capture(each, CaptureConfig()), truth) for each in (clip, wrong))
    assert np.isfinite(after).mean() > np.isfinite(before).mean() - 0.01
    assert np.nanmedian(after[frames]) < np.nanmedian(before[frames]) + 0.002
    assert np.nanmax(after[frames]) < 0.15


def test_two_cameras_of_four_are_put_right_by_the_frames_before():
    clip = one_walker()
    poses = capture(exchanged(clip, slice(40, 70), [0, 2]), CaptureConfig())
    assert np.nanquantile(errors(poses, clip.truth.xyz)[40:70], 0.99) < 0.1


@pytest.mark.parametrize("views", [[0, 1], [0, 1, 2]], ids=["two of three", "all"])
def test_most_cameras_exchange_sides_for_a_moment(views):
    """The person changed sides with them, and back."""
    clip = one_walker(3)
    poses = capture(exchanged(clip, slice(40, 50), views), CaptureConfig())
    assert np.nanquantile(errors(poses, clip.truth.xyz)[40:50], 0.99) < 0.1


def test_a_person_found_with_exchanged_sides_is_turned():
    """Two cameras of three exchange sides at first. What they show later tells which sides are right."""
    clip = one_walker(3)
    poses = capture(exchanged(clip, slice(0, 20), [0, 1]), CaptureConfig())
    assert np.nanquantile(errors(poses, clip.truth.xyz), 0.99) < 0.1


def test_turning_round_between_two_frames_exchanges_no_sides():
    """At one frame a second people turn by any angle from one frame to the next; a quarter of the joints was wrong."""
    turns = np.random.default_rng(0).uniform(-np.pi, np.pi, 30)
    people = np.stack([walk((0, 0), (0.1, 0), heading=turn, frames=1) for turn in turns])
    poses = capture(replace(detected_clip(people), fps=1.0), CaptureConfig())
    assert np.nanquantile(errors(poses, people), 0.99) < 0.15


def test_one_limb_alone():
    clip = one_walker()
    legs = BODY25.index("l_knee", "r_knee", "l_ankle", "r_ankle")
    poses = capture(exchanged(clip, slice(20, 80), [3], legs), CaptureConfig())
    assert np.nanquantile(errors(poses, clip.truth.xyz)[20:80], 0.99) < 0.1


def test_views_of_a_joint_are_regained():
    """Without exchange, the camera is an outlier, and its view is lost."""
    clip = one_walker(3)
    poses = capture(exchanged(clip, slice(20, 80), [1]), CaptureConfig())
    plain = capture(clip, CaptureConfig())
    regained = poses.views[20:80][:, :, LIMBS].mean() / plain.views[20:80][:, :, LIMBS].mean()
    assert regained > 0.97


def test_where_all_cameras_exchange_nothing_is_touched():
    clip = one_walker()
    poses = capture(exchanged(clip, slice(0, 100), [0, 1, 2, 3]), CaptureConfig())
    assert np.nanmedian(errors(poses, clip.truth.xyz[:, :, MIRROR])) < 0.03


def test_the_camera_and_its_frames_are_named():
    clip = exchanged(one_walker(), slice(30, 60), [1])
    found, disagreeing = exchanged_detections(clip, capture(clip, CaptureConfig()))
    assert found.shape == disagreeing.shape == (100, 4) and not disagreeing.any()
    assert found[30:60, 1].mean() > 0.9
    found[30:60, 1] = False
    assert found.mean() < 0.01


def test_no_people_no_exchange():
    clip = detected_clip(np.full((5, 1, 25, 3), np.nan))
    assert not np.any(exchanged_detections(clip, capture(clip, CaptureConfig())))


def test_of_two_cameras_that_disagree_neither_is_accused():
    clip = exchanged(one_walker(), slice(30, 60), [1]).select(views=[0, 1])
    found, disagreeing = exchanged_detections(clip, capture(clip, CaptureConfig()))
    assert not found.any()
    assert disagreeing[30:60].mean() > 0.9 and disagreeing[:25].mean() < 0.05 and disagreeing[65:].mean() < 0.05


def test_sides_stay_where_legs_change_places_between_two_frames():
    """At ten frames a second, the legs of a runner seen from the side are where the other ones were."""
    clip = strollers(30, persons=3, views=4, fps=10.0)
    poses, truth = capture(clip, CaptureConfig()).xyz, clip.truth.xyz
    away = np.linalg.norm(poses[:, :, None] - truth[:, None], axis=-1)
    nearest = np.nanmean(away, axis=(0, 3)).argmin(1)
    assert sorted(nearest) == [0, 1, 2]
    assert np.nanmax(away[:, np.arange(3), nearest]) < 0.1


def test_people_whom_a_view_shows_in_two_parts_are_turned_as_a_whole():
    """The left hip is in another detection than the right one; each has the other's place afterwards."""
    evidence = Evidence.of(one_walker(), 0.0, CaptureConfig(), slice(0, 1))
    left, right = BODY25.index("l_hip", "r_hip")
    parts = np.concatenate([evidence.xy, np.full_like(evidence.xy, np.nan)], 2)
    parts[0, 0, 1, left], parts[0, 0, 0, left] = parts[0, 0, 0, left], np.nan
    confidence = np.where(np.isnan(parts[..., 0]), np.nan, 0.9)
    assigned = np.zeros((1, 1, 4, 25), int)
    assigned[0, 0, 0, left] = 1
    turned = turn(replace(evidence, xy=parts, confidence=confidence), assigned, np.ones((1, 1), bool), Sides.of(BODY25))
    np.testing.assert_array_equal(turned.xy[0, 0, 1, left], evidence.xy[0, 0, 0, right])
    np.testing.assert_array_equal(turned.xy[0, 0, 0, right], evidence.xy[0, 0, 0, left])


def test_a_limb_counts_as_one_pair_besides_the_one_that_it_hangs_from():
    sides = Sides.of(BODY25)
    weights = dict(zip([BODY25.joints[left] for left in sides.pairs[:, 0]], sides.weights(), strict=True))
    assert {joint: weight for joint, weight in weights.items() if weight == 1}.keys() == {"l_shoulder", "l_hip"}
    assert all(weights[joint] == 0.5 for joint in ("l_elbow", "l_wrist", "l_eye", "l_ear"))
    assert all(weights[joint] == 0.2 for joint in ("l_knee", "l_ankle", "l_heel", "l_big_toe", "l_small_toe"))
