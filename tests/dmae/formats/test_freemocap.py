"""Recordings of FreeMoCap."""

import numpy as np
import pytest

import dmae
from dmae.data.images import write_video
from tests.support.recordings import same_detections
from tests.support.tracked_recordings import write_freemocap


@pytest.mark.parametrize("how", [{}, {"depth": True}, {"corner": True}])
def test_a_recording_is_read_in_metres_and_upright(tmp_path, how):
    clip = write_freemocap(tmp_path, **how)
    read = dmae.read(tmp_path, fps=30)
    same_detections(read.detections, clip.detections)
    np.testing.assert_allclose(read.rig.cam_from_world, clip.rig.cam_from_world, atol=1e-6)
    assert dmae.read(tmp_path, fps=30, unit="m").rig.centers.max() > 500


def test_the_rate_is_that_of_the_synchronised_videos(tmp_path):
    write_freemocap(tmp_path)
    with pytest.raises(ValueError, match=r"give fps="):
        dmae.read(tmp_path)
    write_video(tmp_path / "synchronized_videos/Camera_0.mp4", np.zeros((3, 16, 16, 3), np.uint8), 30)
    assert dmae.read(tmp_path).fps == 30


def test_arrays_that_do_not_fit_are_refused(tmp_path):
    write_freemocap(tmp_path)
    (file,) = tmp_path.glob("output_data/raw_data/*.npy")
    values = np.load(file)
    for wrong in (values[:2], values[:, :, :20], values[..., 0], np.array(["a"])):
        np.save(file, wrong)
        with pytest.raises(ValueError, match=r"expected (numbers of )?shape \(3 cameras, frames, 33 or more points"):
            dmae.read(tmp_path, fps=30)
