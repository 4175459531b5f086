"""Videos of a recording: the backgrounds of reports and pictures."""

import numpy as np
import pytest

import dmae
from dmae.data.images import write_video
from dmae.data.skeleton import BODY25
from tests.support.recordings import recording, write_openpose_recording


def write_videos(folder, frames: int = 6, cameras: int = 4, size: tuple[int, int] = (600, 960), name="cam{}.mp4"):
    """Videos in which every camera has its own grey, and every frame is a little lighter."""
    for camera in range(cameras):
        grey = [np.full((*size, 3), 40 * camera + 8 * frame, np.uint8) for frame in range(frames)]
        write_video(folder / name.format(camera), grey, 25)
    return str(folder)


def test_pictures_are_those_of_the_frame_and_camera(tmp_path):
    write_openpose_recording(recording(BODY25, 4), tmp_path / "rec", first=2)
    videos = write_videos(tmp_path / "videos")
    clip = dmae.read(tmp_path / "rec", fps=25, videos=videos, cameras=["cam3", "cam1"], frames=[1, 3])
    assert clip.provenance["notes"] == []
    # The first frame is number 3 of the recording.
    for view, camera in enumerate((3, 1)):
        grey = clip.images.at("rgb", clip.rig.names[view], 0).mean()
        assert grey == pytest.approx(40 * camera + 8 * 3, abs=3)
    dmae.save(clip, tmp_path / "clip")
    again = dmae.load(tmp_path / "clip")
    frames = list(again.images.read("rgb", "cam1"))
    assert len(frames) == 2 and frames[1].mean() == pytest.approx(40 + 8 * 4, abs=3)


def test_videos_that_begin_with_the_clip_or_have_another_size_are_noted(tmp_path):
    write_openpose_recording(recording(BODY25, 4), tmp_path / "rec", first=100)
    videos = write_videos(tmp_path / "videos", frames=4, size=(600, 952), name="Cam_{}.mp4")
    clip = dmae.read(tmp_path / "rec", fps=25, videos=videos)
    notes = clip.provenance["notes"]
    assert "the first frame of the videos is assumed to be frame 100, as they have 4 frames" in notes
    assert any("has pictures of [952, 600] px, the calibration says [960, 600]" in note for note in notes)
    assert clip.images.at("rgb", "cam0", 2).mean() == pytest.approx(16, abs=3)


def test_what_lacks_videos_is_refused_by_name(tmp_path):
    write_openpose_recording(recording(BODY25, 4), tmp_path / "rec")
    (tmp_path / "none").mkdir()
    with pytest.raises(FileNotFoundError, match="expected a video for each camera"):
        dmae.read(tmp_path / "rec", fps=25, videos=str(tmp_path / "none"))
    with pytest.raises(ValueError, match="found none of cam3"):
        dmae.read(tmp_path / "rec", fps=25, videos=write_videos(tmp_path / "three", cameras=3))
    with pytest.raises(ValueError, match=r"cam0\.mp4: expected 4 frames or more as of the detections, found 2"):
        dmae.read(tmp_path / "rec", fps=25, videos=write_videos(tmp_path / "short", frames=2))
