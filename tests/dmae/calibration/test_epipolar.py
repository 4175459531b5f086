"""Epipolar lines and the agreement of views on exact detections."""

from dataclasses import replace

import numpy as np

from dmae.calibration.epipolar import Hypothesis, ViewSample, fundamental, mean_agreement, measure_agreement
from dmae.data.clip import Detections2D
from dmae.data.skeleton import BODY25
from dmae.formats.config import Convention
from tests.support.clips import full_clip
from tests.support.faulty_recordings import lenses


def test_epipolar_lines_pass_through_joints_that_both_cameras_see():
    clip, rig = full_clip(), lenses()
    xy, _ = rig.project(clip.truth.xyz)
    ideal = np.concatenate([rig.undistort(xy), np.ones_like(xy[..., :1])], -1)[:, :, 0]
    F = fundamental(rig, np.array([0]), np.array([2]))[0]
    lines = ideal[:, 0] @ F.T
    off = np.abs((lines * ideal[:, 2]).sum(-1)) / np.linalg.norm(lines[..., :2], axis=-1)
    np.testing.assert_allclose(off, 0, atol=1e-6)
    exact = replace(clip, rig=rig, detections=Detections2D(BODY25, xy, np.where(np.isnan(xy[..., 0]), np.nan, 1)))
    found = measure_agreement(ViewSample.of(Hypothesis.of(exact, Convention()), np.arange(12)), [(0, 2)])
    assert found.detections.tolist() == [[4] * 12]
    # 15 joints are compared, and 1 is added to the denominator.
    np.testing.assert_allclose(found.total, 4 * 15 / 16, rtol=1e-3)
    np.testing.assert_allclose(found.residual, 0, atol=0.01)


def test_no_pair_of_views_agrees_on_nothing():
    assert mean_agreement({}) == 0
