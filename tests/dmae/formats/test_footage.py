"""Images of a recording in a folder for each camera; time offsets by the names of cameras."""

import os

import cv2
import numpy as np
import pytest
from PIL import Image

import dmae
from dmae.data.images import write_image, write_video
from dmae.data.skeleton import BODY25
from dmae.formats.recordings import offsets_of_all
from tests.support.recordings import recording, write_openpose_recording


def write_images(folder, frames: range, cameras: int = 4, size: tuple[int, int] = (600, 960), name="f{}.png"):
    """Images in which every camera has its own grey, and every frame is a little lighter."""
    for camera in range(cameras):
        for frame in frames:
            grey = np.full((*size, 3), 40 * camera + 3 * frame, np.uint8)
            write_image("rgb", folder / f"cam{camera}" / name.format(frame), grey)
    return str(folder)


def write_videos(folder, frames: range, cameras: int = 4, size: tuple[int, int] = (600, 960), name="cam{}.mp4"):
    """Videos of the same images; their first frame is number 0."""
    for camera in range(cameras):
        grey = [np.full((*size, 3), 40 * camera + 3 * frame, np.uint8) for frame in range(frames.stop)]
        write_video(folder / name.format(camera), grey, 25)
    return str(folder)


KINDS = {"images": write_images, "videos": write_videos}


@pytest.mark.parametrize("kind", KINDS)
def test_images_are_those_of_the_frame_and_camera(tmp_path, kind):
    write_openpose_recording(recording(BODY25, 4), tmp_path / "rec", first=8)
    footage = {kind: KINDS[kind](tmp_path / "footage", range(7, 14))}
    clip = dmae.read(tmp_path / "rec", fps=25, cameras=["cam3", "cam1"], frames=[1, 3], **footage)
    assert clip.provenance["notes"] == ["data.cameras: 2 of 4 cameras: cam3, cam1"]
    for view, camera in enumerate((3, 1)):
        # f9 comes before f10: by number, not by letter. The first frame is number 9 of the recording.
        grey = clip.images.at("rgb", clip.rig.names[view], 1).mean()
        assert grey == pytest.approx(40 * camera + 3 * 10, abs=2 * (kind == "videos"))
    dmae.save(clip, tmp_path / "clip")
    frames = [frame.mean() for frame in dmae.load(tmp_path / "clip").images.read("rgb", "cam1")]
    assert frames == pytest.approx([40 + 3 * 9, 40 + 3 * 10], abs=2 * (kind == "videos"))


@pytest.mark.parametrize("kind", KINDS)
def test_a_clip_of_some_cameras_takes_its_own_of_all_images(tmp_path, kind):
    write_openpose_recording(recording(BODY25, 4), tmp_path / "rec")
    some = dmae.read(tmp_path / "rec", fps=25, cameras=["cam3", "cam1"])
    dmae.save(some, tmp_path / "clip")
    footage = KINDS[kind](tmp_path / "footage", range(4))
    clip = dmae.read(tmp_path / "clip", **{kind: footage})
    for view, camera in enumerate((3, 1)):
        assert clip.images.at("rgb", clip.rig.names[view], 2).mean() == pytest.approx(40 * camera + 6, abs=2)
    names = {"images": "cam0", "videos": "cam0.mp4"}
    (tmp_path / "footage" / names[kind]).rename(tmp_path / "footage" / f"x{names[kind]}")
    with pytest.raises(ValueError, match=rf"camera that has {kind}, found .*: xcam0 .*{kind}=\.\.\."):
        dmae.read(tmp_path / "rec", fps=25, **{kind: footage})


def test_images_without_the_numbers_of_the_frames_are_noted(tmp_path):
    write_openpose_recording(recording(BODY25, 4), tmp_path / "rec", first=100)
    images = write_images(tmp_path / "images", range(4), size=(300, 480), name="p{}.jpg")
    clip = dmae.read(tmp_path / "rec", fps=25, images=images)
    assert any("the first of the 4 images is assumed to be frame 100" in note for note in clip.provenance["notes"])
    assert "cam0: images are 0.5000 times the size of the calibration; this is undone" in clip.provenance["notes"]


def test_black_borders_are_cut_off_as_dmae_run_does(tmp_path):
    write_openpose_recording(recording(BODY25, 4), tmp_path / "rec")
    width, height = recording(BODY25, 4).rig.size[0]
    framed = np.zeros((height // 2, width // 2 + 100, 3), np.uint8)
    framed[:, 50:-50] = 200
    (tmp_path / "videos").mkdir()
    for camera in range(4):
        write_video(tmp_path / f"videos/cam{camera}.mp4", [framed] * 4, 25)
        for frame in range(4):
            write_image("rgb", tmp_path / f"images/cam{camera}/f{frame}.png", framed)
    for given in ({"videos": str(tmp_path / "videos")}, {"images": str(tmp_path / "images")}):
        clip = dmae.read(tmp_path / "rec", fps=25, **given)
        assert any("black border of 50 px at the sides; this is undone" in note for note in clip.provenance["notes"])
        dmae.save(clip, tmp_path / "clip")
        clip = dmae.load(tmp_path / "clip").select(views=[2, 1])
        for image in (clip.images.at("rgb", "cam2", 1), next(clip.images.read("rgb", "cam1"))):
            assert image.shape == (height // 2, width // 2, 3) and image[:, 3:-3].min() > 180


def test_images_of_another_shape_are_stretched_and_noted(tmp_path):
    write_openpose_recording(recording(BODY25, 4), tmp_path / "rec")
    clip = dmae.read(tmp_path / "rec", fps=25, images=write_images(tmp_path / "images", range(4), size=(900, 300)))
    assert any("300 x 900 px, the calibration says" in note for note in clip.provenance["notes"])
    assert clip.images.at("rgb", "cam3", 0).shape == (900, 300, 3)


@pytest.mark.parametrize(
    ("kind", "nothing", "few"),
    [
        ("images", "expected a folder of PNG or JPEG files for each camera", "cam0: expected 4 images or more"),
        ("videos", "expected a video for each camera", r"cam0\.mp4: expected 4 frames or more"),
    ],
)
def test_what_lacks_images_is_refused_by_name(tmp_path, kind, nothing, few):
    write_openpose_recording(recording(BODY25, 4), tmp_path / "rec")
    (tmp_path / "none").mkdir()
    with pytest.raises(FileNotFoundError, match=nothing):
        dmae.read(tmp_path / "rec", fps=25, **{kind: str(tmp_path / "none")})
    with pytest.raises(ValueError, match="found none of cam3"):
        dmae.read(tmp_path / "rec", fps=25, **{kind: KINDS[kind](tmp_path / "three", range(4), cameras=3)})
    with pytest.raises(ValueError, match=f"{few}, [^,]+, found 2"):
        dmae.read(tmp_path / "rec", fps=25, **{kind: KINDS[kind](tmp_path / "few", range(2))})
    with pytest.raises(ValueError, match="expected one of them"):
        dmae.read(tmp_path / "rec", fps=25, images="a", videos="b")


def test_images_may_be_added_after_they_were_read(tmp_path):
    write_openpose_recording(recording(BODY25, 4), tmp_path / "rec")
    for count in (2, 4):
        images = write_images(tmp_path / "images", range(count))
        for folder in (tmp_path / "images").iterdir():
            os.utime(folder, (count, count))
        if count == 2:
            with pytest.raises(ValueError, match="found 2"):
                dmae.read(tmp_path / "rec", fps=25, images=images)
    assert dmae.read(tmp_path / "rec", fps=25, images=images).images.at("rgb", "cam0", 3).mean() == 9


@pytest.mark.parametrize("ending", ["mp4", "mkv"])
def test_videos_that_begin_with_the_clip_or_have_another_size_are_noted(tmp_path, ending):
    """Matroska files do not state their number of frames."""
    write_openpose_recording(recording(BODY25, 4), tmp_path / "rec", first=100)
    videos = write_videos(tmp_path / "videos", range(4), size=(600, 952), name=f"Cam_{{}}.{ending}")
    clip = dmae.read(tmp_path / "rec", fps=25, videos=videos)
    notes = clip.provenance["notes"]
    assert "the first frame of the videos is assumed to be frame 100, as they have 4 frames" in notes
    assert any("has images of 952 x 600 px, the calibration says 960 x 600; they are" in note for note in notes)
    assert clip.images.at("rgb", "cam0", 2).mean() == pytest.approx(6, abs=2)


def test_offsets_are_given_in_order_or_by_name(tmp_path):
    names = ("left", "right", "top:1")
    assert offsets_of_all("data.offsets", [0, 2, -1], names) == [0, 2, -1]
    assert offsets_of_all("data.offsets", ["right:-3", "top:1:+2"], names) == [0, -3, 2]
    assert offsets_of_all("data.offsets", ["Right:1"], names) == [0, 1, 0]
    assert offsets_of_all("data.offsets", None, names) is None
    for wrong in (["left"], ["middle:3"], ["left:1.5"], ["left:1", "left:2"], [1, "left:2"]):
        with pytest.raises(ValueError, match="expected a number for each camera, or entries as left:3"):
            offsets_of_all("data.offsets", wrong, names)
    write_openpose_recording(recording(BODY25, 4), tmp_path / "rec")
    by_name, in_order = (dmae.read(tmp_path / "rec", fps=25, offsets=each) for each in (["cam2:1"], [0, 0, 1, 0]))
    np.testing.assert_array_equal(by_name.detections.xy, in_order.detections.xy)
    assert by_name.provenance["offsets"] == [0, 0, 1, 0]


@pytest.mark.parametrize("kind", KINDS)
def test_images_are_shown_as_phones_say_that_they_were_taken(tmp_path, kind):
    """The camera hung upside down: its files hold turned images, and say so."""
    write_openpose_recording(recording(BODY25, 4), tmp_path / "rec")
    picture = np.zeros((600, 960, 3), np.uint8)
    picture[:300] = 200
    for camera in range(4):
        if kind == "videos":
            path = tmp_path / f"videos/cam{camera}.mp4"
            write_video(path, [picture[::-1]] * 4, 25)
            data, one, turned = path.read_bytes(), b"\0\1\0\0", b"\xff\xff\0\0"
            begin = data.index(one + bytes(12) + one, data.index(b"tkhd"))
            path.write_bytes(data[:begin] + turned + bytes(12) + turned + data[begin + 20 :])
        else:
            exif = Image.Exif()
            exif[0x0112] = 3
            for frame in range(4):
                path = tmp_path / f"images/cam{camera}/{frame}.jpg"
                path.parent.mkdir(parents=True, exist_ok=True)
                Image.fromarray(picture[::-1]).save(path, exif=exif)
    clip = dmae.read(tmp_path / "rec", fps=25, **{kind: str(tmp_path / kind)})
    for image in (clip.images.at("rgb", "cam0", 1), next(clip.images.read("rgb", "cam0"))):
        assert image[100].mean() == pytest.approx(200, abs=3)
        assert image[500].mean() == pytest.approx(0, abs=3)


def test_images_of_monochrome_cameras_are_read(tmp_path):
    write_openpose_recording(recording(BODY25, 4), tmp_path / "rec")
    for camera in range(4):
        (tmp_path / f"images/cam{camera}").mkdir(parents=True)
        for frame in range(4):
            cv2.imwrite(str(tmp_path / f"images/cam{camera}/{frame}.png"), np.full((600, 960), 7, np.uint8))
    clip = dmae.read(tmp_path / "rec", fps=25, images=str(tmp_path / "images"))
    assert clip.images.at("rgb", "cam0", 1).shape == (600, 960, 3)
