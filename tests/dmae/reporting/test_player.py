import base64
import io
import zlib
from dataclasses import replace

import av
import numpy as np
import pytest

from dmae.data.images import Images, write_video
from dmae.reporting.player import packed, player_data, small_videos, window
from tests.support.clips import full_clip
from tests.support.reported_clips import completed_clip, grey_of, with_images

MINUTE_BYTES = 15e6


def unpacked(text: str, shape: tuple[int, ...]) -> np.ndarray:
    """The inverse of `packed`, as the page does it."""
    planes = np.frombuffer(zlib.decompress(base64.b64decode(text)), np.uint8).reshape(3, -1, shape[0]).astype(np.uint16)
    steps = planes[0] + (planes[1] << 8)
    values = np.cumsum(steps, axis=1, dtype=np.uint16).view(np.int16)
    return np.where(planes[2], values, np.nan).T.reshape(shape)


def test_packed_numbers_are_the_rounded_ones():
    values = np.random.default_rng(0).normal(0, 9000, (50, 3, 4))
    values[10:20, 1] = values[:, 2, 3] = values[0, 0, 0] = np.nan
    values[30, 0, 0] = np.inf
    expected = np.where(np.isfinite(values), np.clip(np.round(values), -32000, 32000), np.nan)
    np.testing.assert_array_equal(unpacked(packed(values), values.shape), expected)


def test_a_wide_scene_keeps_its_shape():
    clip = completed_clip()
    far = replace(clip.poses, xyz=clip.poses.xyz + 500 * np.arange(2)[:, None, None])
    data = player_data(replace(clip, poses=far))["poses"]
    found = unpacked(data["xyz"], far.xyz.shape) * data["unit"] + data["origin"]
    np.testing.assert_allclose(found, far.xyz, atol=data["unit"])
    assert data["unit"] == pytest.approx(0.001, rel=10)


def test_a_detection_far_outside_the_images_costs_no_precision():
    clip = full_clip()
    xy = clip.detections.xy.copy()
    xy[3, 0, 0, 5] = 9e6, 40
    data = player_data(replace(clip, detections=replace(clip.detections, xy=xy)))["detections"]
    assert data["unit"] < 1
    found = unpacked(data["xy"], (len(xy), xy.shape[1], data["number"], *xy.shape[3:])) * data["unit"]
    assert np.isnan(found[3, 0, :, 5]).all(-1).any()
    assert np.nanmax(np.abs(found)) < 20 * clip.rig.size.max()


def test_windows_hold_their_centre_and_lie_in_the_clip():
    assert window(100, 200, 50) == slice(0, 100)
    assert window(100, 20, 50) == slice(40, 60)
    assert window(100, 20, 99) == slice(80, 100)
    assert window(100, 20, 0) == slice(0, 20)


def test_each_frame_of_a_small_video_is_that_frame_of_the_clip(tmp_path):
    clip = with_images(completed_clip(), tmp_path).select(frames=slice(5, 25), views=[2])
    (video,), problem = small_videos(clip)
    assert problem is None
    with av.open(io.BytesIO(base64.b64decode(video))) as container:
        frames = list(container.decode(video=0))
    assert (frames[0].width, frames[0].height) == (960, 600)
    assert [round(float(frame.time) * 25) for frame in frames] == list(range(20))
    greys = [frame.to_ndarray(format="rgb24").mean() for frame in frames]
    np.testing.assert_allclose(greys, [grey_of(frame) for frame in range(5, 25)], atol=3)


@pytest.mark.parametrize(("minutes", "width"), [(0.2, 960), (0.5, 640), (1.0, 480)])
def test_images_are_as_wide_as_the_length_of_the_clip_allows(tmp_path, monkeypatch, minutes, width):
    """Of five cameras. The share of the page that a part of the clip has is that of the part."""
    clip = with_images(completed_clip(), tmp_path).select(frames=slice(0, 5), views=[2])
    share = len(clip) / clip.fps / (60 * minutes) * len(clip.rig) / 5
    monkeypatch.setattr("dmae.reporting.player._BITS_OF_CLIP", 60_000_000 * share)
    (video,), _ = small_videos(clip)
    with av.open(io.BytesIO(base64.b64decode(video))) as container:
        assert container.streams.video[0].width == width


def test_images_of_five_cameras_fit_their_share_of_the_page(tmp_path, monkeypatch):
    """Even of moving noise: no more than two seconds' share for one second, as the first frame is dear."""
    monkeypatch.setattr("dmae.reporting.player._BITS_OF_CLIP", 2_000_000)  # of a minute, for the part of two seconds
    rng = np.random.default_rng(0)
    clip = full_clip(50, 5)
    noise = rng.integers(0, 255, (75, 120, 3), np.uint8).repeat(8, 0).repeat(8, 1)
    for name in clip.rig.names:
        write_video(tmp_path / "rgb" / f"{name}.mp4", (np.roll(noise, 9 * i, 1) for i in range(50)), 25)
    videos, _ = small_videos(replace(clip, images=Images(tmp_path, clip.rig.names, tuple(range(50)), ("rgb",))))
    assert sum(map(len, videos)) < MINUTE_BYTES * 3 / 60


def test_arrays_of_five_cameras_and_four_people_fit_their_share_of_the_page():
    rng = np.random.default_rng(0)
    clip = full_clip(100, 5)
    noisy = clip.truth.xyz + rng.normal(0, 0.01, clip.truth.xyz.shape)
    xy = clip.detections.xy + rng.normal(0, 2, clip.detections.xy.shape)
    clip = replace(
        clip,
        poses=replace(clip.truth, xyz=noisy, cov=np.broadcast_to(1e-4 * np.eye(3), (*noisy.shape, 3))),
        detections=replace(clip.detections, xy=xy),
    )
    data = player_data(clip)
    size = len(data["poses"]["xyz"]) + len(data["poses"]["spread"]) + len(data["detections"]["xy"])
    assert 2 * size < MINUTE_BYTES * 4 / 60 / 3  # two people here; a third of the page is for arrays
