"""3D poses as CMU Panoptic publishes them."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import dmae
from dmae.data.clip import Poses3D, Source
from dmae.data.conversion import convert
from dmae.data.skeleton import BODY25, PANOPTIC19
from dmae.formats.calibrations import read_calibration, write_calibration
from dmae.formats.config import Convention
from dmae.formats.panoptic import POSES, read_poses, write_poses
from tests.support.clips import full_clip, looking_at_origin, walkers

STANDING = {"neck": (10.0, -145.0, 20.0), "nose": (0.0, -160.0, 20.0), "l_ankle": (12.0, -8.0, 30.0)}
"""cm, y down, of somebody who faces -x."""


def body(number: int, **confidence: float) -> dict:
    joints = [
        (*STANDING.get(joint, (0.0, 0.0, 0.0)), confidence.get(joint, 0.5 if joint in STANDING else -1.0))
        for joint in PANOPTIC19.joints
    ]
    return {"id": number, "joints19": [value for joint in joints for value in joint]}


def scene(*bodies: dict) -> dict:
    return {"version": 0.7, "univTime": 53541.542, "fpsType": "hd_29_97", "bodies": [*bodies]}


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    """Frames 100, 101 and 103; bodies 2 and 5 come and go."""
    contents = {100: scene(body(5)), 101: scene(), 103: scene(body(5), body(2))}
    (tmp_path / POSES).mkdir()
    for number, content in contents.items():
        (tmp_path / POSES / f"body3DScene_{number:08d}.json").write_text(json.dumps(content))
    return tmp_path


def test_people_stand_upright_in_metres(recording):
    found = read_poses(recording)
    neck, nose, ankle = PANOPTIC19.index("neck", "nose", "l_ankle")
    joints = found.xyz[100][1]
    np.testing.assert_allclose(joints[[neck, nose, ankle], 2], [1.45, 1.60, 0.08])
    np.testing.assert_allclose(joints[neck], [0.10, 0.20, 1.45])
    assert found.fps == 29.97
    as_written = read_poses(recording, Convention()).xyz[100][1]
    np.testing.assert_array_equal(as_written[neck], STANDING["neck"])


def test_a_person_is_an_id_in_every_frame(recording):
    found = read_poses(recording)
    there = {number: (~np.isnan(xyz).all((1, 2))).tolist() for number, xyz in found.xyz.items()}
    assert there == {100: [False, True], 101: [False, False], 103: [True, True]}
    assert found.notes == ("persons 0 to 1 of the truth are the bodies of ids [2, 5]",)


def test_a_joint_of_no_confidence_is_absent_not_at_the_origin(recording):
    (recording / POSES / "body3DScene_00000101.json").write_text(json.dumps(scene(body(5, nose=0.0, neck=0.01))))
    known = ~np.isnan(read_poses(recording).xyz[101][1]).any(-1)
    assert [PANOPTIC19.joints[joint] for joint in np.flatnonzero(known)] == ["neck", "l_ankle"]


def test_frames_cut_short_are_absent_and_noted(recording):
    (recording / POSES / "body3DScene_00000101.json").write_text('{"bodies": [')
    found = read_poses(recording)
    assert sorted(found.xyz) == [100, 103]
    assert found.notes[0].startswith("1 files of poses could not be read and are absent, first ")
    assert "00000101.json: expected JSON" in found.notes[0]


MALFORMED = {
    "other JSON": ({"people": []}, ["a list of bodies", "people"]),
    "no id": (scene({"joints19": [0.0] * 76}), [r"bodies\[0\]\.id", "found None"]),
    "an id twice": (scene(body(1), body(1)), [r"bodies\[1\]\.id: expected a number that no other body has, found 1"]),
    "other joints": (scene({"id": 1, "joints15": [0.0] * 60}), [r"bodies\[0\]\.joints19: expected 76 numbers"]),
    "too few": (scene(body(1) | {"joints19": [1.0] * 75}), [r"bodies\[0\]\.joints19: expected 76 numbers, found \[1"]),
}


@pytest.mark.parametrize(("content", "message"), MALFORMED.values(), ids=MALFORMED)
def test_malformed_files_are_named_with_the_place(content, message, recording):
    (recording / POSES / "body3DScene_00000101.json").write_text(json.dumps(content))
    with pytest.raises(ValueError, match=r"00000101\.json") as error:
        read_poses(recording)
    for part in message:
        error.match(part)


def test_rates_that_differ_no_folder_several_and_nothing_readable(recording, tmp_path):
    other = recording / POSES / "body3DScene_00000101.json"
    other.write_text(json.dumps(scene() | {"fpsType": "vga_25"}))
    with pytest.raises(
        ValueError, match=r"one fpsType, found 29\.97 in .*00000100\.json and 25\.0 in .*00000101\.json"
    ):
        read_poses(recording)
    (recording / "vgaPose3d_stage1_coco19").mkdir()
    other.rename(recording / "vgaPose3d_stage1_coco19" / other.name)
    with pytest.raises(ValueError, match=r"one folder of poses, found .*hdPose.*vgaPose.*; name one"):
        read_poses(recording)
    assert read_poses(recording / "vgaPose3d_stage1_coco19").fps == 25
    (tmp_path / "empty").mkdir()
    with pytest.raises(FileNotFoundError, match=r"hdPose3d_stage1_coco19/body3DScene_.* found none"):
        read_poses(tmp_path / "empty")
    for file in (recording / POSES).iterdir():
        file.write_text("{")
    with pytest.raises(ValueError, match=r"not one file could be read; .*00000100\.json: expected JSON"):
        read_poses(recording / POSES)


def test_poses_written_and_read_again(tmp_path):
    truth = walkers(6, 3, PANOPTIC19)
    xyz = truth.xyz.copy()
    xyz[2:4, 1], xyz[0, 0, 3] = np.nan, np.nan
    write_poses(Poses3D(PANOPTIC19, xyz), 30, tmp_path, first=12)
    found = read_poses(tmp_path)
    assert found.fps == 30
    assert sorted(found.xyz) == list(range(12, 18))
    np.testing.assert_allclose([found.xyz[number] for number in range(12, 18)], xyz, atol=1e-6)
    content = json.loads((tmp_path / POSES / "body3DScene_00000014.json").read_text())
    assert [body["id"] for body in content["bodies"]] == [0, 2]


def test_invented_joints_are_marked_and_are_no_truth(tmp_path):
    source = np.full((1, 1, 19), Source.MEASURED)
    source[0, 0, 4] = Source.COMPLETED
    write_poses(Poses3D(PANOPTIC19, walkers(1, 1, PANOPTIC19).xyz, source), 29.97, tmp_path)
    content = json.loads((tmp_path / POSES / "body3DScene_00000000.json").read_text())
    confidence = content["bodies"][0]["joints19"][3::4]
    assert content["fpsType"] == "hd_29_97"
    assert [joint for joint in range(19) if confidence[joint] < 1] == [4]
    assert np.flatnonzero(np.isnan(read_poses(tmp_path).xyz[0][0]).any(-1)).tolist() == [4]


def test_only_its_own_skeleton_is_written(tmp_path):
    with pytest.raises(ValueError, match="expected poses of panoptic19, found body25"):
        write_poses(walkers(1, 1, BODY25), 30, tmp_path)


def test_cameras_and_poses_of_a_recording_fit_together(tmp_path):
    """Seen through the file's own numbers, without any of our conventions, a joint is where we see it."""
    rig, truth = looking_at_origin(3), walkers(1, 1, PANOPTIC19)
    write_calibration(rig, tmp_path / "calibration_x.json", "panoptic")
    write_poses(truth, 30, tmp_path)
    camera = json.loads((tmp_path / "calibration_x.json").read_text())["cameras"][1]
    joints = json.loads((tmp_path / POSES / "body3DScene_00000000.json").read_text())["bodies"][0]["joints19"]
    points = np.reshape(joints, (19, 4))[:, :3] @ np.transpose(camera["R"]) + np.ravel(camera["t"])
    xy = (points / points[:, 2:] @ np.transpose(camera["K"]))[:, :2]
    ours, depth = read_calibration(tmp_path).project(read_poses(tmp_path).xyz[0][None])
    np.testing.assert_allclose(ours[0, 1, 0], xy, atol=1e-3)
    np.testing.assert_allclose(100 * depth[0, 1, 0], points[:, 2], atol=1e-3)


def test_our_own_export_is_read_back_with_source_and_covariance(tmp_path):
    clip = full_clip(frames=6)
    poses = convert(walkers(6), PANOPTIC19)
    source = poses.source.copy()
    source[2, 0, 3], source[3, 1, 4] = Source.COMPLETED, Source.DENOISED
    root = np.random.default_rng(0).normal(0, 0.02, (*poses.xyz.shape, 3))
    cov = root @ root.swapaxes(-1, -2)
    cov[1, 0, 2] = np.nan
    dmae.export(replace(clip, poses=Poses3D(PANOPTIC19, poses.xyz, source, cov)), tmp_path / "out", "panoptic")
    read = dmae.read_poses(tmp_path / "out")
    assert read.fps == clip.fps
    np.testing.assert_allclose(read.poses.xyz, poses.xyz, atol=1e-5)
    np.testing.assert_array_equal(read.poses.source, source)
    np.testing.assert_allclose(read.poses.cov, cov, rtol=1e-4, atol=1e-9)
    # As a recording it has cameras and truth; what was completed is no truth.
    again = dmae.read(tmp_path / "out")
    assert again.rig.names == clip.rig.names and not again.detections.observed.any()
    assert np.isnan(again.truth.xyz[2, 0, 3]).all() and np.isfinite(again.truth.xyz).sum() == 3 * (source.size - 1)
    assert any("there are no detections" in note for note in again.provenance["notes"])
