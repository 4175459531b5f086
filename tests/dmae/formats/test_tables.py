"""Tables of joints as text, and lines of JSON."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import dmae
from dmae.data.clip import Clip, Poses3D, Source
from dmae.data.skeleton import COCO17
from dmae.formats.coco import joint_names
from dmae.formats.poses import read_poses
from dmae.formats.writing import write_poses
from tests.support.clips import full_clip, walkers


def captured() -> Clip:
    """Two people with a gap, a completed joint and known errors, numbered from frame 300."""
    poses = walkers(6, 2)
    xyz, source = poses.xyz.copy(), poses.source.copy()
    xyz[2, 1], source[2, 1] = np.nan, Source.ABSENT
    source[3, 0, 4] = Source.COMPLETED
    cov = np.where(np.isfinite(xyz)[..., None], 0.01**2 * np.eye(3), np.nan)
    provenance = {"first_frame": 300, "people": ['Smith, "Anna"', "P10"]}
    return replace(full_clip(6), poses=Poses3D(poses.skeleton, xyz, source, cov), provenance=provenance)


@pytest.mark.parametrize(("unit", "most"), [("m", 1e-4), ("mm", 1e-4)])
def test_a_table_is_read_as_it_was_written(tmp_path: Path, unit: str, most: float):
    clip = captured()
    write_poses(clip, tmp_path / "walk.csv", unit=unit)
    lines = (tmp_path / "walk.csv").read_text().splitlines()
    assert lines[0] == f"frame,time_s,person,joint,x_{unit},y_{unit},z_{unit},source,error_{unit}"
    assert lines[1].startswith('300,0.000000,"Smith, ""Anna""",') and lines[1].endswith(
        f"measured,{'10.0' if unit == 'mm' else '0.0100'}"
    )
    read = read_poses(tmp_path / "walk.csv")
    assert read.first == 300
    # By name: Smith is after P10.
    again = read.poses.select(persons=[1, 0])
    assert again.skeleton == clip.poses.skeleton
    np.testing.assert_allclose(again.xyz, clip.poses.xyz, atol=most)
    np.testing.assert_array_equal(again.source, clip.poses.source)


def test_a_table_of_somebody_else_is_read(tmp_path: Path):
    """Names as COCO has them, players by number in any order, mm, and no source."""
    rng = np.random.default_rng(0)
    xyz = rng.uniform(-1, 1, (3, 11, 17, 3))
    rows = [
        ",".join(
            [str(frame + 5), str(player + 1), name, *(f"{1000 * value:.1f}" for value in xyz[frame, player, joint])]
        )
        for frame in range(3)
        for player in range(11)
        for joint, name in enumerate(joint_names(COCO17))
    ]
    rng.shuffle(rows)
    (tmp_path / "truth.csv").write_text("\n".join(["Frame,Player,Keypoint,X_mm,Y_mm,Z_mm", *rows, ""]))
    read = read_poses(tmp_path / "truth.csv")
    assert read.poses.skeleton == COCO17
    np.testing.assert_allclose(read.poses.xyz, xyz, atol=1e-4)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("frame,joint,x,y\n", "expected columns frame, person, joint, x, y, z, found no x, y, z"),
        ("frame,joint,x,y,z\n", "expected rows of joints, found none"),
        ("frame,joint,x,y,z\n1,nose,1,2,a\n", r"line 2: expected a frame, names and numbers"),
        ("frame,joint,x,y,z\n1,nose,1,2\n", r"line 2: expected a frame, names and numbers"),
        ("frame,joint,x,y,z\n1,nose,1,2,3\n1,nose,1,2,3\n", "each joint of a person once in a frame"),
        ("frame,joint,x,y,z\n1,nose,1,2,3\n99999999,nose,1,2,3\n", "expected files numbered by frame"),
        ("frame,joint,x,y,z\n1,nose,1,2,1e30\n", "coordinates"),
        (f"frame,joint,x,y,z\n1{30 * '0'},nose,1,2,3\n", "line 2: expected a frame"),
        (f"frame,joint,x,y,z\n1,{200_000 * 'n'},1,2,3\n", "expected a table of values between commas"),
        ("frame,joint,x,y,z,source\n1,nose,1,2,3,vicon\n", "one of the sources absent, measured, .*'vicon'"),
    ],
)
def test_malformed_tables_are_refused_with_their_name(tmp_path: Path, text: str, message: str):
    (tmp_path / "truth.csv").write_text(text)
    with pytest.raises(ValueError, match=message) as error:
        read_poses(tmp_path / "truth.csv")
    assert "truth.csv" in str(error.value)


def test_lines_have_the_keys_of_live_capture(tmp_path: Path):
    clip = captured()
    dmae.export(clip, tmp_path / "walk.jsonl")
    header, *frames = map(json.loads, (tmp_path / "walk.jsonl").read_text().splitlines())
    assert header["joints"] == list(clip.poses.skeleton.joints) and header["fps"] == clip.fps
    assert [frame["frame"] for frame in frames] == [*range(300, 306)]
    assert [person["name"] for person in frames[2]["people"]] == ['Smith, "Anna"']
    person = frames[3]["people"][0]
    assert person["id"] == 0 and person["source"][4] == "completed" and person["error_mm"][0] == 10.0
    np.testing.assert_allclose(person["xyz"], clip.poses.xyz[3, 0], atol=1e-4)


def test_tables_beside_poses_are_no_poses(tmp_path: Path):
    clip = captured()
    write_poses(clip, tmp_path / "walk.trc")
    with pytest.raises(ValueError, match="expected poses"):
        read_poses(tmp_path / "walk.provenance.csv")


def test_a_truth_of_some_joints_in_a_table_is_compared_on_the_skeleton_of_the_detections(tmp_path: Path):
    """A laboratory has hips, knees and ankles, and no bones between them in its table."""
    clip = full_clip(2)
    legs = ["l_hip", "r_hip", "l_knee", "r_knee", "l_ankle", "r_ankle"]
    found = clip.truth.xyz[:, 0, clip.truth.skeleton.index(*legs)]
    rows = [
        f"{frame},{joint},{','.join(map(str, xyz))}"
        for frame, joints in enumerate(found)
        for joint, xyz in zip(legs, joints, strict=True)
    ]
    (tmp_path / "legs.csv").write_text("\n".join(["frame,joint,x,y,z", *rows]) + "\n")
    truth = read_poses(tmp_path / "legs.csv").poses
    assert not truth.skeleton.bones
    measured = replace(clip, truth=truth, occlusion=None, detection_labels=None)
    scores = dmae.evaluate(measured, clip.truth.select(persons=[0]))
    assert scores["mpjpe"]["all"] == pytest.approx(0, abs=0.1)


def test_a_truth_of_points_without_bones_is_refused_in_words(tmp_path: Path):
    (tmp_path / "balls.csv").write_text("frame,joint,x,y,z\n0,ball,0,0,1\n0,bat,0,1,1\n1,ball,0,0,1\n1,bat,0,1,1\n")
    truth = read_poses(tmp_path / "balls.csv").poses
    clip = replace(full_clip(2), truth=truth, occlusion=None, detection_labels=None)
    with pytest.raises(ValueError, match=r"joints of the truth have no bones, .*\(ball, bat, "):
        dmae.evaluate(clip, truth)
