"""Detections as EasyMocap annotates them."""

import json
from pathlib import Path

import numpy as np
import pytest

from dmae.data.skeleton import BODY25, COCO17
from dmae.formats.easymocap import read_detections


def person(x: float, joints: int = 25) -> dict:
    """Joint j is at (x + j, 2 j) with confidence 0.5, but for the first, which was not found."""
    keypoints = [[x + j, 2.0 * j, 0.5] for j in range(joints)]
    keypoints[0] = [0.0, 0.0, 0.0]
    return {"personID": 0, "bbox": [0, 0, 9, 9, 0.9], "keypoints": keypoints, "isKeyframe": False}


def frame(*people: dict) -> dict:
    return {"filename": "images/1/000000.jpg", "height": 600, "width": 960, "annots": [*people], "isKeyframe": False}


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    """Three frames of two cameras, numbered from 7; the second camera lacks frame 8."""
    files = {
        "1/000007": frame(person(10), person(300)), "1/000008": frame(), "1/000009": frame(person(12)),
        "2/000007": frame(person(50)), "2/000009": frame(person(52)),
    }  # fmt: skip
    for name, content in files.items():
        path = tmp_path / "annots" / f"{name}.json"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(content))
    return tmp_path


def test_pixels_confidences_and_frames_are_those_of_the_files(recording):
    found = read_detections(recording)
    assert found.skeleton is BODY25
    assert {name: sorted(view) for name, view in found.views.items()} == {"1": [7, 8, 9], "2": [7, 9]}
    assert [len(found.views["1"][number]) for number in (7, 8, 9)] == [2, 0, 1]
    np.testing.assert_array_equal(found.views["1"][7][1, 3], [303, 6, 0.5])
    assert found.sizes == {"1": (960, 600), "2": (960, 600)}


def test_a_joint_of_no_confidence_is_absent_not_at_the_corner(recording):
    assert np.isnan(read_detections(recording).views["1"][7][:, 0]).all()


def test_a_person_without_any_joint_is_none(recording):
    (recording / "annots/1/000007.json").write_text(
        json.dumps(frame(person(1) | {"keypoints": [[0, 0, 0]] * 25}, person(2)))
    )
    assert len(read_detections(recording).views["1"][7]) == 1


@pytest.mark.parametrize("folder", [".", "annots"])
def test_the_recording_or_its_annotations_may_be_named(folder, recording):
    assert set(read_detections(recording / folder).views) == {"1", "2"}


def test_other_skeletons_may_be_named(recording):
    for file in (recording / "annots").rglob("*.json"):
        file.write_text(json.dumps(frame(person(3, 17))))
    assert read_detections(recording, skeleton=COCO17).skeleton is COCO17
    with pytest.raises(ValueError, match=r"annots\[0\]\.keypoints: .* 25 joints as of body25, found 17"):
        read_detections(recording)


def test_frames_cut_short_are_absent_and_counted_and_shift_nothing(recording):
    (recording / "annots/1/000008.json").write_text('{"annots": [')
    found = read_detections(recording)
    assert sorted(found.views["1"]) == [7, 9]
    assert len(found.unreadable["1"]) == 1
    assert "000008.json: expected JSON" in found.unreadable["1"][0]


MALFORMED = {
    "other JSON": ({"people": []}, ["expected an object with a list of annots", "people"]),
    "no keypoints": (frame({"personID": 0}), [r"annots\[0\]\.keypoints", "found None"]),
    "ragged": (frame(person(1) | {"keypoints": [[1, 2, 3], [1]]}), [r"annots\[0\]\.keypoints", "x, y, confidence"]),
    "another size": (frame() | {"width": 640}, [r"expected images of \(960, 600\)", r"camera '1', found \(640, 600\)"]),
    "no size": (frame() | {"width": "wide"}, ["positive whole width and height", "wide"]),
}


@pytest.mark.parametrize(("content", "message"), MALFORMED.values(), ids=MALFORMED)
def test_malformed_files_are_named_with_the_place(content, message, recording):
    (recording / "annots/1/000008.json").write_text(json.dumps(content))
    with pytest.raises(ValueError, match=r"000008\.json") as error:
        read_detections(recording)
    for part in message:
        error.match(part)


def test_frames_twice_none_at_all_and_none_readable(recording, tmp_path):
    (recording / "annots/1/7.json").write_text(json.dumps(frame()))
    with pytest.raises(ValueError, match=r"annots/1/7\.json: expected frame 7 once, found it in 000007\.json too"):
        read_detections(recording)
    (recording / "annots/1/7.json").unlink()
    for file in recording.rglob("*.json"):
        file.write_text("{")
    with pytest.raises(ValueError, match=r"not one file could be read; .*000007\.json: expected JSON"):
        read_detections(recording)
    (tmp_path / "empty").mkdir()
    with pytest.raises(FileNotFoundError, match=r"annots/<camera>/<frame number>\.json, found none"):
        read_detections(tmp_path / "empty")
