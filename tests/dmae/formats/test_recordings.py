"""Cameras matched, frames aligned by number."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import dmae
from dmae.data.skeleton import BODY25, COCO17, PANOPTIC19
from dmae.formats.recordings import NumberedDetections, People, by_name, match_cameras, to_clip
from tests.support.clips import looking_at_origin
from tests.support.recordings import recording

HERE = Path("here")


def rig(*names: str):
    cameras = looking_at_origin(len(names))
    return type(cameras)(names, cameras.K, cameras.dist, cameras.cam_from_world, cameras.size)


@pytest.mark.parametrize(
    ("names", "calibrated", "index", "said"),
    [
        (["b", "a"], ["a", "b"], [1, 0], None),
        (["cam01", "cam02"], ["cam_02", "CAM_01"], [1, 0], None),
        (["1_1", "1_3"], ["1_1", "1_2", "1_3"], [0, 2], "1 calibrated camera has no detections and is left out: 1_2"),
        (["b", "c"], ["a", "b", "c", "d"], [1, 2], "2 calibrated cameras have no detections and are left out: a, d"),
        (["img_1", "img_2"], ["2", "1"], [1, 0], "by number: img_1 = 1, img_2 = 2"),
        (["view0", "view1"], ["cam_1", "cam_2"], [0, 1], "in order of their numbers: view0 = cam_1"),
        (["v9", "v10"], ["c10", "c9"], [1, 0], "by number"),
        (["右", "左"], ["左", "右"], [1, 0], None),
        (["left", "right"], ["a", "b"], [0, 1], "in order of their names: left = a, right = b"),
    ],
)
def test_cameras_match_by_name_number_or_order_and_it_is_said(names, calibrated, index, said):
    found, note = match_cameras(names, rig(*calibrated), HERE)
    assert found == index
    if said is None:
        assert note is None
    else:
        assert re.search(said, note), note


def test_a_recording_without_frames_is_refused_by_name():
    """COCO's list of images can be empty."""
    with pytest.raises(ValueError, match="here: expected detections, found no frame"):
        to_clip(NumberedDetections(BODY25, {}), rig("a", "b"), 25.0, HERE)


def test_names_are_ordered_by_the_numbers_in_them():
    assert [path.name for path in by_name([Path("cam10"), Path("cam2"), Path("2²")])] == ["2²", "cam2", "cam10"]


@pytest.mark.parametrize(
    ("names", "calibrated", "message"),
    [
        (["cam1", "cam2"], ["cam1"], "cam2 has none"),
        (["cam1", "cam3"], ["cam1", "cam2"], "cam3 has none"),
        (["cam1", "cam3", "cam4"], ["cam1", "cam2"], "cam3, cam4 have none"),
        (["v1", "v2"], ["c1", "c2", "c3"], "expected a calibration of each camera"),
        (["v1", "v2", "v4"], ["c1", "c2", "c3"], "with the same numbers"),
        (["cam1", "cam_1"], ["cam1", "cam2"], "different cameras"),
    ],
)
def test_cameras_that_do_not_fit_are_refused_with_both_lists(names, calibrated, message):
    with pytest.raises(ValueError, match=message) as caught:
        match_cameras(names, rig(*calibrated), HERE)
    assert all(name in str(caught.value) for name in (*names, *calibrated, "here"))


def person(x: float) -> np.ndarray:
    return np.full((1, 25, 3), x)


@given(st.lists(st.sets(st.integers(0, 40), min_size=1), min_size=2, max_size=3), st.integers(0, 10**6))
def test_frames_are_aligned_by_number_whatever_is_missing(numbers, start):
    """What a camera says of frame n stands in frame n, and nowhere else."""
    views = {str(v): {start + n: person(n + 1) for n in frames} for v, frames in enumerate(numbers)}
    clip = to_clip(NumberedDetections(BODY25, views), rig(*views), 25.0, HERE)
    first = min(map(min, numbers))
    assert clip.provenance["first_frame"] == start + first
    assert len(clip) == max(map(max, numbers)) - first + 1
    for v, frames in enumerate(numbers):
        there = np.isfinite(clip.detections.xy[:, v, 0, 0, 0])
        np.testing.assert_array_equal(np.flatnonzero(there), sorted(n - first for n in frames))
        np.testing.assert_array_equal(clip.detections.xy[there, v, 0, 0, 0], sorted(n + 1 for n in frames))
        lacking = len(clip) - len(frames)
        notes = [note for note in clip.provenance["notes"] if note.startswith(f"camera {v}:")]
        assert [f"camera {v}: {lacking} of frames" in note for note in notes] == [True] * bool(lacking)


def test_the_rig_is_in_the_order_of_the_calibration_and_the_detections_with_it():
    views = {"c": {0: person(3)}, "a": {0: person(1)}}
    clip = to_clip(NumberedDetections(BODY25, views), rig("a", "b", "c"), 25.0, HERE)
    assert clip.rig.names == ("a", "c")
    assert clip.detections.xy[0, :, 0, 0, 0].tolist() == [1, 3]


def test_truth_is_aligned_with_the_detections():
    truth = {n: np.full((1, 19, 3), n) for n in (4, 6, 9)}
    views = {"a": {5: person(1)}, "b": {7: person(1)}}
    found = NumberedDetections(BODY25, views, truth=truth, truth_skeleton=PANOPTIC19)
    clip = to_clip(found, rig("a", "b"), 25.0, HERE)
    np.testing.assert_array_equal(clip.truth.xyz[:, 0, 0, 0], [np.nan, 6, np.nan])


def test_numbers_that_do_not_count_frames_are_refused():
    views = {"a": {1690000000: person(1), 1690033333: person(1)}, "b": {1690000000: person(1)}}
    with pytest.raises(ValueError, match="numbered by frame, found 3 that count from 1690000000 to 1690033333"):
        to_clip(NumberedDetections(BODY25, views), rig("a", "b"), 25.0, HERE)


def test_a_camera_of_which_nothing_could_be_read_is_refused():
    views = {"a": {0: person(1)}, "b": {}}
    with pytest.raises(ValueError, match="camera 'b' has no readable frame: cut short"):
        to_clip(NumberedDetections(BODY25, views, unreadable={"b": ["cut short"]}), rig("a", "b"), 25.0, HERE)


def test_images_of_another_size_than_calibrated_are_refused():
    views = {"a": {0: person(1)}, "b": {0: person(1)}}
    with pytest.raises(ValueError, match=r"camera 'b': expected images of \(960, 600\).*found \(1920, 1200\)"):
        to_clip(NumberedDetections(BODY25, views, sizes={"b": (1920, 1200)}), rig("a", "b"), 25.0, HERE)


def test_the_size_of_all_cameras_is_known_only_where_they_agree():
    views = {"a": {}, "b": {}}
    assert NumberedDetections(BODY25, views, sizes={"a": (4, 3), "b": (4, 3)}).size == (4, 3)
    assert NumberedDetections(BODY25, views, sizes={"a": (4, 3), "b": (3, 4)}).size is None
    assert NumberedDetections(BODY25, views, sizes={"a": (4, 3)}).size is None


# Confidences that none can be: the joint is absent, and the reader says so.


@pytest.mark.parametrize("confidence", [-1, None])
@pytest.mark.parametrize("format", ["openpose", "easymocap", "coco"])
def test_negative_and_null_confidences_are_absent_and_said(tmp_path, format, confidence):
    clip = recording(BODY25, 2)
    dmae.convert(clip, tmp_path / "r", format)
    pattern = {"openpose": "*/*_keypoints.json", "easymocap": "annots/*/*.json", "coco": "keypoints.json"}[format]
    file = sorted((tmp_path / "r").glob(pattern))[0]
    content = json.loads(file.read_text())
    if format == "openpose":
        content["people"][0]["pose_keypoints_2d"][5] = confidence
    elif format == "easymocap":
        content["annots"][0]["keypoints"][1][2] = confidence
    else:
        content["annotations"][0]["keypoint_scores"][1] = confidence
    file.write_text(json.dumps(content))
    read = dmae.read(tmp_path / "r", fps=25, skeleton="body25")
    observed = clip.detections.observed.sum() - read.detections.observed.sum()
    assert observed == 1
    (note,) = [note for note in read.provenance["notes"] if "confidence" in note]
    assert "1 joint has a negative or null confidence and is treated as absent" in note
    assert file.name in note


def test_a_joint_that_is_null_altogether_is_merely_absent():
    people = People()
    people.add("a", 0, "f", [[None, None, None], [1, 2, 0.0], [1, 2, 0.5], *[[0, 0, 0]] * 14])
    found = people.detections(COCO17)
    np.testing.assert_array_equal(found.views["a"][0][0, :3, 2], [np.nan, np.nan, 0.5])
    assert found.notes == ()
