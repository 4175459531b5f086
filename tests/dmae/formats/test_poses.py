"""Poses are read from any format that writes them, one clip's or several clips'."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from ezc3d import c3d

import dmae
from dmae.data.clip import Clip, Detections2D, Poses3D
from dmae.data.skeleton import BODY25, PANOPTIC19
from dmae.data.store import save_clip, write_manifest
from dmae.formats.poses import covariance_entry, pixel_covariances, pose_paths, read_poses
from dmae.formats.registry import pose_reader
from dmae.formats.writing import write_poses
from tests.support.circling_people import circling_people
from tests.support.clips import full_clip, walkers
from tests.support.faulty_recordings import lenses


def captured(persons: int = 2) -> Clip:
    clip, poses = full_clip(frames=6), walkers(6, persons)
    xyz = poses.xyz.copy()
    xyz[2, 0, 3] = np.nan
    return replace(clip, truth=None, occlusion=None, poses=Poses3D(BODY25, xyz))


@pytest.mark.parametrize(
    ("format", "name"), [("npz", "a.npz"), ("trc", "a.trc"), ("panoptic", "a"), ("clip", "a")], ids=lambda each: each
)
def test_what_is_written_is_read(format: str, name: str, tmp_path: Path):
    clip, path = captured(), tmp_path / name
    if format == "clip":
        save_clip(clip, path)
    else:
        write_poses(clip, path, format)
    found = read_poses(path)
    assert found.fps == clip.fps
    assert found.poses.xyz.shape[:2] == (6, 2)
    joints = ["neck", "l_wrist", "r_knee"]
    expected = clip.poses.xyz[:, :, BODY25.index(*joints)]
    np.testing.assert_allclose(found.poses.xyz[:, :, found.poses.skeleton.index(*joints)], expected, atol=1e-4)


@pytest.mark.parametrize("before, now", [(3, 2), (1, 2), (2, 1)])
def test_files_of_other_people_of_an_earlier_export_are_refused(before: int, now: int, tmp_path: Path):
    path = tmp_path / "take [1].trc"
    write_poses(captured(before), path, "trc")
    there = {file: file.read_bytes() for file in tmp_path.iterdir()}
    with pytest.raises(ValueError, match=r"of an earlier export with other people.*Remove"):
        write_poses(captured(now), path, "trc")
    assert {file: file.read_bytes() for file in tmp_path.iterdir()} == there
    write_poses(captured(before), path, "trc")
    assert read_poses(path).poses.xyz.shape[1] == before
    write_poses(captured(now), tmp_path / "take.trc", "trc")


def test_a_table_with_other_names_is_not_replaced(tmp_path: Path):
    clip, path = captured(1), tmp_path / "walk.trc"
    dmae.export(clip, path, people=["P1:anna"])
    before = path.with_suffix(".provenance.csv").read_bytes()
    with pytest.raises(ValueError, match=r"with other people, anna; this one writes P1\. .* give the same people="):
        dmae.export(clip, path.with_suffix(".c3d"))
    assert path.with_suffix(".provenance.csv").read_bytes() == before
    dmae.export(clip, path.with_suffix(".c3d"), people=["P1:anna"])


@pytest.mark.parametrize("format", ["trc", "npz", "movement"])
def test_people_are_chosen_and_named(format: str, tmp_path: Path):
    clip, path = captured(3), tmp_path / f"walk.{'nc' if format == 'movement' else format}"
    done = write_poses(clip, path, format, people=["P3:anna b", "P1"])
    np.testing.assert_array_equal(done.poses.xyz, clip.poses.xyz[:, [2, 0]])
    read = read_poses(path).poses
    np.testing.assert_allclose(read.xyz, clip.poses.xyz[:, [2, 0]], atol=1e-6)
    np.testing.assert_array_equal(read.source, clip.poses.source[:, [2, 0]])


def test_files_and_tables_have_the_names_of_people(tmp_path: Path):
    clip, path = captured(3), tmp_path / "walk.trc"
    for format in ("trc", "mot", "c3d", "bvh", "glb"):
        dmae.export(clip, path.with_suffix(f".{format}"), people=["P3:anna", "P1:ben"])
    names = {file.name for file in tmp_path.iterdir()}
    assert {f"walk_{name}.{format}" for name in ("anna", "ben") for format in ("trc", "mot", "bvh")} <= names
    assert not any("_P" in name for name in names)
    rows = (tmp_path / "walk.provenance.csv").read_text().splitlines()[1:]
    assert [*dict.fromkeys(row.split(",")[0] for row in rows)] == ["anna", "ben"]
    assert "anna:LShoulder" in c3d(str(path.with_suffix(".c3d")))["parameters"]["POINT"]["LABELS"]["value"]
    dmae.export(clip, path.with_suffix(".npz"), people=["P3:anna", "P1:ben"])
    assert np.load(path.with_suffix(".npz"))["person_names"].tolist() == ["anna", "ben"]
    assert b'"anna: body"' in path.with_suffix(".glb").read_bytes()
    one = read_poses(tmp_path / "walk_ben.trc").poses
    np.testing.assert_array_equal(one.source[:, 0], clip.poses.source[:, 0])
    # A file of another program beside them is no person of theirs.
    (tmp_path / "walk_ben.trc").rename(tmp_path / "walk_filtered.trc")
    assert read_poses(tmp_path / "walk_filtered.trc").poses.measured.any()
    dmae.export(clip, tmp_path / "patient.trc", people=["P2"])
    np.testing.assert_array_equal(read_poses(tmp_path / "patient.trc").poses.source, clip.poses.source[:, [1]])


@pytest.mark.parametrize(
    ("people", "said"),
    [
        (["P4"], r"people=\[P4\]: expected some of P1, P2, P3, each once, or with a name as P1:anna"),
        (["P1:a", "P1:b"], "each once"),
        (["P1:a", "P2:A"], "expected different names"),
        (["P1:../a"], "person '../a': cannot be the name of a file"),
    ],
)
def test_people_who_are_not_there_or_cannot_be_named_are_refused(people: list[str], said: str, tmp_path: Path):
    with pytest.raises(ValueError, match=said):
        write_poses(captured(3), tmp_path / "walk.trc", people=people)


@pytest.mark.parametrize("people", [3, ["anna"], [1, 2, 3], {"P1": "anna"}])
def test_names_of_another_kind_in_a_clip_from_elsewhere_are_not_taken(people: object, tmp_path: Path):
    clip = replace(captured(3), provenance={"people": people})
    write_poses(clip, tmp_path / "walk.trc", "trc")
    assert {file.name for file in tmp_path.glob("*.trc")} == {"walk_P1.trc", "walk_P2.trc", "walk_P3.trc"}


def test_every_reader_reads_what_it_names():
    """A new reader names files or folders; without either it could never be found."""
    assert all(bool(each.file) != bool(each.signs) for each in pose_reader.values())


def test_frames_that_panoptic_left_out_are_absent(tmp_path: Path):
    clip = captured()
    write_poses(clip, tmp_path / "a", "panoptic")
    (tmp_path / "a/hdPose3d_stage1_coco19/body3DScene_00000002.json").unlink()
    poses = read_poses(tmp_path / "a").poses
    assert poses.skeleton == PANOPTIC19
    assert np.isnan(poses.xyz[2]).all() and len(poses.xyz) == 6
    last = tmp_path / "a/hdPose3d_stage1_coco19/body3DScene_00000005.json"
    last.rename(last.with_name("body3DScene_99999999.json"))
    with pytest.raises(ValueError, match="numbered by frame, found 5 that count from 0 to 99999999"):
        read_poses(tmp_path / "a")


def test_persons_of_different_lengths_are_refused(tmp_path: Path):
    write_poses(captured(), tmp_path / "a.trc", "trc")
    second = tmp_path / "a_P2.trc"
    second.write_text("\n".join(second.read_text().splitlines()[:-1]) + "\n")
    (tmp_path / "a.provenance.csv").unlink()
    with pytest.raises(ValueError, match=r"a_P2.trc: expected 6 frames at 25/s of body25 as in a_P1.trc, found 5"):
        read_poses(tmp_path / "a.trc")


def test_poses_of_several_clips_are_found_by_their_ids(tmp_path: Path):
    clip = captured()
    write_poses(clip, tmp_path / "000000.npz", "npz")
    write_poses(clip, tmp_path / "000001.trc", "trc")
    write_poses(clip, tmp_path / "000002", "panoptic")
    (tmp_path / "notes.txt").touch()
    found = pose_paths(tmp_path)
    assert list(found) == ["000000", "000001", "000002"]
    assert all(len(read_poses(path).poses.xyz) == 6 for path in found.values())
    assert pose_paths(tmp_path / "000000.npz") is None
    write_poses(clip, tmp_path / "000001.npz", "npz")
    with pytest.raises(ValueError, match=r"clip '000001' once, found 000001.npz and 000001.trc"):
        pose_paths(tmp_path)


def test_a_data_set_is_found_by_its_manifest(tmp_path: Path):
    save_clip(captured(), tmp_path / "a")
    write_manifest(tmp_path, [{"id": "a", "status": "ok"}, {"id": "b", "status": "failed"}])
    assert pose_paths(tmp_path) == {"a": tmp_path / "a"}


def test_what_holds_no_poses_is_refused(tmp_path: Path):
    (tmp_path / "notes.txt").touch()
    for function in (pose_paths, read_poses):
        with pytest.raises(FileNotFoundError, match="no such file or folder"):
            function(tmp_path / "nowhere")
    with pytest.raises(FileNotFoundError, match=r"expected poses, .*\*.npz.* or .*found none"):
        pose_paths(tmp_path)
    for function in (pose_paths, read_poses):
        with pytest.raises(ValueError, match=r"notes.txt: expected poses, .*\*.trc"):
            function(tmp_path / "notes.txt")
    save_clip(replace(captured(), poses=None), tmp_path / "a")
    with pytest.raises(ValueError, match="has no poses; run dmae capture"):
        read_poses(tmp_path / "a")


# Covariances of joints in the image: estimated from scattered points, and read from files.

FACTOR = np.array([[0.02, 0, 0], [0.01, 0.01, 0], [-0.005, 0, 0.015]])


def poses() -> Poses3D:
    truth = circling_people(2, 1, rng=np.random.default_rng(0))
    cov = np.broadcast_to(FACTOR @ FACTOR.T, (2, 1, 25, 3, 3)).copy()
    cov[0, 0, 3] = np.nan
    return Poses3D(BODY25, truth.xyz, cov=cov)


def test_they_are_the_scatter_of_reprojected_points():
    rig, known = lenses(), poses()
    found = pixel_covariances(known, rig)
    assert np.isnan(found[0, :, 0, 3]).all()
    scatter = np.random.default_rng(1).normal(size=(4000, 3)) @ FACTOR.T
    xy = rig.project(known.xyz[1, 0, 4] + scatter)[0]
    for view in range(len(rig)):
        expected = np.cov(xy[:, view], rowvar=False)
        size = np.trace(expected)
        np.testing.assert_allclose(found[1, view, 0, 4], expected[np.triu_indices(2)], atol=0.06 * size)
    assert pixel_covariances(replace(known, cov=None), rig) is None


def test_entries_have_null_where_nothing_is_known():
    assert covariance_entry(np.array([[1, 0.00004, 2], [np.nan] * 3])) == [[1.0, 0.0, 2.0], None]


def test_files_of_coco_and_openpose_hold_them(tmp_path):
    rig, known = lenses(), poses()
    nothing = np.full((2, len(rig), 0, 25), np.nan)
    clip = Clip("one", 25.0, rig, Detections2D(BODY25, np.stack([nothing] * 2, -1), nothing), poses=known)
    expected = covariance_entry(pixel_covariances(known, rig)[1, 2, 0])
    dmae.export(clip, tmp_path / "coco.json", format="coco")
    content = json.loads((tmp_path / "coco.json").read_text())
    image = next(each["id"] for each in content["images"] if (each["camera"], each["frame"]) == (rig.names[2], 1))
    (annotation,) = [each for each in content["annotations"] if each["image_id"] == image]
    assert annotation["joint_covariance"] == expected
    dmae.export(clip, tmp_path / "openpose", format="openpose")
    file = next((tmp_path / "openpose" / rig.names[2]).glob("*_000000000001_keypoints.json"))
    assert json.loads(file.read_text())["people"][0]["joint_covariance"] == expected


def test_markers_are_answered_with_how_to_compare_them(tmp_path):
    (tmp_path / "lab.c3d").touch()
    for read in (read_poses, pose_paths):
        with pytest.raises((ValueError, FileNotFoundError), match="markers of a C3D are on the skin, not at joints"):
            read(tmp_path / "lab.c3d")
