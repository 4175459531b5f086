"""Pose landmarks of MediaPipe, in the forms in which its results are saved."""

import json

import numpy as np
import pytest

import dmae
from dmae.data.skeleton import BLAZEPOSE33
from tests.support.recordings import recording, same_detections
from tests.support.tracked_recordings import mediapipe_frames, one_person, write_mediapipe


def saved(folder, clip, form):
    for view, name in enumerate(clip.rig.names):
        (folder / f"mediapipe/{name}.json").write_text(json.dumps(form(mediapipe_frames(clip, view))))


@pytest.mark.parametrize(
    "form",
    [
        lambda frames: frames,
        lambda frames: {"frames": [frame["landmarks"] for frame in frames]},
        lambda frames: [{"poseLandmarks": [{"landmark": one} for one in frame["landmarks"]]} for frame in frames],
    ],
    ids=["objects", "lists", "protobufs"],
)
def test_people_are_read_in_px(tmp_path, form):
    clip = write_mediapipe(tmp_path, recording(BLAZEPOSE33, 4, 3))
    saved(tmp_path, clip, form)
    read = dmae.read(tmp_path, fps=25)
    assert read.detections.skeleton == BLAZEPOSE33
    same_detections(read.detections, clip.detections)


@pytest.mark.parametrize(
    "form",
    [
        lambda frames: [frame["landmarks"][0] for frame in frames],
        lambda frames: [{"pose_landmarks": {"landmark": frame["landmarks"][0]}} for frame in frames],
    ],
    ids=["a list", "an object"],
)
def test_one_person_needs_no_list_of_people(tmp_path, form):
    clip = one_person()
    write_mediapipe(tmp_path, clip)
    saved(tmp_path, clip, form)
    same_detections(dmae.read(tmp_path, fps=25).detections, clip.detections)


def test_frames_without_people_and_landmarks_without_visibility(tmp_path):
    clip = one_person(frames=3)
    write_mediapipe(tmp_path, clip)

    def form(frames):
        landmarks = [{key: each[key] for key in ("x", "y")} for each in frames[2]["landmarks"][0]]
        return [None, {"landmarks": []}, {"frame": 4, "landmarks": [landmarks]}]

    saved(tmp_path, clip, form)
    read = dmae.read(tmp_path, fps=25)
    assert len(read) == 5
    assert np.isnan(read.detections.xy[:4]).all()
    # Those at 0, 0 are absent, as they were.
    seen = np.where(np.isnan(clip.detections.score[2]), np.nan, 1)
    np.testing.assert_array_equal(read.detections.score[4], seen)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ({"pose": 1}, "expected a list of frames"),
        ([{"landmarks": [[{"x": 0.5, "y": 0.5}] * 32]}], "expected 33 landmarks of each person, found 32 of them"),
        ([[[{"x": 0.5}] * 33]], "expected landmarks with x, y and visibility, found {.x.: 0.5}"),
        ([[[{"x": "left", "y": 0}] * 33]], "expected landmarks with x, y and visibility"),
        ([[[{"x": 640, "y": 0.5}] * 33]], "x and y, shares of the image"),
        ([{"frame": 1}, {"frame": 1}], "expected a frame number, each once, found 1"),
    ],
)
def test_bad_files_are_refused(tmp_path, content, message):
    clip = write_mediapipe(tmp_path)
    (tmp_path / f"mediapipe/{clip.rig.names[0]}.json").write_text(json.dumps(content))
    with pytest.raises(ValueError, match=message):
        dmae.read(tmp_path, fps=25)


def test_another_skeleton_is_refused(tmp_path):
    write_mediapipe(tmp_path)
    with pytest.raises(ValueError, match="MediaPipe's landmarks are blazepose33"):
        dmae.read(tmp_path, fps=25, skeleton="coco17")
