"""When capture finds no person, it names the stage that failed and what to change."""

from dataclasses import replace

import numpy as np
import pytest

from dmae.data.clip import Clip, Detections2D
from dmae.data.skeleton import BODY25
from dmae.reconstruction.config import CaptureConfig, SubjectConfig
from dmae.reconstruction.diagnosis import explain_capture
from dmae.reconstruction.pipeline import capture
from tests.support.detected_people import crossing, detected_clip

CLIP = detected_clip(crossing()[:40], views=5)


def rig_of(change) -> Clip:
    poses = change(CLIP.rig.cam_from_world.copy())
    return replace(CLIP, rig=replace(CLIP.rig, cam_from_world=poses))


def scaled(metre: float):
    def change(poses: np.ndarray) -> np.ndarray:
        poses[:, :3, 3] *= metre
        return poses

    return change


def detected(xy: float = 1.0, score: float = 1.0) -> Clip:
    found = CLIP.detections
    return replace(CLIP, detections=Detections2D(BODY25, found.xy * xy, found.score * score))


@pytest.mark.parametrize(
    ("clip", "suggestion"),
    [
        (rig_of(scaled(1000)), "lengths of the calibration are in mm: data.unit=mm"),
        (rig_of(scaled(100)), "lengths of the calibration are in cm: data.unit=cm"),
        (rig_of(np.linalg.inv), "extrinsics of the calibration are the other way round: data.inverse=true"),
        (rig_of(lambda poses: np.linalg.inv(scaled(1000)(poses))), "in mm: data.unit=mm (of dmae run: world.unit), or "
         "divide its translations by 1000; and extrinsics of the calibration are the other way round"),
        (detected(xy=0.5), "people were detected in images of half the size that was calibrated"),
        (detected(xy=2.0), "people were detected in images of twice the size that was calibrated"),
        (detected(score=0.1), "the greatest confidence is 0.095: give a smaller capture.th_p"),
        (detected(xy=np.nan, score=np.nan), "only joints of confidence 0, which is absent"),
    ],
)  # fmt: skip
def test_the_usual_mistakes_are_named(clip, suggestion):
    (found,) = explain_capture(clip, CaptureConfig()).suggestions
    assert suggestion in found


def test_a_sound_recording_has_no_suggestion_and_every_stage():
    found = explain_capture(CLIP, CaptureConfig())
    assert found.suggestions == ()
    stages = {words.split(" (")[0]: count for words, count in found.stages}
    assert stages["cameras"] == 5 and stages["frames"] == 40
    assert stages["detected joints"] == CLIP.detections.observed.sum()
    assert stages["of these with views that agree on most joints"] == 3


@pytest.mark.parametrize(
    ("config", "suggestion"),
    [
        (CaptureConfig(volume=[5, 5, 0, 6, 6, 2]), "all people are outside capture.volume: x is -"),
        (CaptureConfig(subject=SubjectConfig(leg_m=[2, 3])), "which capture.subject.leg_m leaves out"),
    ],
)
def test_options_that_leave_no_one_are_named(config, suggestion):
    assert capture(CLIP, config).xyz.shape[1] == 0
    assert any(suggestion in each for each in explain_capture(CLIP, config).suggestions)


def test_people_of_a_moment_are_named():
    people = crossing()[:40].copy()
    people[5:] = np.nan
    clip = detected_clip(people, views=5)
    assert capture(clip, CaptureConfig()).xyz.shape[1] == 0
    found = explain_capture(clip, CaptureConfig())
    assert any("give a smaller capture.tracking.min_duration_s" in each for each in found.suggestions)


def test_one_detecting_camera_and_unsynchronised_ones_are_named():
    found = CLIP.detections
    xy, score = found.xy.copy(), found.score.copy()
    xy[:, 1:], score[:, 1:] = np.nan, np.nan
    one = replace(CLIP, detections=Detections2D(BODY25, xy, score))
    assert "are detected by 1 cameras only: cam0" in explain_capture(one, CaptureConfig()).suggestions[0]
    xy, score = found.xy.copy(), found.score.copy()
    for view in range(5):
        other = np.arange(40) // 8 != view
        xy[other, view], score[other, view] = np.nan, np.nan
    apart = replace(CLIP, detections=Detections2D(BODY25, xy, score))
    assert "in different frames" in explain_capture(apart, CaptureConfig()).suggestions[0]
