"""Photographs of any size, each detected by itself."""

import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from dmae.data.store import load_clip
from dmae.detection.images import find_cameras
from dmae.detection.recording import detect_photographs, find_photographs
from dmae.detection.registry import PoseDetectorConfig
from dmae.files.images import read_upright, upright_size
from dmae.formats.pose2sim import write_cameras
from tests.support.clips import looking_at_origin
from tests.support.commands import dmae

DETECTOR = '''
import numpy as np
from dmae import get_skeleton

class Brightest:
    """The brightest pixel is the nose of a person. After its first image, the detector finds no people."""
    skeleton = get_skeleton("coco17")
    seen = 0
    def __call__(self, image):
        self.seen += 1
        if image.max() < 100 or self.seen > 1:
            return np.empty((0, 17, 2)), np.empty((0, 17))
        xy = np.full((1, 17, 2), np.nan)
        xy[0, 0] = np.unravel_index(image[..., 1].argmax(), image.shape[:2])[::-1]
        return xy, np.where(np.isnan(xy[..., 0]), np.nan, 0.9)

def brightest(config):
    return Brightest()
'''


def image(width: int, height: int, x: int, y: int) -> Image.Image:
    pixels = np.zeros((height, width, 3), np.uint8)
    pixels[y, x] = 255
    return Image.fromarray(pixels)


@pytest.fixture
def photographs(tmp_path: Path) -> Path:
    folder = tmp_path / "photographs"
    folder.mkdir()
    (tmp_path / "my_brightest.py").write_text(DETECTOR)
    image(64, 48, 10, 20).save(folder / "a.png")
    exif = Image.Exif()
    # The camera was turned by a quarter: column 12 of row 30 is shown at column 25 of row 12 of an image 56 px wide.
    exif[0x0112] = 6
    image(80, 56, 12, 30).save(folder / "b.webp", lossless=True, exif=exif)
    image(40, 40, 5, 6).convert("L").save(folder / "c.bmp")
    image(30, 20, 0, 0).point(lambda _: 0).save(folder / "dark.tif")
    (folder / "notes.txt").write_text("not a photograph")
    (folder / "z.jpg").write_bytes(b"damaged")
    return folder


def test_images_are_upright(photographs: Path):
    assert upright_size(photographs / "b.webp") == (56, 80)
    upright = read_upright(photographs / "b.webp")
    assert upright.shape == (80, 56, 3)
    assert np.unravel_index(upright[..., 1].argmax(), (80, 56)) == (12, 25)


@pytest.mark.parametrize("mode", ["L", "RGBA", "P", "I;16", "CMYK", "LA"])
def test_images_of_any_mode_are_read_as_rgb(tmp_path: Path, mode: str):
    pixels = np.full((6, 8), 200, np.uint8)
    made = Image.fromarray(pixels.astype(np.uint16) << 8) if mode == "I;16" else Image.fromarray(pixels).convert(mode)
    made.save(tmp_path / "a.tif" if mode == "CMYK" else tmp_path / "a.png")
    read = read_upright(next(tmp_path.glob("a.*")))
    assert (read.shape, read.dtype) == ((6, 8, 3), np.uint8)
    np.testing.assert_allclose(read, 200, atol=2)


@pytest.mark.parametrize(("count", "text"), [(6, "dark_4.png, dark_5.png"), (10, "dark_7.png and 2 more")])
def test_photographs_without_people_are_listed(tmp_path: Path, monkeypatch, count: int, text: str):
    (tmp_path / "my_brightest.py").write_text(DETECTOR)
    monkeypatch.syspath_prepend(tmp_path)
    for number in range(count):
        Image.new("RGB", (8, 6)).save(tmp_path / f"dark_{number}.png")
    config = PoseDetectorConfig(name="my_brightest:brightest")
    _, (note,) = detect_photographs(find_photographs(tmp_path)[0], config, tmp_path / "pieces")
    assert note.startswith(f"no people detected in {count} photographs: dark_0.png, ") and note.endswith(text)


def test_keypoints_and_drawings_of_each_photograph_are_written(photographs: Path, tmp_path: Path):
    done = dmae(tmp_path, "detect", "photos=photographs", "detector=my_brightest:brightest", "out=found")
    assert done.returncode == 0, done.stderr
    assert "found: 4 photographs, 3 people, coco17" in done.stdout
    assert "no people detected in 1 photograph: dark.tif" in done.stdout
    assert "left out: photographs/z.jpg: expected a PNG, JPEG, BMP, WebP or TIFF image" in done.stdout
    noses = {}
    for file in sorted((tmp_path / "found").glob("*_keypoints.json")):
        people = json.loads(file.read_text())["people"]
        noses[file.name] = [person["pose_keypoints_2d"][:2] for person in people]
    assert noses == {
        "a_keypoints.json": [[10, 20]],
        "b_keypoints.json": [[25, 12]],
        "c_keypoints.json": [[5, 6]],
        "dark_keypoints.json": [],
    }
    drawn = cv2.imread(str(tmp_path / "found/drawn/b.jpg"))
    assert drawn.shape == (80, 56, 3)
    assert drawn[12, 25].max() > 100
    assert not (tmp_path / "found/pieces").exists()


def test_one_file_of_coco_holds_all_photographs(photographs: Path, tmp_path: Path):
    options = ("detector=my_brightest:brightest", "output.format=coco", "output.images=false", "workers=2")
    done = dmae(tmp_path, "detect", "photos=photographs", *options, "out=found")
    assert done.returncode == 0, done.stderr
    written = json.loads((tmp_path / "found/keypoints.json").read_text())
    images = {each["id"]: each for each in written["images"]}
    assert [(each["file_name"], each["width"], each["height"]) for each in images.values()] == [
        ("a.png", 64, 48),
        ("b.webp", 56, 80),
        ("c.bmp", 40, 40),
        ("dark.tif", 30, 20),
    ]
    found = {images[each["image_id"]]["file_name"]: each["keypoints"][:2] for each in written["annotations"]}
    assert found == {"a.png": [10, 20], "b.webp": [25, 12], "c.bmp": [5, 6]}
    assert not (tmp_path / "found/drawn").exists()


def test_a_single_photograph(photographs: Path, tmp_path: Path):
    done = dmae(tmp_path, "detect", "photos=photographs/a.png", "detector=my_brightest:brightest", "out=found")
    assert "found: 1 photograph, 1 person, coco17" in done.stdout


def test_photographs_that_cannot_be_used(photographs: Path, tmp_path: Path):
    with pytest.raises(FileNotFoundError, match="no such folder"):
        find_photographs(tmp_path / "nowhere")
    (tmp_path / "empty").mkdir()
    with pytest.raises(FileNotFoundError, match="expected photographs"):
        find_photographs(tmp_path / "empty")
    (tmp_path / "empty/z.jpg").write_bytes(b"damaged")
    with pytest.raises(ValueError, match=r"not one photograph can be read; .*z\.jpg"):
        find_photographs(tmp_path / "empty")
    image(8, 8, 1, 1).save(photographs / "a.jpg")
    with pytest.raises(ValueError, match=r"different names, found a\.jpg, a\.png"):
        find_photographs(photographs)


def test_photographs_given_as_videos_are_answered_with_the_option(photographs: Path):
    with pytest.raises(ValueError, match=r"one size; a\.png has 64 x 48 px, b\.webp 56 x 80\. .* photos="):
        find_cameras(photographs)


def test_a_truncated_photograph_is_left_out(tmp_path: Path):
    Image.fromarray(np.random.default_rng(0).integers(0, 255, (80, 80, 3), np.uint8)).save(tmp_path / "a.png")
    whole = (tmp_path / "a.png").read_bytes()
    (tmp_path / "a.png").write_bytes(whole[: len(whole) // 2])
    (camera,), _ = find_photographs(tmp_path)
    assert list(camera.read(0, 1)) == [None]


@pytest.mark.parametrize("layout", ["{set}/{camera}.png", "{set}/_{camera}.png", "{camera}/{set}.png"])
def test_photographs_in_sets_are_stills(tmp_path: Path, layout: str):
    """Sets 3, 90 and 5000; the right camera has no photograph of the second."""
    (tmp_path / "my_brightest.py").write_text(DETECTOR)
    rig = looking_at_origin(2)
    rig = replace(rig, names=("left", "right"), size=np.tile([64, 48], (2, 1)))
    write_cameras(rig, tmp_path / "rig.toml")
    noses = {("left", 3): (10, 20), ("right", 3): (5, 6), ("left", 90): (30, 31), ("left", 5000): (2, 2)}
    noses["right", 5000] = (60, 40)
    for (camera, number), nose in noses.items():
        file = tmp_path / "sets" / layout.format(camera=camera, set=number)
        file.parent.mkdir(parents=True, exist_ok=True)
        image(64, 48, *nose).save(file)
    clip_of = ("calibration=rig.toml", "detector=my_brightest:brightest", "out=found")
    done = dmae(tmp_path, "detect", "photos=sets", *clip_of)
    assert done.returncode == 0, done.stderr
    assert "3 sets of photographs" in done.stdout
    clip = load_clip(tmp_path / "found")
    assert (clip.fps, len(clip), clip.rig.names) == (0.1, 3, ("left", "right"))
    found = {
        (clip.rig.names[view], [3, 90, 5000][frame]): tuple(clip.detections.xy[frame, view, person, 0])
        for frame, view, person in np.argwhere(~np.isnan(clip.detections.score[..., 0]))
    }
    assert found == noses
    assert np.asarray(clip.images.at("rgb", "left", 2)).shape == (48, 64, 3)
    done = dmae(tmp_path, "detect", "photos=sets", "frames=[1,3]", *clip_of[:-1], "out=last")
    assert done.returncode == 0, done.stderr
    last = load_clip(tmp_path / "last")
    np.testing.assert_array_equal(last.detections.xy[:, :, 0, 0], clip.detections.xy[1:, :, 0, 0])
    done = dmae(tmp_path, "detect", "photos=sets", "fps=25", *clip_of[:-1], "out=other")
    assert done.returncode == 1
    assert "fps=25: photos=... are stills, less than 1 a second" in done.stderr
