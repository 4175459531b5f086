"""Predictions of MMPose and RTMPose, in JSON and in pickles."""

import json
import os
import pickle

import numpy as np
import pytest

import dmae
from dmae.data.skeleton import COCO17, HALPE26
from tests.support.recordings import recording, same_detections
from tests.support.tracked_recordings import mmpose_frames, write_mmpose


@pytest.mark.parametrize("kind", ["json", "pkl"])
@pytest.mark.parametrize("skeleton", [COCO17, HALPE26], ids=lambda s: s.name)
def test_predictions_are_read(tmp_path, kind, skeleton):
    clip = write_mmpose(tmp_path, recording(skeleton, 4, 3), kind)
    read = dmae.read(tmp_path, fps=25)
    same_detections(read.detections, clip.detections)
    assert read.rig.names == clip.rig.names


@pytest.mark.parametrize(
    "form",
    [
        lambda frames: frames,
        lambda frames: [frame["instances"] for frame in frames],
        lambda frames: {"predictions": [[frame["instances"]] for frame in frames]},
        lambda frames: {str(frame["frame_id"]): frame["instances"] for frame in frames},
        lambda frames: [
            [{"keypoints": np.c_[p["keypoints"], p["keypoint_scores"]].tolist()} for p in frame["instances"]]
            for frame in frames
        ],
    ],
    ids=["frames", "lists of people", "an inferencer's result", "by number", "scores in keypoints"],
)
def test_frames_in_any_of_their_forms(tmp_path, form):
    clip = write_mmpose(tmp_path, recording(COCO17, 3, 2))
    for view, name in enumerate(clip.rig.names):
        (tmp_path / f"predictions/{name}.json").write_text(json.dumps(form(mmpose_frames(clip, view))))
    same_detections(dmae.read(tmp_path, fps=25).detections, clip.detections)


def test_of_a_whole_body_the_body_is_read(tmp_path):
    clip = write_mmpose(tmp_path, recording(COCO17, 2, 2))
    for file in (tmp_path / "predictions").glob("*.json"):
        content = json.loads(file.read_text())
        for frame in content["instance_info"]:
            for person in frame["instances"]:
                person["keypoints"] += [[1.0, 2.0]] * 116
                person["keypoint_scores"] += [0.5] * 116
        file.write_text(json.dumps(content))
    read = dmae.read(tmp_path, fps=25)
    same_detections(read.detections, clip.detections)
    assert "each person has 133 points; the first 17 are read, as coco17" in read.provenance["notes"]


def test_a_pickle_that_asks_for_code_runs_none(tmp_path):
    class Harm:
        def __reduce__(self):
            return os.mkdir, (str(tmp_path / "harmed"),)

    write_mmpose(tmp_path, kind="pkl")
    file = next((tmp_path / "predictions").glob("*.pkl"))
    file.write_bytes(pickle.dumps([Harm()]))
    with pytest.raises(ValueError, match="mkdir, which is not loaded"):
        dmae.read(tmp_path, fps=25)
    assert not (tmp_path / "harmed").exists()


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("5", "expected a list of frames"),
        ("[5]", "expected a list of people"),
        ('[[{"keypoints": [[1, 2]]}]]', "expected x, y, confidence of each joint"),
        ('[[{"keypoints": [[1, 2, 0.5]]}]]', r"expected people of 17 joints as in .*cam0.*found 1"),
        (
            '[{"frame_id": 1, "instances": []}, {"frame_id": 1, "instances": []}]',
            "expected a frame number, each once, found 1",
        ),
    ],
)
def test_malformed_predictions_are_refused_by_name(tmp_path, content, message):
    write_mmpose(tmp_path)
    file = sorted((tmp_path / "predictions").glob("*.json"))[1]
    file.write_text(content)
    with pytest.raises(ValueError, match=message) as caught:
        dmae.read(tmp_path, fps=25)
    assert str(tmp_path) in str(caught.value)
