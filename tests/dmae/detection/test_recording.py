"""Videos that belong together: sizes, rates, offsets, damaged ones."""

from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest

from dmae.data.images import write_image, write_video
from dmae.detection.images import CameraImages, align, find_cameras
from dmae.detection.recording import open_recording
from dmae.formats.footage import fit_images, with_videos
from tests.support.clips import full_clip, looking_at_origin


def shades(count: int, size: tuple[int, int] = (64, 48)) -> list[np.ndarray]:
    """Images that grow lighter: the number of each can be read from it."""
    return [np.full((size[1], size[0], 3), 10 + 5 * number, np.uint8) for number in range(count)]


def camera(name: str, times, rate: float | None, timecode: str | None = None) -> CameraImages:
    return CameraImages(name, Path(name), (64, 48), np.asarray(times, float), rate, None, "h264", timecode)


def test_a_video_is_read_from_any_image_on(tmp_path: Path):
    write_video(tmp_path / "a.mp4", shades(40), 10)
    (found,) = find_cameras(tmp_path)
    assert (found.name, len(found), found.size, round(found.rate, 3)) == ("a", 40, (64, 48), 10)
    read = [image.mean() for image in found.read(23, 27)]
    np.testing.assert_allclose(read, [10 + 5 * number for number in range(23, 27)], atol=3)


def test_damaged_images_are_none_and_the_others_read(tmp_path: Path):
    for number, image in enumerate(shades(4)):
        write_image("rgb", tmp_path / "a" / f"a_{number + 7:04d}.png", image)
    (tmp_path / "a" / "a_0008.png").write_bytes(b"\x89PNG nothing")
    (found,) = find_cameras(tmp_path)
    assert [image is None for image in found.read(0, 4)] == [False, True, False, False]
    assert found.times.tolist() == [7, 8, 9, 10]


def test_a_damaged_video_loses_frames_alone(tmp_path: Path):
    write_video(
        tmp_path / "a.mp4", [np.random.default_rng(i).integers(0, 255, (48, 64, 3), np.uint8) for i in range(30)], 10
    )
    data = bytearray((tmp_path / "a.mp4").read_bytes())
    middle = len(data) // 2
    data[middle : middle + 200] = bytes(200)
    (tmp_path / "a.mp4").write_bytes(data)
    (found,) = find_cameras(tmp_path)
    read = list(found.read(0, len(found)))
    assert len(read) == 30
    assert sum(image is not None for image in read) >= 10


@pytest.mark.parametrize(("suffix", "other"), [("mkv", "mp4"), ("mp4", "mkv")])
def test_a_video_whose_times_are_all_0_says_how_to_give_it_times(tmp_path: Path, suffix, other):
    with av.open(str(tmp_path / "a.mkv"), "w") as container:
        stream = container.add_stream("mjpeg", rate=25)
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuvj420p"
        for image in [*map(av.VideoFrame.from_ndarray, shades(8)), None]:
            for packet in stream.encode(image):
                packet.pts = packet.dts = 0
                container.mux(packet)
    (tmp_path / "a.mkv").rename(tmp_path / f"a.{suffix}")
    remedy = rf"a\.{suffix}: its 8 images have no times .*ffmpeg -r 25 -i a\.{suffix} .*a\.{other}"
    with pytest.raises(ValueError, match=remedy):
        find_cameras(tmp_path)


def test_a_raw_stream_says_how_to_give_it_times(tmp_path: Path):
    clip = full_clip()
    for name in clip.rig.names:
        with av.open(str(tmp_path / f"{name}.h264"), "w", format="h264") as container:
            stream = container.add_stream("libx264", rate=25)
            stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
            for image in [*map(av.VideoFrame.from_ndarray, shades(8)), None]:
                container.mux(stream.encode(image))
    remedy = rf"{clip.rig.names[0]}\.h264: its 8 images have no times .*ffmpeg -r 25 -i {clip.rig.names[0]}\.h264"
    with pytest.raises(ValueError, match=remedy):
        find_cameras(tmp_path)
    with pytest.raises(ValueError, match=remedy):
        with_videos(clip, tmp_path)


def test_the_first_frames_of_videos_and_those_in_the_middle(tmp_path: Path):
    rig = looking_at_origin(3)
    size = tuple(map(int, rig.size[0]))
    for name, count in zip(rig.names, (20, 20, 6), strict=True):
        write_video(tmp_path / f"{name}.mp4", shades(count, size), 10)
    found = open_recording(tmp_path, rig, offsets=[0, 2, 0], frames=[5, 9])
    assert (found.first, found.alignment.count) == (5, 4)
    assert [each.tolist() for each in found.alignment.frames] == [[0, 1, 2, 3], [0, 1, 2, 3], [0]]
    for camera, first in zip(found.cameras, (5, 3, 5), strict=True):
        shown = [image.mean() for image in camera.read(0, len(camera))]
        np.testing.assert_allclose(shown, [10 + 5 * (first + number) for number in range(len(camera))], atol=3)
    empty = open_recording(tmp_path, rig, frames=[10, 12])
    assert [len(camera) for camera in empty.cameras] == [2, 2, 0]
    with pytest.raises(ValueError, match=r"frames=\[0, 99\]: expected \[first, end\] within the 20 frames"):
        open_recording(tmp_path, rig, frames=[0, 99])


@pytest.mark.parametrize("files", [[], ["notes.txt"]])
def test_no_videos(tmp_path: Path, files):
    for name in files:
        (tmp_path / name).write_text("x")
    with pytest.raises(FileNotFoundError, match="expected for each camera a video"):
        find_cameras(tmp_path)


@pytest.mark.parametrize("inside", ["a.mp4", "a/000.png"])
def test_a_session_is_answered_with_its_folder_of_videos(tmp_path: Path, inside):
    (tmp_path / "videos" / inside).parent.mkdir(parents=True)
    (tmp_path / "videos" / inside).touch()
    with pytest.raises(FileNotFoundError, match=r"name that, as videos=.*/videos$"):
        find_cameras(tmp_path)


def test_a_file_that_is_no_video(tmp_path: Path):
    (tmp_path / "a.mp4").write_bytes(b"nothing" * 100)
    with pytest.raises(ValueError, match=r"a\.mp4: expected a video, found Invalid data"):
        find_cameras(tmp_path)


def test_other_rates_and_ends():
    found = align([camera("a", np.arange(20) / 20, 20), camera("b", np.arange(8) / 10, 10)], None, None)
    assert (found.fps, found.count) == (20, 20)
    assert found.frames[1].tolist() == [0, 2, 4, 6, 8, 10, 12, 14]
    assert "frame rates differ (a 20, b 10)" in found.notes[0] and "a 20, b 15" in found.notes[1]


def test_dropped_images_leave_gaps_at_the_rate_that_is_given():
    kept = np.delete(np.arange(30), [10, 11, 20])
    dropping, whole = camera("a", kept / 30, 30), camera("b", np.arange(30) / 30, 30)
    for fps in (30, 120):  # By the clock of the files, or played in slow motion
        found = align([dropping, whole], fps, None)
        assert (found.fps, found.frames[0].tolist(), found.notes) == (fps, kept.tolist(), ())
    rounded = camera("a", np.round(kept / 30, 3), 30)
    assert align([rounded], 30, None).frames[0].tolist() == kept.tolist()
    # Times of arrival do not count frames.
    bursts = camera("a", np.repeat(np.arange(10) / 10, 3) + np.tile([0, 0.005, 0.06], 10), 30)
    assert align([bursts], 30, None).frames[0].tolist() == [*range(30)]


def test_the_rate_of_a_video_does_not_count_what_was_dropped(tmp_path: Path):
    kept, base = np.delete(np.arange(30), [10, 11, 20]), Fraction(1, 30)
    with av.open(str(tmp_path / "a.mp4"), "w") as container:
        stream = container.add_stream("libx264", rate=30)
        stream.width, stream.height, stream.codec_context.time_base = 64, 48, base
        for number, image in zip(kept.tolist(), shades(len(kept)), strict=True):
            frame = av.VideoFrame.from_ndarray(image, format="rgb24")
            frame.pts, frame.time_base = number, base
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    (found,) = find_cameras(tmp_path)
    assert found.rate == 30
    assert align([found], None, None).frames[0].tolist() == kept.tolist()


def test_offsets_by_option_timecode_and_first_time():
    two = [camera("a", np.arange(9) / 10, 10), camera("b", np.arange(9) / 10, 10)]
    assert align(two, None, [0, 2]).frames[1][0] == 2
    assert align(two, None, [0, -2]).frames[0][0] == 2
    codes = [camera("a", np.arange(9) / 10, 10, "01:00:00:05"), camera("b", np.arange(9) / 10, 10, "01:00:00:02")]
    assert [frames[0] for frames in align(codes, None, None).frames] == [3, 0]
    # The last part counts the frames of its own video: 15 of 30 a second are half a second.
    mixed = [camera("a", np.arange(90) / 30, 30, "01:00:00:15"), camera("b", np.arange(180) / 60, 60, "01:00:00:00")]
    assert [frames[0] for frames in align(mixed, None, None).frames] == [30, 0]
    apart = [camera("a", np.arange(9) / 10, 10, "01:00:00:05"), camera("b", np.arange(9) / 10, 10, "02:00:00:02")]
    assert [frames[0] for frames in align(apart, None, None).frames] == [0, 0]
    late = [camera("a", np.arange(9) / 10, 10), camera("b", 0.3 + np.arange(9) / 10, 10)]
    assert [frames[0] for frames in align(late, None, None).frames] == [0, 3]
    with pytest.raises(ValueError, match=r"offsets=.*one for each of the 2 cameras"):
        align(two, None, [1])


def test_images_without_a_rate_ask_for_it():
    images = [camera("a", [3, 4, 6], None), camera("b", [2, 3, 4], None)]
    with pytest.raises(ValueError, match="fps="):
        align(images, None, None)
    found = align(images, 30, None)
    assert [frames.tolist() for frames in found.frames] == [[1, 2, 4], [0, 1, 2]]


def test_a_smaller_copy_with_black_borders():
    image = np.full((2, 1920, 1080, 3), 120, np.uint8)
    image[:, :7], image[:, -7:] = 12, 12
    found = fit_images("cam", (1080, 1920), (1088, 1920), image)
    np.testing.assert_allclose(
        found.to_calibration(np.array([100.0, 200.0])),
        ((100.5) * 1088 / 1080 - 0.5, (200.5 - 7.06) * 1088 / 1080 - 0.5),
        atol=0.01,
    )
    with pytest.raises(ValueError, match="1080 x 1920 px, its calibration is for 1088 x 1920"):
        fit_images("cam", (1080, 1920), (1088, 1920), np.full((2, 1920, 1080, 3), 120, np.uint8))


def test_half_the_size_and_turned():
    found = fit_images("cam", (960, 540), (1920, 1080), np.empty((0, 1, 1, 3)))
    np.testing.assert_allclose(found.to_calibration(np.array([0.0, 0.0])), (0.5, 0.5))
    for size in ((1080, 1920), (1080, 1934)):
        with pytest.raises(ValueError, match="turn them by 90 degrees"):
            fit_images("cam", size, (1920, 1080), np.full((1, *size[::-1], 3), 90, np.uint8))


def test_cameras_are_called_as_in_the_calibration(tmp_path: Path):
    rig = replace(looking_at_origin(2), names=("cam_01", "cam_02"))
    width, height = (int(side) // 2 for side in rig.size[0])
    for name in ("cam01", "cam02"):
        write_video(tmp_path / f"{name}.mp4", shades(3, (width, height)), 10)
    assert [note.partition(" times")[0] for note in open_recording(tmp_path, rig).notes if "times" in note] == [
        "cam_01: images are 0.5000",
        "cam_02: images are 0.5000",
    ]


def test_a_video_without_a_calibration_and_one_camera_less(tmp_path: Path):
    rig = looking_at_origin(3)
    width, height = map(int, rig.size[0])
    for name in (*rig.names[:2], "another"):
        write_video(tmp_path / f"{name}.mp4", shades(3, (width, height)), 10)
    with pytest.raises(ValueError, match=r"another has none.*calibration="):
        open_recording(tmp_path, rig)
    (tmp_path / "another.mp4").unlink()
    found = open_recording(tmp_path, rig)
    assert found.rig.names == rig.names[:2]
    assert found.notes[0] == f"1 calibrated camera has no images and is left out: {rig.names[2]}"
