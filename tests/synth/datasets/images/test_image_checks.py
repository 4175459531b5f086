"""Damaged pictures, videos and their labels are found and named."""

import shutil
from dataclasses import replace

import cv2
import numpy as np
import pytest

from dmae.data.images import write_ids, write_parts, write_video
from dmae.data.store import load_clip, save_clip
from synth.datasets.verify import verify
from tests.support.verified_sets import CLIP, changed, only

pytestmark = pytest.mark.filterwarnings("ignore:no OpenGL")


def test_missing_broken_and_wrongly_sized_images_are_found(data):
    ids = data / CLIP / "images" / "ids" / "ring0" / "000002.png"
    depth = data / CLIP / "images" / "depth" / "ring1" / "000001.png"
    rgb = data / CLIP / "images" / "rgb" / "ring1.mp4"
    whole = ids.read_bytes()
    for broken in (None, b"", whole[: len(whole) // 2]):
        ids.unlink() if broken is None else ids.write_bytes(broken)
        # What is left of a PNG may still be decoded; then its pixels are not those that were counted.
        only(data, "images", "ring0")
    ids.write_bytes(whole)
    cv2.imwrite(str(depth), np.zeros((10, 20), np.uint16))
    only(data, "images", "depth of camera ring1: expected 192 x 144 px, found 20 x 10")
    write_video(rgb, np.zeros((3, 144, 192, 3), np.uint8), 25)
    only(data, "images", "expected 5 frames", "found 3")
    rgb.write_bytes(b"no video")
    only(data, "images", "rgb of camera ring1")


def test_ids_inconsistent_with_the_labels_are_found(data):
    clip = load_clip(data / CLIP)
    path = data / CLIP / "images" / "ids" / "ring0" / "000002.png"
    ids = list(clip.images.read("ids", "ring0"))[2]
    for wrong, word in ((77, "stand for no person"), (0, "pixels show the persons")):
        write_ids(path, np.where(ids == 1, wrong, ids))
        only(data, "images", word)
    write_ids(path, ids)
    # A wall that no label knows, and no counts of pixels.
    for view in clip.rig.names:
        for frame in range(5):
            write_ids(data / CLIP / "images" / "ids" / view / f"{frame:06d}.png", np.full_like(ids, 256))
            write_parts(data / CLIP / "images" / "parts" / view / f"{frame:06d}.png", np.zeros_like(ids))
    bare = replace(load_clip(data / CLIP).occlusion, visible_pixels=None, amodal_pixels=None)
    changed(data, occlusion=bare)
    only(data, "images", "less than 99%")


def test_parts_without_a_person_or_a_name_are_found(data):
    clip = load_clip(data / CLIP)
    path = data / CLIP / "images" / "parts" / "ring0" / "000002.png"
    parts = list(clip.images.read("parts", "ring0"))[2]
    for wrong, word in (
        (np.where(parts == 3, 99, parts), "99 is none of the 16 parts"),
        (np.where(parts == 3, 0, parts), f"{np.count_nonzero(parts == 3)} pixels have a part but no person"),
        (np.maximum(parts, 1), "or a person but no part"),
    ):
        write_parts(path, wrong)
        only(data, "images", "parts of camera ring0, frame 2", word)


def test_surplus_images_are_found_unless_they_belong_to_another_clip(data, tmp_path):
    whole, images = load_clip(data / CLIP), data / CLIP / "images"
    some = whole.select([1, 3])
    save_clip(some, tmp_path / "some")
    assert verify(tmp_path / "some")[1] == []
    shutil.copy(images / "ids" / "ring0" / "000004.png", images / "ids" / "ring0" / "000005.png")
    only(data, "images", "image files that do not belong to the clip: 1, first ids/ring0/000005.png")
    (images / "ids" / "ring0" / "000005.png").unlink()
    shutil.copytree(images / "parts" / "ring0", images / "parts" / "ring7")
    only(data, "images", "image files that do not belong to the clip: 5, first parts/ring7/000000.png")
    shutil.rmtree(images / "parts" / "ring7")
    write_video(images / "rgb" / "ring1.mp4", np.zeros((7, 144, 192, 3), np.uint8), 25)
    only(data, "images", "rgb/ring1.mp4: expected 5 frames, found 7")


def test_frames_of_one_colour_are_found(data):
    write_video(data / CLIP / "images/rgb/ring1.mp4", np.zeros((5, 144, 192, 3), np.uint8), 25)
    only(data, "images", "rgb of camera ring1: 5 frames of one colour, first 0")
