"""Joint angles as OpenSim reads them, on people whose angles are known."""

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dmae.data.clip import Poses3D, Source
from dmae.data.skeleton import BODY25, SKELETONS
from dmae.formats.poses import describe_filled
from dmae.formats.writing import write_poses
from dmae.numerics.kinematics import ANGLES
from tests.dmae.formats.test_animation import simulated
from tests.support.clips import full_clip


def export(poses: Poses3D, path: Path) -> tuple[dict[str, np.ndarray], list[dict[str, str]]]:
    """Return the columns of the MOT and the rows of its table."""
    clip = replace(full_clip(len(poses.xyz)), truth=None, occlusion=None, detection_labels=None, poses=poses)
    mot, table, _ = write_poses(clip, path, "mot").files
    lines = mot.read_text().splitlines()
    start = lines.index("endheader") + 1
    values = np.array([[float(cell) for cell in line.split("\t")] for line in lines[start + 1 :]])
    with table.open() as file:
        return dict(zip(lines[start].split("\t"), values.T, strict=True)), list(csv.DictReader(file))


@pytest.mark.parametrize("skeleton", list(SKELETONS.values()), ids=lambda skeleton: skeleton.name)
def test_angles_are_those_of_the_person(skeleton, tmp_path):
    poses, knee = simulated(skeleton)
    found, quality = export(poses, tmp_path / "a.mot")
    assert set(found) == {"time", "pelvis_tx", "pelvis_ty", "pelvis_tz", *(angle.name for angle in ANGLES)}
    true = np.degrees(knee)
    for side in "lr":
        assert np.abs(found[f"knee_angle_{side}"] - true).mean() < 1.5
        assert np.abs(found[f"hip_flexion_{side}"] - true / 1.4).mean() < (7 if skeleton.name == "shelf14" else 5)
        assert np.corrcoef(found[f"elbow_flex_{side}"], true)[0, 1] > 0.95
        if f"{side}_big_toe" in skeleton.joints and skeleton.name != "body21":
            assert np.abs(found[f"ankle_angle_{side}"] - 0.4 / 1.4 * true).mean() < 1.5
    assert found["pelvis_ty"] == pytest.approx(poses.xyz[:, 0, skeleton.index("l_hip", "r_hip")[0], 2], abs=0.05)
    assert all(float(row["knee_angle_l_sd"]) < 10 for row in quality)
    assert {row["knee_angle_l_source"] for row in quality} == {"measured"}
    # The lumbar spine is no joint of any skeleton.
    assert {row["L5_S1_Flex_Ext"] for row in quality} == {""}


@pytest.mark.parametrize("name", ["blazepose33", "coco17", "body25b"])
def test_an_angle_of_the_trunk_is_known_by_hips_and_shoulders_where_there_is_no_neck(name, tmp_path):
    _, quality = export(simulated(SKELETONS[name])[0], tmp_path / "a.mot")
    known = [row["L5_S1_Lat_Bending_source"] for row in quality if row["L5_S1_Lat_Bending"]]
    assert known and set(known) == {"measured"}


def test_an_angle_that_joints_do_not_determine_is_in_the_motion_alone_and_what_was_completed_says_so(tmp_path):
    poses, _ = simulated(BODY25)
    foot = BODY25.index("l_big_toe", "l_small_toe", "l_heel")
    xyz, source = poses.xyz.copy(), poses.source.copy()
    xyz[5:9, :, foot], source[5:9, :, foot] = np.nan, Source.ABSENT
    xyz[20:24], source[20:24] = np.nan, Source.ABSENT
    below = BODY25.index("r_ankle", "r_big_toe", "r_small_toe", "r_heel")
    source[12:15, :, below] = Source.COMPLETED
    found, quality = export(Poses3D(BODY25, xyz, source), tmp_path / "a.mot")
    assert "filled here, and empty in a.angles.csv" in (tmp_path / "a.mot").read_text().split("endheader")[0]
    unknown = {name: [n for n, row in enumerate(quality) if row[name] == ""] for name in found}
    assert unknown["ankle_angle_l"] == [5, 6, 7, 8, 20, 21, 22, 23]
    assert unknown["ankle_angle_r"] == unknown["pelvis_tx"] == [20, 21, 22, 23] and not unknown["time"]
    for name in ("ankle_angle_l", "pelvis_tx", "hip_flexion_r"):
        np.testing.assert_allclose(found[name][19:25], np.linspace(found[name][19], found[name][24], 6), atol=2e-6)
        known = [(n, float(row[name])) for n, row in enumerate(quality) if row[name]]
        np.testing.assert_allclose([found[name][n] for n, _ in known], [value for _, value in known], atol=1e-6)
    assert [row["knee_angle_r_source"] for row in quality[11:16]] == ["measured", *["completed"] * 3, "measured"]
    assert quality[6]["ankle_angle_l_sd"] == "" and quality[6]["ankle_angle_l_source"] == "absent"
    assert float(quality[13]["knee_angle_r_sd"]) > 1.5 * float(quality[11]["knee_angle_r_sd"])


def test_nothing_is_written_before_and_after_a_person_is_there(tmp_path):
    """A person seen in 16 of 180 frames had 164 rows of one pose, as if it had been there and stood still."""
    poses, _ = simulated(BODY25)
    whole, _ = export(poses, tmp_path / "a.mot")
    away = np.ones(poses.source.shape, bool)
    away[8:21] = False
    away[12:14] = True
    found, quality = export(poses.without(away), tmp_path / "a.mot")
    np.testing.assert_allclose(found["time"], whole["time"][8:21])
    assert [float(row["time"]) for row in quality] == pytest.approx(found["time"].tolist())
    assert "nRows=13" in (tmp_path / "a.mot").read_text()
    assert [number for number, row in enumerate(quality) if row["pelvis_tx_source"] == "absent"] == [4, 5]
    np.testing.assert_allclose(found["pelvis_ty"][[0, -1]], whole["pelvis_ty"][[8, 20]], atol=0.01)
    (said,) = describe_filled(poses.without(away), ["P1"], "stay")
    assert said == (
        f"P1: frames 8 to 20 of {len(away)}, with joints in 11 of them; 15.4% of its joints are absent there, and "
        "filled"
    )
    assert "with joints in 11 of them" in describe_filled(poses.without(away), ["P1"], "all")[0]
    assert not describe_filled(poses, ["P1"], "all")


@pytest.mark.parametrize("lean", [-8, 0, 12])
def test_the_pelvis_is_level_in_upright_standing(lean, tmp_path):
    """Of people who lean and bend their knees as they stand, hips and pelvis have angles of the legs alone."""
    poses, _ = simulated(BODY25, frames=40, lean=np.radians(lean))
    found, quality = export(poses, tmp_path / "a.mot")
    # Upright in the first and the last frames only: the person squats between them.
    assert np.abs(found["pelvis_tilt"][[0, -1]]).max() < 2.5
    assert np.abs(found["hip_flexion_r"][[0, -1]]).max() < 2.5
    known = float(quality[0]["hip_flexion_r_sd"])
    found, quality = export(poses.select(slice(15, 25)), tmp_path / "b.mot")
    assert float(quality[0]["hip_flexion_r_sd"]) > 1.15 * known


def test_larger_covariances_make_larger_standard_deviations(tmp_path):
    poses, _ = simulated(BODY25)
    spread = []
    for error in (0.01, 0.04):
        cov = np.tile(error**2 * np.eye(3), (*poses.source.shape, 1, 1))
        _, quality = export(replace(poses, cov=cov), tmp_path / "a.mot")
        spread.append(np.mean([float(row["knee_angle_r_sd"]) for row in quality]))
    assert spread[1] > 2 * spread[0]


def test_one_frame_is_enough(tmp_path):
    poses, knee = simulated(BODY25)
    found, _ = export(poses.select(slice(20, 21)), tmp_path / "a.mot")
    assert found["knee_angle_r"][0] == pytest.approx(np.degrees(knee[20]), abs=3)


def test_opensim_reads_all_of_it(tmp_path):
    """`Storage` plays motions and feeds inverse dynamics. It stops at a word that is no number, without an error."""
    opensim = pytest.importorskip("opensim")
    poses, _ = simulated(BODY25)
    xyz = poses.xyz.copy()
    xyz[5:9] = np.nan
    xyz[:, :, BODY25.index("l_knee", "l_ankle", "l_big_toe", "l_small_toe", "l_heel")] = np.nan
    found, _ = export(Poses3D(BODY25, xyz), tmp_path / "a.mot")
    table = opensim.TimeSeriesTable(str(tmp_path / "a.mot"))
    labels = list(table.getColumnLabels())
    assert ["time", *labels] == list(found)
    np.testing.assert_allclose(table.getDependentColumn("knee_angle_r").to_numpy(), found["knee_angle_r"], atol=1e-6)
    motion = opensim.Storage(str(tmp_path / "a.mot"))
    assert motion.getSize() == len(xyz) and motion.isInDegrees()
    column = opensim.ArrayDouble()
    motion.getDataColumn("knee_angle_r", column)
    np.testing.assert_allclose([column.get(n) for n in range(len(xyz))], found["knee_angle_r"], atol=1e-6)
