"""AMASS-style files: orientations as they were, joints where SMPL has them, and malformed files."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from synth.motion.config import ProceduralConfig, UpAxis
from synth.motion.geometry import about
from synth.motion.motion import Motion
from synth.motion.procedural.gait import make_motion
from synth.motion.source import read_take
from synth.people.body import SEGMENTS
from tests.support.smpl_files import write_smpl
from tests.support.stick_figure import joints, soles

# SMPL's mean body as tabulated for simulated humanoids: joint, parent, offset; x left, y up, z forward.
_SMPL = """0 -1 -0.0018 -0.2233 0.0282
1 0 0.0695 -0.0914 -0.0068
2 0 -0.0677 -0.0905 -0.0043
3 0 -0.0025 0.1090 -0.0267
4 1 0.0343 -0.3752 -0.0045
5 2 -0.0383 -0.3826 -0.0089
6 3 0.0055 0.1352 0.0011
7 4 -0.0136 -0.3980 -0.0437
8 5 0.0158 -0.3984 -0.0423
9 6 0.0015 0.0529 0.0254
12 9 -0.0028 0.2139 -0.0429
13 9 0.0788 0.1217 -0.0341
14 9 -0.0818 0.1188 -0.0386
15 12 0.0052 0.0650 0.0513
16 13 0.0910 0.0305 -0.0089
17 14 -0.0960 0.0326 -0.0091
18 16 0.2596 -0.0128 -0.0275
19 17 -0.2537 -0.0133 -0.0214
20 18 0.2492 0.0090 -0.0012
21 19 -0.2553 0.0078 -0.0056"""


def walk(seconds: float = 4.0, seed: int = 1) -> Motion:
    config = ProceduralConfig(standing=0.0, gesture=1.0)
    return make_motion(config, seconds=seconds, fps=60, rng=np.random.default_rng(seed))


def foreign(path, motion: Motion, **changes) -> dict:
    """Write a motion as other programs would; `changes` replace arrays, None leaves one out."""
    write_smpl(path, motion)
    with np.load(path) as archive:
        content = dict(archive) | changes
    content = {name: value for name, value in content.items() if value is not None}
    np.savez(path, **content)
    return content


def smpl_joints(content: dict) -> dict[int, np.ndarray]:
    """(F, 3) position of each joint of the mean body, by SMPL's forward kinematics; z up."""
    poses, places, turns = content["poses"].reshape(len(content["poses"]), -1, 3), {}, {}
    for row in _SMPL.splitlines():
        joint, parent, *offset = row.split()
        joint, parent, offset = int(joint), int(parent), np.array(offset, float)
        local = Rotation.from_rotvec(poses[:, joint])
        if parent < 0:
            places[joint], turns[joint] = content["trans"] + offset, local
        else:
            places[joint] = places[parent] + turns[parent].apply(offset)
            turns[joint] = turns[parent] * local
    return places


def angles(one: Motion, other: Motion) -> np.ndarray:
    """(F, 16) between orientations, rad."""
    between = one.rotations.swapaxes(-1, -2) @ other.rotations
    return Rotation.from_matrix(between.reshape(-1, 3, 3)).magnitude().reshape(len(one), -1)


def test_orientations_are_read_as_they_were(tmp_path, monkeypatch):
    """But for forearms, which turn about their length with the hands."""
    monkeypatch.setattr("synth.motion.retargeting.put_on_floor", lambda motion, *given, **options: motion)
    motion = walk()
    anyhow = Rotation.random(len(motion) * len(SEGMENTS), rng=np.random.default_rng(0)).as_matrix()
    motion = replace(motion, rotations=anyhow.reshape(motion.rotations.shape))
    write_smpl(tmp_path / "anyhow.npz", motion)
    others = [i for i, name in enumerate(SEGMENTS) if "forearm" not in name]
    assert angles(motion, read_take(tmp_path / "anyhow.npz"))[:, others].max() < 1e-6


def test_limbs_of_smpl_point_as_ours_do(tmp_path):
    motion = walk()
    write_smpl(tmp_path / "walk.npz", motion)
    with np.load(tmp_path / "walk.npz") as content:
        places = smpl_joints(content)
    for limb, start, end in (
        ("l_upper_arm", 16, 18), ("r_upper_arm", 17, 19), ("l_forearm", 18, 20), ("r_forearm", 19, 21),
        ("l_thigh", 1, 4), ("r_thigh", 2, 5), ("l_shin", 4, 7), ("r_shin", 5, 8),
    ):  # fmt: skip
        way = places[end] - places[start]
        column, sign = (2, -1) if "th" in limb or "shin" in limb else (1, 1 if limb[0] == "l" else -1)
        ours = sign * motion.rotations[:, SEGMENTS.index(limb), :, column]
        assert np.allclose(way / np.linalg.norm(way, axis=1, keepdims=True), ours, atol=1e-6), limb
    # Feet are on the floor: SMPL's ankles are 6 to 9 cm above their soles.
    ankles = np.minimum(places[7][:, 2], places[8][:, 2])
    assert 0.04 < np.median(ankles) < 0.10


def test_joints_lie_where_smpl_has_them(tmp_path):
    content = foreign(tmp_path / "walk.npz", walk())
    motion, places = read_take(tmp_path / "walk.npz"), smpl_joints(content)
    hips = (places[1] + places[2]) / 2
    assert np.abs(np.diff(motion.root - hips, axis=0)).max() < 0.004
    for limb, start, end in (("l_shin", 4, 7), ("r_shin", 5, 8), ("l_thigh", 1, 4), ("r_thigh", 2, 5)):
        way = places[end] - places[start]
        way /= np.linalg.norm(way, axis=1, keepdims=True)
        assert np.abs(way + motion.rotations[:, SEGMENTS.index(limb), :, 2]).max() < 0.03, limb


def facing_x(motion: Motion) -> Motion:
    """The motion with its mean place at the origin and its mean heading along x."""
    facing = motion.rotations[:, 0, :2, 0].mean(0)
    turn = about("z", -np.arctan2(facing[1], facing[0]))
    root = (motion.root - (*motion.root[:, :2].mean(0), 0)) @ turn.T
    return replace(motion, root=root, rotations=turn @ motion.rotations)


def test_files_of_other_programs_are_read_like_ours(tmp_path):
    motion = walk()
    foreign(tmp_path / "walk.npz", motion)
    read = read_take(tmp_path / "walk.npz")
    assert "size 0.9" in read.name or "size 1.0" in read.name
    here, there = (facing_x(either) for either in (read, motion))
    assert np.linalg.norm(joints(here) - joints(there), axis=-1).mean(0).max() < 0.02
    lowest = soles(read)[..., 2].min((1, 2))
    assert abs(np.median(lowest)) < 0.02


@pytest.mark.parametrize("size", [0.9, 1.1])
def test_body_size_follows_from_standing_feet(tmp_path, size):
    motion = walk()
    content = foreign(tmp_path / "mean.npz", motion)
    offset = np.array((-0.0018, -0.2233, 0.0282))
    foreign(tmp_path / "walk.npz", motion, trans=(content["trans"] + offset) * size - offset * size)
    mean, read = read_take(tmp_path / "mean.npz"), read_take(tmp_path / "walk.npz")
    assert read.hip_height / mean.hip_height == pytest.approx(size, abs=0.04)


@pytest.mark.parametrize("columns", [66, 72, 156, 165])
def test_poses_of_all_models_are_read(tmp_path, columns):
    motion = walk(1.0)
    poses = foreign(tmp_path / "smplh.npz", motion)["poses"]
    poses = np.pad(poses[:, :66], ((0, 0), (0, columns - 66)), constant_values=0.3)
    for name, shaped in (("flat", poses), ("deep", poses.reshape(len(poses), -1, 3))):
        path = tmp_path / f"{name}.npz"
        foreign(path, motion, poses=shaped.astype(np.float32), mocap_framerate=None, mocap_frame_rate=60)
        assert angles(read_take(path), read_take(tmp_path / "smplh.npz")).max() < 1e-3, "fingers do not matter"


@pytest.mark.parametrize(("name", "metres"), [("cm", 0.01), ("mm", 0.001), ("inches", 0.0254)])
def test_units_follow_from_the_height_of_the_hips(tmp_path, name, metres):
    motion = walk()
    trans = foreign(tmp_path / "m.npz", motion)["trans"]
    foreign(tmp_path / "other.npz", motion, trans=trans / metres)
    other = read_take(tmp_path / "other.npz")
    assert f"trans in {name}" in other.name
    assert np.allclose(other.root, read_take(tmp_path / "m.npz").root, atol=1e-6)
    assert np.allclose(read_take(tmp_path / "other.npz", unit=metres).root, other.root)


def test_a_world_with_y_up_can_be_given(tmp_path):
    motion = walk()
    content = foreign(tmp_path / "z.npz", motion)
    turn = Rotation.from_euler("x", -90, degrees=True)
    poses = content["poses"].copy()
    poses[:, :3] = (turn * Rotation.from_rotvec(poses[:, :3])).as_rotvec()
    foreign(tmp_path / "y.npz", motion, poses=poses, trans=turn.apply(content["trans"]))
    read, expected = read_take(tmp_path / "y.npz", up=UpAxis.y), read_take(tmp_path / "z.npz")
    assert np.allclose(soles(read)[..., 2], soles(expected)[..., 2], atol=0.01)
    with pytest.raises(ValueError, match=r"upright, found its chest along .* motion\.up="):
        read_take(tmp_path / "y.npz")


def test_short_gaps_are_filled_and_noted(tmp_path):
    motion = walk()
    content = foreign(tmp_path / "whole.npz", motion)
    poses, trans = content["poses"].copy(), content["trans"].copy()
    poses[50:60, 54] = np.nan
    trans[100:105] = np.inf
    foreign(tmp_path / "gaps.npz", motion, poses=poses, trans=trans)
    whole, gaps = read_take(tmp_path / "whole.npz"), read_take(tmp_path / "gaps.npz")
    assert "15 values interpolated" in gaps.name
    assert len(gaps) == len(whole)
    assert angles(whole, gaps).max() < 0.12
    assert np.abs(whole.root - gaps.root).max() < 0.02
    unharmed = [i for i in range(len(SEGMENTS)) if "arm" not in SEGMENTS[i] and "hand" not in SEGMENTS[i]]
    assert angles(whole, gaps)[:, unharmed].max() < 0.01


def test_long_gaps_are_cut_out_or_refused(tmp_path):
    motion = walk()
    poses = foreign(tmp_path / "whole.npz", motion)["poses"]
    for first, end in ((0, 60), (60, 180)):
        lost = poses.copy()
        lost[first:end, 10] = np.nan
        foreign(tmp_path / f"{first}.npz", motion, poses=lost)
    read = read_take(tmp_path / "0.npz")
    assert len(read) == len(motion) - 60
    assert f"frames 61-{len(motion)} of {len(motion)}" in read.name
    with pytest.raises(
        ValueError, match=r"at least half of 240 frames in a row .* found 60; missing are spine1 in 50 %"
    ):
        read_take(tmp_path / "60.npz")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"poses": None}, r"expected arrays poses and trans, found .*trans"),
        ({"trans": np.zeros((3, 3))}, r"and trans of \(F, 3\), found \(60, 156\) and \(3, 3\)"),
        ({"poses": np.zeros((60, 100))}, r"expected poses of \(F, 66 for 22 joints, .* 165 for SMPL-X\)"),
        ({"poses": np.zeros((0, 156)), "trans": np.zeros((0, 3))}, r"found \(0, 156\) and \(0, 3\)"),
        ({"poses": np.zeros(60)}, r"found \(60,\)"),
        ({"poses": np.full((60, 156), "x")}, r"expected numbers in poses, found <U1"),
        ({"poses": np.full((60, 156), 90.0)}, r"in radians, found an angle of 90"),
        ({"poses": np.array([{"a": 1}] * 60, dtype=object)}, r"pickled Python objects, which are not read"),
        ({"mocap_framerate": None}, r"one frame rate as mocap_framerate, found none; give motion\.fps"),
        ({"mocap_framerate": 0.0}, r"one frame rate as mocap_framerate, found mocap_framerate 0"),
        ({"mocap_framerate": np.ones(3)}, r"expected one number each as mocap_framerate"),
        ({"fps": 30.0}, r"found mocap_framerate 60, fps 30; give motion\.fps"),
        ({"mocap_time_length": 2.0}, r"60 frames at 60 a second last 1 s, but mocap_time_length says 2 s"),
        ({"mocap_framerate": 2000.0}, r"(no more than 12.5 m/s|5 to 1000 frames a second)"),
        ({"trans": np.eye(60, 3, -30) * 9}, r"no more than 12.5 m/s, found 90 m/s in frames 25 to 31 .* broken there"),
        ({"trans": np.full((60, 3), 7e4)}, r"expected hips some 0\.\d+ m high in trans, found 7e\+04"),
    ],
)
def test_malformed_files_are_refused(tmp_path, changes, message):
    foreign(tmp_path / "take.npz", walk(1.0), **changes)
    with pytest.raises(ValueError, match=message):
        read_take(tmp_path / "take.npz")


@pytest.mark.parametrize("keep", [0, 10, 1000, -40])
def test_truncated_archives_are_refused(tmp_path, keep):
    foreign(tmp_path / "take.npz", walk(1.0))
    data = (tmp_path / "take.npz").read_bytes()
    (tmp_path / "take.npz").write_bytes(data[:keep])
    with pytest.raises(ValueError, match=r"take\.npz: expected an npz file of arrays"):
        read_take(tmp_path / "take.npz")


def test_pickles_are_refused(tmp_path):
    np.array([{"a": 1}], dtype=object).dump(tmp_path / "take.npz")
    with pytest.raises(ValueError, match=r"expected an npz file of arrays; .*not a zip file"):
        read_take(tmp_path / "take.npz")
    np.save(tmp_path / "take.npy", np.zeros(3))
    (tmp_path / "take.npy").rename(tmp_path / "take.npz")
    with pytest.raises(ValueError, match="expected an npz file of arrays"):
        read_take(tmp_path / "take.npz")


def test_rates_can_be_replaced(tmp_path):
    foreign(tmp_path / "take.npz", walk(1.0), mocap_time_length=2.0)
    assert read_take(tmp_path / "take.npz", 30.0).fps == 30


def test_a_mapping_of_joint_names_is_refused(tmp_path):
    write_smpl(tmp_path / "take.npz", walk(1.0))
    (tmp_path / "names.yaml").write_text("Hips: pelvis\n")
    with pytest.raises(ValueError, match=r"npz files have them by number, not by name"):
        read_take(tmp_path / "take.npz", mapping=str(tmp_path / "names.yaml"))
