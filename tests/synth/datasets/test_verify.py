"""Verification: a data set without faults has no findings, and every damage that is planted is found and named."""

import json
import re
import shutil
from dataclasses import replace

import cv2
import numpy as np
import pytest

from dmae.data.clip import Detections2D, Poses3D
from dmae.data.images import write_image, write_video
from dmae.data.labels import DetectionLabels, JointError, Visibility
from dmae.data.store import load_clip, read_manifest, save_clip, write_manifest
from dmae.files.checksums import number_of
from dmae.files.structured import read_json
from dmae.formats.reading import select_frames, select_views
from synth.commands import verify as command
from synth.commands.config import VerifyCommand
from synth.datasets.verify import CHECKS, _check_line, verify
from tests.support.clips import full_clip
from tests.support.verified_sets import CLIP, changed, found, only

pytestmark = pytest.mark.filterwarnings("ignore:no OpenGL")


def test_a_new_data_set_has_no_problems(sound):
    for fast in (False, True):
        assert verify(sound, fast=fast) == (["000000", "000001"], [], [], number_of(sound), [])
    assert verify(sound / CLIP) == ([CLIP], [], [], number_of(sound / CLIP), [])


def test_clips_without_checksums_are_named(data):
    assert verify(data) == (["000000", "000001"], [], [], None, ["000000", "000001"])


def test_a_clip_without_labels_passes(sound, tmp_path):
    clip = load_clip(sound / CLIP)
    bare = replace(clip, truth=None, images=None, occlusion=None, detection_labels=None)
    save_clip(bare, tmp_path / "bare")
    assert verify(tmp_path / "bare")[1] == []


@pytest.mark.parametrize(
    "cut",
    [
        lambda clip: clip.select(frames=range(1, 4)),
        lambda clip: select_frames(clip, [1, 4]),
        lambda clip: select_views(select_frames(clip, [1, 4]), clip.rig.names[1:]),
    ],
)
def test_a_data_set_of_clips_that_were_cut_passes(sound, tmp_path, cut):
    for folder in sorted(sound.glob("0*")):
        save_clip(cut(replace(load_clip(folder), images=None)), tmp_path / folder.name)
    write_manifest(tmp_path, [{"id": folder.name, "status": "ok"} for folder in sorted(sound.glob("0*"))])
    assert verify(tmp_path)[1] == []


def test_labels_are_checked_against_the_true_cameras(data):
    """A calibration in error is no damage: the labels are those of the cameras as they were."""
    clip = load_clip(data / CLIP)
    pose = clip.rig.cam_from_world.copy()
    pose[:, :3, 3] += 0.3
    changed(data, rig=replace(clip.rig, cam_from_world=pose), true_rig=clip.rig)
    assert found(data) == []
    changed(data, true_rig=None)
    assert {"detections", "images"} <= {check for _, check, _ in found(data)}


@pytest.mark.parametrize(
    ("damage", "word"),
    [
        (lambda folder: (folder / "arrays.safetensors").unlink(), "arrays.safetensors"),
        (lambda folder: (folder / "clip.json").write_text("{"), "JSON"),
        (lambda folder: shutil.rmtree(folder), "expected a clip folder"),
        (
            lambda folder: (folder / "arrays.safetensors").write_bytes(
                (folder / "arrays.safetensors").read_bytes()[:-1] + b"!"
            ),
            "checksum",
        ),
    ],
)
def test_missing_and_damaged_files_are_found(data, damage, word):
    damage(data / CLIP)
    only(data, "files", word)


def test_arrays_of_other_shapes_are_found(data):
    meta = read_json(data / CLIP / "clip.json")
    meta["cameras"] = meta["cameras"][:1]
    (data / CLIP / "clip.json").write_text(json.dumps(meta))
    only(data, "files", "shape")


def test_impossible_numbers_are_found(data):
    clip = load_clip(data / CLIP)
    xyz, xy, score = clip.truth.xyz.copy(), clip.detections.xy.copy(), clip.detections.score.copy()
    xy[tuple(np.argwhere(clip.detections.observed)[0])] = (np.nan, 3)
    score[np.isnan(xy).any(-1)] = np.nan
    torn = Detections2D(clip.detections.skeleton, xy, score)
    changed(data, detections=torn, detection_labels=DetectionLabels(clip.detection_labels.person))
    only(data, "numbers", "detections.xy: 1 points")
    sure = np.where(clip.detections.observed, np.float32(1.5), np.nan)
    changed(data, detections=replace(clip.detections, score=sure))
    only(data, "numbers", "outside 0..1")
    cov = np.full((*xyz.shape, 3), np.inf)
    with pytest.raises(ValueError, match=r"truth\.cov.* found inf"):
        changed(data, detections=clip.detections, truth=Poses3D(clip.truth.skeleton, xyz, cov=cov))


def first_joint(clip, code) -> tuple:
    """Return the index of the clip's first joint of this visibility."""
    at = np.argwhere(clip.occlusion.visibility == code)
    assert len(at), f"nothing in the clip is {code!r}"
    return tuple(at[0])


def test_inconsistent_labels_are_found(data):
    clip = load_clip(data / CLIP)
    visible, behind_self = first_joint(clip, Visibility.VISIBLE), first_joint(clip, Visibility.HIDDEN_BY_SELF)
    detected, missed = (tuple(np.argwhere(clip.detections.observed == there)[0]) for there in (True, False))
    shown = tuple(np.argwhere(clip.occlusion.visible_pixels > 0)[0])

    for part, name, at, value, words in (
        ("occlusion", "visibility", visible, Visibility.ABSENT, "where the truth is NaN"),
        ("occlusion", "occluder", visible, 0, "occluder does not match"),
        ("occlusion", "occluder", behind_self, 1 - behind_self[2], "occluder does not match"),
        ("occlusion", "occluder", behind_self, -1, "occluder does not match"),
        ("occlusion", "depth_margin", visible, 1.0, "depth_margin is not known"),
        ("occlusion", "depth_margin", behind_self, np.nan, "depth_margin is not known"),
        ("occlusion", "depth_margin", behind_self, -0.5, "depth_margin is not positive"),
        ("occlusion", "amodal_pixels", shown, 0, "visible_pixels exceed"),
        ("detection_labels", "joint_person", missed, 0, "where nothing is detected"),
        ("detection_labels", "error", detected, JointError.ABSENT, "where nothing is detected"),
    ):
        labels = getattr(clip, part)
        array = getattr(labels, name).copy()
        array[at] = value
        changed(data, **{part: replace(labels, **{name: array})})
        only(data, "labels", words)
        changed(data, **{part: labels})
    assert found(data) == []


def test_visibility_inconsistent_with_the_cameras_is_found(data):
    clip = load_clip(data / CLIP)
    for name, code in (("outside", Visibility.OUTSIDE_IMAGE), ("behind", Visibility.BEHIND_CAMERA)):
        codes = clip.occlusion.visibility.copy()
        at = first_joint(clip, Visibility.VISIBLE)
        codes[at] = code
        changed(data, occlusion=replace(clip.occlusion, visibility=codes))
        only(data, "projection", name, f"first in frame {at[0]}, camera {clip.rig.names[at[1]]}, P{at[2] + 1}, joint")
    xyz = clip.truth.xyz + np.float32(50)
    changed(data, occlusion=clip.occlusion, truth=Poses3D(clip.truth.skeleton, xyz))
    assert "projection" in {check for _, check, _ in found(data)}


def test_detections_of_another_person_or_outside_the_image_are_found(data):
    clip = load_clip(data / CLIP)
    labels = replace(clip.detection_labels, offset_px=None)
    exchanged = np.where(labels.person >= 0, 1 - labels.person, labels.person)
    changed(data, detection_labels=replace(labels, person=exchanged))
    only(data, "detections", "far from the person")
    offset = clip.detection_labels.offset_px + np.float32(3)
    changed(data, detection_labels=replace(labels, offset_px=offset))
    only(data, "detections", "offset_px is not the distance")
    xy = clip.detections.xy.copy()
    xy[tuple(np.argwhere(clip.detections.observed)[0])] = (500, 3)
    changed(data, detection_labels=labels, detections=replace(clip.detections, xy=xy))
    only(data, "detections", "1 detected joints lie outside")


def test_a_manifest_inconsistent_with_the_folders_is_found(data):
    lines = read_manifest(data)
    shutil.copytree(data / CLIP, data / "000007")
    assert found(data) == [("data set", "manifest", "000007: a clip that is not ok in manifest.jsonl")]
    shutil.rmtree(data / "000007")
    write_manifest(data, [*lines, lines[0]])
    assert ("data set", "manifest", "manifest.jsonl: clip 000000 is listed twice") in found(data)
    write_manifest(data, [lines[0] | {"frames": 9, "seed": 4}, lines[1]])
    only(data, "manifest", "frames: 9 in manifest.jsonl, 5 in the arrays", "seed: 4")
    write_manifest(data, [*lines, {"id": "000002", "status": "failed"}])
    assert found(data) == [("data set", "manifest", "manifest.jsonl: clip 000002 has status 'failed' and no reason")]
    (data / "manifest.jsonl").write_text("{")
    assert [(check, "line 1" in what) for _, check, what in found(data)] == [("manifest", True)]


def test_clips_of_another_configuration_are_found(data):
    config = read_json(data / "config.json")
    config["scene"]["fps"], config["images"] = 50.0, "rgb"
    (data / "config.json").write_text(json.dumps(config))
    said = {what for _, check, what in found(data) if check == "manifest"}
    assert "fps: 50.0 in config.json, 25.0 in the clip" in said
    assert any(what.startswith("images: rgb in config.json, rgb, depth, ids") for what in said)


def test_a_clip_without_the_images_of_its_data_set_is_answered_with_the_command():
    clip = replace(full_clip(), poses=None, images=None)
    config = {"scene": {"fps": clip.fps}, "images": "all", "seed": 0}
    assert [*_check_line(clip, {"id": clip.id, "status": "ok"}, config)] == [
        "images: rgb, depth, ids, parts, normals, flow, amodal in config.json, none in the clip; "
        "synth generate for all clips makes the others"
    ]


def test_a_clip_of_another_seed_is_found(data):
    config = read_json(data / "config.json")
    (data / "config.json").write_text(json.dumps(config | {"seed": 4}))
    assert {what.partition(":")[0] for _, check, what in found(data) if check == "manifest"} == {"seed"}


@pytest.mark.parametrize("sort", ["clip.json", "config.json", "manifest.jsonl"])
def test_mistyped_keys_are_named_with_their_file(data, sort):
    path = data / CLIP / sort if sort == "clip.json" else data / sort
    text = path.read_text()
    for key in re.findall(r'"(\w+)":', text)[:20]:
        path.write_text(text.replace(f'"{key}":', f'"{key}x":', 1))
        problems = found(data)
        # A clip need not have each of its details; an own file of the data set is compared with its clips.
        assert all(len(problem) == 3 for problem in problems)
        if key in ("id", "cameras", "skeletons", "images", "provenance", "sha256", "seed", "fps", "scene", "status"):
            assert any(sort in what for _, _, what in problems), (key, problems)


def test_the_command_counts_and_fails(data, tmp_path, capsys):
    command.run(VerifyCommand(data=str(data)), tmp_path / "sound.json")
    written = read_json(tmp_path / "sound.json")
    assert (written["clips"], written["problems"], written["number"]) == (["000000", "000001"], [], None)
    printed = capsys.readouterr().out
    assert all(check in printed for check in CHECKS)
    assert "2 of 2 clips have no checksums" in printed
    (data / CLIP / "arrays.safetensors").unlink()
    with pytest.raises(ValueError, match="1 problem in 1 of 2 clips"):
        command.run(VerifyCommand(data=str(data)), tmp_path / "found.json")
    printed = capsys.readouterr().out
    assert "000000: files: " in printed
    assert "to regenerate, with the command that made the data set: 000000\n" in printed
    assert read_json(tmp_path / "found.json")["problems"][0]["check"] == "files"
    with pytest.raises(FileNotFoundError, match="neither"):
        verify(tmp_path)


# Damaged images, videos and their labels are found and named.


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
    only(data, "images", "expected 4 frames or more, found 3")
    rgb.write_bytes(b"no video")
    only(data, "images", "rgb of camera ring1")


def test_ids_inconsistent_with_the_labels_are_found(data):
    clip = load_clip(data / CLIP)
    path = data / CLIP / "images" / "ids" / "ring0" / "000002.png"
    ids = list(clip.images.read("ids", "ring0"))[2]
    for wrong, word in ((77, "stand for no person"), (0, "pixels show the persons")):
        write_image("ids", path, np.where(ids == 1, wrong, ids))
        only(data, "images", word)
    write_image("ids", path, ids)
    # A wall that no label knows, and no counts of pixels.
    for view in clip.rig.names:
        for frame in range(5):
            write_image("ids", data / CLIP / "images" / "ids" / view / f"{frame:06d}.png", np.full_like(ids, 256))
            write_image("parts", data / CLIP / "images" / "parts" / view / f"{frame:06d}.png", np.zeros_like(ids))
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
        write_image("parts", path, wrong)
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
