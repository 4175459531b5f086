"""A full disk: the message names the file, and nothing of it is left."""

import errno
import json
from dataclasses import fields, is_dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from safetensors.numpy import load_file

from dmae.data.clip import Clip, Detections2D, Poses3D, Source
from dmae.data.images import Images
from dmae.data.labels import DetectionLabels, OcclusionLabels
from dmae.data.skeleton import BODY25, SHELF14, get_skeleton
from dmae.data.store import clip_folders, load_clip, read_manifest, save_clip, write_manifest
from dmae.files.contents import write_atomic
from dmae.files.structured import read_json
from tests.support.clips import full_clip, looking_at_origin, walkers

OLD_CLIP = Path(__file__).parents[2] / "data" / "clip_0_1_0"
"""A clip of three frames with all labels, written by version 0.1.0."""


def assert_same(found, want):
    """Equal field by field, arrays bit by bit and in their type."""
    assert type(found) is type(want)
    if is_dataclass(want):
        for field in fields(want):
            assert_same(getattr(found, field.name), getattr(want, field.name))
    elif isinstance(want, np.ndarray):
        assert found.dtype == want.dtype
        np.testing.assert_array_equal(found, want)
    else:
        assert found == want


def test_load_after_save_is_equal(tmp_path):
    clip = full_clip()
    rays = np.random.default_rng(0).normal(size=(12, 2, 25, 2, 3))
    rays[3, 1, 4] = np.nan
    poses = replace(walkers(), source=np.full((12, 2, 25), Source.COMPLETED), views=np.full((12, 2, 25), 3), rays=rays)
    save_clip(replace(clip, poses=poses), tmp_path / "a" / "clip")
    assert_same(load_clip(tmp_path / "a" / "clip"), replace(clip, poses=poses))
    assert load_clip(tmp_path / "a" / "clip") == replace(clip, poses=poses)
    moved = poses.xyz.copy()
    moved[0, 0, 0, 0] += 1
    other = replace(clip, poses=replace(poses, xyz=moved))
    assert other != replace(clip, poses=poses) and other != clip and clip != "clip" and clip in [other, clip]


def test_a_clip_without_labels_is_read(tmp_path):
    clip = replace(full_clip(), occlusion=None, detection_labels=None)
    save_clip(clip, tmp_path)
    assert_same(load_clip(tmp_path), clip)


def test_a_clip_with_some_of_the_labels_is_read(tmp_path):
    clip = full_clip()
    occlusion = OcclusionLabels(clip.occlusion.visibility, objects=("box",))
    clip = replace(clip, occlusion=occlusion, detection_labels=DetectionLabels(clip.detection_labels.person))
    save_clip(clip, tmp_path)
    assert_same(load_clip(tmp_path), clip)


def test_a_clip_of_version_0_1_0_is_read_and_written_as_it_was(tmp_path):
    clip, stored = load_clip(OLD_CLIP), load_file(OLD_CLIP / "arrays.safetensors")
    assert (clip.id, clip.fps, clip.rig.names, clip.occlusion.objects) == (
        "written by 0.1.0", 25.0, ("a", "b"), ("floor", "box")
    )  # fmt: skip
    for name, found in (
        ("rig.K", clip.rig.K),
        ("true_rig.K", clip.true_rig.K),
        ("detections.xy", clip.detections.xy),
        ("truth.xyz", clip.truth.xyz),
        ("poses.source", clip.poses.source),
        ("visibility", clip.occlusion.visibility),
        ("hidden_by", clip.occlusion.occluder),
        ("depth_margin", clip.occlusion.depth_margin),
        ("visible_pixels", clip.occlusion.visible_pixels),
        ("amodal_pixels", clip.occlusion.amodal_pixels),
        ("detected_person", clip.detection_labels.person),
        ("detected_joint_person", clip.detection_labels.joint_person),
        ("detected_error", clip.detection_labels.error),
        ("detected_off", clip.detection_labels.offset_px),
    ):
        assert_same(found, stored[name])
    save_clip(clip, tmp_path)
    for file in ("clip.json", "arrays.safetensors"):
        assert (tmp_path / file).read_bytes() == (OLD_CLIP / file).read_bytes()


def test_a_fused_truth_keeps_its_skeleton(tmp_path):
    skeleton = get_skeleton("body25+shelf14")
    bare = Clip(
        "bare", 30.0, looking_at_origin(), full_clip().detections, truth=Poses3D(skeleton, np.ones((12, 1, 39, 3)))
    )
    save_clip(bare, tmp_path)
    assert_same(load_clip(tmp_path), bare)


@settings(max_examples=30, deadline=None)
@given(
    arrays(np.float32, (2, 4, 1, 25, 2), elements=st.just(np.nan) | st.floats(-1e6, 1e6, width=32)),
    st.sampled_from([BODY25, SHELF14]),
    st.integers(0, 3),
)
def test_any_clip_survives(tmp_path_factory, xy, skeleton, persons):
    score = np.where(np.isnan(xy).any(-1), np.nan, 0.5)
    truth = Poses3D(skeleton, np.full((2, persons, len(skeleton), 3), np.nan))
    clip = Clip("any", 25.0, looking_at_origin(), Detections2D(BODY25, xy, score), truth=truth)
    folder = tmp_path_factory.mktemp("clip")
    save_clip(clip, folder)
    assert_same(load_clip(folder), clip)


def test_images_are_found_after_moving_clip_and_images(tmp_path):
    images = Images(tmp_path / "set" / "0" / "images", ("cam0",), (0, 1), ("parts",), ("arm", "leg"))
    save_clip(replace(full_clip(), images=images), tmp_path / "set" / "0")
    (tmp_path / "set").rename(tmp_path / "moved")
    found = load_clip(tmp_path / "moved" / "0").images
    assert found.folder.resolve() == tmp_path / "moved" / "0" / "images"
    assert replace(found, folder=images.folder) == images


def test_same_clip_same_bytes(tmp_path):
    for name in ("a", "b"):
        save_clip(full_clip(), tmp_path / name)
    for file in ("clip.json", "arrays.safetensors"):
        assert (tmp_path / "a" / file).read_bytes() == (tmp_path / "b" / file).read_bytes()


def test_a_damaged_clip_is_refused(tmp_path):
    save_clip(full_clip(), tmp_path)
    path = tmp_path / "arrays.safetensors"
    data = bytearray(path.read_bytes())
    data[-1] ^= 1
    path.write_bytes(data)
    with pytest.raises(ValueError, match=r"arrays\.safetensors.*checksum.*damaged"):
        load_clip(tmp_path)
    path.unlink()
    with pytest.raises(FileNotFoundError, match=r"arrays\.safetensors"):
        load_clip(tmp_path)


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        (lambda meta: meta.update(format=99), "expected a clip of format 1, found format 99"),
        (lambda meta: meta.pop("fps"), "lacks 'fps'"),
        (lambda meta: meta.update(skeletons={"detections": "body52"}), "body52"),
        (lambda meta: meta.update(fps=-1), "expected frames per second from"),
        (lambda meta: meta.pop("sha256"), "checksum"),
    ],
)
def test_a_malformed_clip_is_a_value_error_that_names_it(tmp_path, edit, message):
    save_clip(full_clip(), tmp_path)
    meta = read_json(tmp_path / "clip.json")
    edit(meta)
    (tmp_path / "clip.json").write_text(json.dumps(meta))
    with pytest.raises(ValueError, match=message) as caught:
        load_clip(tmp_path)
    assert str(tmp_path) in str(caught.value)


def test_json_errors_name_file_line_and_column(tmp_path):
    (tmp_path / "x.json").write_text('{"a": 1,\n "b": }')
    with pytest.raises(ValueError, match=r"x\.json: expected JSON.*line 2 column"):
        read_json(tmp_path / "x.json")
    with pytest.raises(FileNotFoundError, match=r"y\.json: no such file"):
        read_json(tmp_path / "y.json")


def test_an_interrupted_write_leaves_the_old_file_and_no_other(tmp_path, monkeypatch):
    path = tmp_path / "file"
    write_atomic(path, "old")

    def fail(*args):
        raise OSError("disk on fire")

    monkeypatch.setattr("os.fsync", fail)
    with pytest.raises(OSError, match="on fire"):
        write_atomic(path, "new")
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_clips_of_a_data_set_are_those_of_status_ok(tmp_path):
    lines = [
        {"id": "clip_2", "status": "ok"},
        {"id": "clip_0", "status": "ok"},
        {"id": "clip_1", "status": "failed", "reason": "fell"},
    ]
    write_manifest(tmp_path, lines)
    assert [line["id"] for line in read_manifest(tmp_path)] == ["clip_0", "clip_1", "clip_2"]
    assert clip_folders(tmp_path) == [tmp_path / "clip_0", tmp_path / "clip_2"]
    save_clip(full_clip(), tmp_path / "clip_0")
    assert clip_folders(tmp_path / "clip_0") == [tmp_path / "clip_0"]
    with pytest.raises(FileNotFoundError, match="no such folder"):
        clip_folders(tmp_path / "nothing")
    (tmp_path / "nothing").mkdir()
    with pytest.raises(FileNotFoundError, match="neither"):
        clip_folders(tmp_path / "nothing")


@pytest.mark.parametrize("line", ["{", "[]", '{"id": "a"}'])
def test_a_malformed_manifest_is_refused_with_the_line(tmp_path, line):
    Path(tmp_path / "manifest.jsonl").write_text('{"id": "a", "status": "ok"}\n' + line + "\n")
    with pytest.raises(ValueError, match=r"manifest\.jsonl, line 2: expected"):
        clip_folders(tmp_path)


def test_a_full_disk_is_an_error_with_the_name_of_the_file(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("before")

    def full(handle):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(OSError, match=r"No space left on device: '.*file'") as caught:
        write_atomic(tmp_path / "file", "after")
    assert caught.value.errno == errno.ENOSPC
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == {"file": "before"}
    with pytest.raises(OSError, match="arrays"):
        save_clip(full_clip(frames=2), tmp_path / "clip")
    assert not list((tmp_path / "clip").iterdir())
