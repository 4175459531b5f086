"""Estimated positions and occlusions of people, compared with the scene that the clip was generated from."""

from dataclasses import replace

import numpy as np
import pytest

from dmae.data.skeleton import BODY25, COCO17, SHELF14, Skeleton
from dmae.evaluation.corruption.corrupt import (
    detections_of_people,
    limb_of_joint,
    people_of,
    people_of_detections,
    share_of_time,
)
from dmae.evaluation.corruption.detector import nearest_other
from dmae.evaluation.corruption.occlusions import clearance, clearance_of_self, companion, delayed
from dmae.reconstruction.config import CaptureConfig
from tests.support.clips import t_pose
from tests.support.stressed_clips import strollers

STICK = Skeleton("stick", ("low", "high"), (-1, 0))
CAMERA = np.array([[-6.0, 0, 1]])


def stick(x: float, y: float) -> np.ndarray:
    """(1, 1, 2, 3) a pole of 2 m."""
    return np.array([[[[x, y, 0], [x, y, 2]]]], float)


def test_detections_are_those_of_the_people_they_were_made_of():
    clip = strollers()
    clip = replace(clip, poses=people_of(clip, CaptureConfig()))
    shown, seen = people_of_detections(clip), clip.detections.observed.sum(-1) > 5
    assert (shown[seen] == clip.detection_labels.person[seen]).mean() > 0.99
    assert (detections_of_people(clip) >= 0).mean() > 0.8


def test_without_truth_people_are_those_that_all_cameras_measure():
    clip = strollers()
    found, wanted = (people_of(each, CaptureConfig()).xyz for each in (replace(clip, truth=None), clip))
    nearest = np.linalg.norm(found[:, :, None, 8] - wanted[:, None, :, 8], axis=-1).min(-1)
    assert np.nanmax(nearest) < 0.05


@pytest.mark.parametrize(("x", "y", "expected"), [(-3, 0.5, 0.45), (-3, 0.02, -0.03), (3, 0.5, None), (-0.1, 0, None)])
def test_clearance_is_the_distance_of_a_pole_from_the_line_of_sight(x, y, expected):
    """At the height of the line of sight. A pole behind the joint, or just before it, hides nothing."""
    joint = np.array([[[[0, 0, 1.0], [np.nan] * 3]]])
    found = clearance(CAMERA, joint, stick(x, y), STICK)[0, 0, 0]
    assert np.isnan(found[1])
    if expected is None:
        assert found[0] > -0.05
    else:
        assert found[0] == pytest.approx(expected, abs=1e-6)


def test_the_far_arm_is_behind_the_trunk():
    body = t_pose()[None, None]
    beside = np.array([[0.0, -6, 1.3]])
    margin = clearance_of_self(beside, body, BODY25)[0, 0, 0]
    left, right = (margin[BODY25.index(f"{side}_wrist")[0]] for side in "lr")
    assert left < 0 < right


def test_companions_keep_their_distance():
    people = strollers().truth.xyz.astype(float)
    copy = companion(people, 1, 2.0, 0.3, 7)
    middles = [(body[..., :2].max(1) + body[..., :2].min(1)) / 2 for body in (people[:, 1], copy)]
    np.testing.assert_allclose(np.linalg.norm(middles[0] - middles[1], axis=-1), 2)
    np.testing.assert_allclose(copy[20, :, 2], people[13, 1, :, 2])


def test_delay_runs_back_at_the_ends():
    assert delayed(4, 1).tolist() == [1, 0, 1, 2]
    assert delayed(4, -2).tolist() == [2, 3, 2, 1]
    assert delayed(1, 5).tolist() == [0]


def test_limbs_are_arms_legs_head_and_trunk():
    for skeleton, limbs in ((BODY25, 6), (COCO17, 6), (SHELF14, 6)):
        limb = limb_of_joint(skeleton)
        assert len(set(limb.tolist())) == limbs
        assert len(set(limb[skeleton.index("l_knee", "l_ankle")].tolist())) == 1
        assert limb[skeleton.index("l_wrist")[0]] != limb[skeleton.index("r_wrist")[0]]


@pytest.mark.parametrize("percent", [0, 10, 50, 100])
def test_events_fill_the_asked_share(percent):
    clip = strollers()
    events = share_of_time(clip, (5, 3), percent, (1.0, 0.1), rng=np.random.default_rng(0))
    assert 100 * events.mean() == pytest.approx(percent, abs=0.1)
    more = share_of_time(clip, (5, 3), min(percent + 20, 100), (1.0, 0.1), rng=np.random.default_rng(0))
    assert not (events & ~more).any()


def test_nearest_other_detection():
    xy = np.full((1, 1, 4, 1, 2), np.nan)
    xy[0, 0, :3, 0] = [[0, 0], [10, 0], [100, 0]]
    assert nearest_other(xy).tolist() == [[[1, 0, 1, 3]]]
    assert nearest_other(xy[:, :, :1]).tolist() == [[[0]]]
