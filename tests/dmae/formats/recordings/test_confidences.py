"""Confidences that none can be: the joint is absent, and the reader says so."""

import json

import numpy as np
import pytest

import dmae
from dmae.data.skeleton import BODY25
from dmae.formats.recordings.confidences import Confidences
from tests.support.recordings import recording


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
    confidences = Confidences()
    rows = np.array([[np.nan, np.nan, np.nan], [1, 2, 0.0], [1, 2, 0.5]])
    np.testing.assert_array_equal(confidences.clean("f", rows)[:, 2], [np.nan, np.nan, 0.5])
    assert confidences.notes == ()
