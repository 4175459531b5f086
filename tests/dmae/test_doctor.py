"""What the doctor says of recordings with planted faults, and of sound ones.

Detections are a simulated detector's with the mistakes measured on a real one, of people who walk about and hide
each other; four rigs, and two real recordings.
"""

import json
import os
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from dmae.clip import Detections2D
from dmae.conventions import Convention, Unit, Up
from dmae.data import DataConfig, Format, load, written_convention
from dmae.doctor import DoctorCommand, diagnose, run_doctor
from dmae.epipolar import Reading, agree, fundamental, look
from dmae.skeleton import BODY25
from dmae.store import save_clip

from .examples import full_clip
from .faulty import (
    CONFIGS,
    RIGS,
    centres,
    focal,
    inverse,
    late,
    lens,
    lenses,
    mirrored,
    principal,
    scaled,
    seen,
    size,
    sound,
    swapped,
    turned,
    written,
)

TRIAL = "pose2sim/S00_P00_SingleParticipant/S00_P00_T01_BalancingTrial"


ALL = (0, 1, 2, 3, 4)
# rig; how a fault is planted; what is to be found: fault, cameras, what the remedy must say.
CASES = [
    ("shelf", lambda c: written(c, unit=Unit.mm), [("unit", ALL, "data.unit=mm")]),
    ("shelf", lambda c: written(c, up=Up.y), [("up", ALL, "data.up=y")]),
    ("shelf", lambda c: focal(c, *ALL), [("focal", ALL, "exchange fx and fy")]),
    ("shelf", lambda c: late(c, 6, 2), [("delay", (2,), "data.offsets=[0,0,6,0,0]")]),
    ("campus", lambda c: inverse(c, 1), [("inverse", (1,), "camera 1, invert the extrinsics")]),
    ("campus", lambda c: written(c, unit=Unit.cm), [("unit", (0, 1, 2), "data.unit=cm")]),
    ("campus", lambda c: written(c, up=Up.minus_y), [("up", (0, 1, 2), "data.up=minus_y")]),
    ("campus", lambda c: late(c, -9, 1), [("delay", (1,), "data.offsets=[0,-9,0]")]),
    ("campus", lambda c: swapped(c, 0, 2), [("order", (0, 2), "exchange the detections of cameras 0 and 2")]),
    ("campus", lambda c: scaled(c, 2 / 3, 0, 1, 2), [("scale", (0, 1, 2), "multiply fx, fy, cx, cy")]),
    ("campus", lambda c: mirrored(c, 1), [("mirrored", (1,), "width - 1 - x")]),
    ("campus", lambda c: principal(c, 2), [("principal", (2,), "exchange cx and cy")]),
    ("ring", lambda c: centres(c, 0, 1, 2, 3), [("centre", (0, 1, 2, 3), "t = -R C")]),
    ("ring", lambda c: written(c, up=Up.x), [("up", (0, 1, 2, 3), "data.up=x")]),
    ("ring", lambda c: late(c, 2, 3), [("delay", (3,), "data.offsets=[0,0,0,2]")]),
    ("ring", lambda c: scaled(c, 1.5, 1), [("scale", (1,), "1.5")]),
    ("ring", lambda c: turned(c, 2), [("turned_right", (2,), "height - 1 - x")]),
    ("ring", size, [("size", (0, 1, 2, 3), "960 x 600")]),
    ("lenses", lambda c: focal(c, 2), [("focal", (2,), "cam2, exchange fx and fy")]),
    ("lenses", lambda c: lens(c, 0), [("distorted", (0, 1, 2, 3), "k1 is about -0.")]),
    ("lenses", lambda c: lens(c, -1), [("distortion_sign", (0, 1, 2, 3), "change the sign")]),
    (
        "lenses",
        lambda c: written(c, unit=Unit.mm, up=Up.y, inverse=True),
        [
            ("inverse", (0, 1, 2, 3), "data.inverse=true"),
            ("unit", (0, 1, 2, 3), "data.unit=mm"),
            ("up", (0, 1, 2, 3), "data.up=y"),
        ],
    ),
]


@pytest.mark.parametrize(("rig", "plant", "expected"), CASES, ids=[f"{rig}-{found[0][0]}" for rig, _, found in CASES])
def test_planted_faults_are_named_with_what_mends_them(rig, plant, expected):
    clip = plant(sound(rig))
    names = clip.rig.names
    found = diagnose(clip, Convention(), [0] * len(names), most_delay=10).findings
    assert [(x.fault.name, x.cameras) for x in found] == [
        (x, tuple(names[v] for v in views)) for x, views, _ in expected
    ]
    for finding, (_, _, said) in zip(found, expected, strict=True):
        assert said in finding.remedy


@pytest.mark.parametrize("rig", RIGS)
def test_sound_recordings_have_nothing(rig):
    diagnosis = diagnose(sound(rig), Convention(), most_delay=10)
    assert diagnosis.findings == diagnosis.unknown == ()
    assert all(fit.agreement > 0.25 for fit in diagnosis.pairs)
    assert diagnosis.pairs == diagnosis.mended


def test_the_real_shelf_is_sound_and_its_faults_are_found(shelf):
    diagnosis = diagnose(shelf)
    assert diagnosis.findings == diagnosis.unknown == ()
    assert all(3 < fit.residual < 9 and fit.agreeing > 0.6 for fit in diagnosis.pairs)
    # Focal lengths differ by 1.6 % at most.
    (finding,) = diagnose(focal(shelf, *ALL), most_delay=10).findings
    assert (finding.fault.name, finding.cameras) == ("focal", shelf.rig.names)


def test_the_real_pose2sim_trial_is_sound_and_read_otherwise_it_is_not(data_folder):
    config = DataConfig(name=Format.pose2sim, path=str(data_folder / TRIAL))
    assert diagnose(load(config)[0], written_convention(config)).findings == ()
    wrong = replace(config, unit=Unit.mm, up=Up.y, inverse=True)
    found = diagnose(load(wrong)[0], written_convention(wrong)).findings
    assert [finding.remedy for finding in found] == ["data.inverse=false", "data.unit=m", "data.up=z"]


def test_where_the_format_has_no_options_the_change_to_the_file_is_named():
    found = diagnose(written(sound("campus"), unit=Unit.mm, up=Up.y), most_delay=5).findings
    assert [finding.fault.name for finding in found] == ["unit", "up"]
    assert "multiply the translations of all cameras by 0.001: they are in mm" in found[0].remedy
    assert "replace R by R Q^T, where Q = [[1, 0, 0], [0, 0, -1], [0, 1, 0]]" in found[1].remedy


def test_what_no_usual_mistake_explains_is_said_of_the_camera():
    clip = sound("shelf")
    pose = clip.rig.cam_from_world.copy()
    tilt = np.deg2rad(8)
    pose[2, :3] = [[1, 0, 0], [0, np.cos(tilt), -np.sin(tilt)], [0, np.sin(tilt), np.cos(tilt)]] @ pose[2, :3]
    moved = replace(clip, rig=replace(clip.rig, cam_from_world=pose))
    (finding,) = diagnose(moved, most_delay=5).findings
    assert (finding.fault.name, finding.cameras) == ("unexplained", ("2",))
    assert "calibrate camera 2 anew" in finding.remedy


def test_what_cannot_be_decided_is_said_and_not_guessed():
    clip = sound("ring")
    one = diagnose(clip.select(views=[1]))
    assert (one.pairs, one.findings, one.unknown) == ((), (), ("nothing can be compared: there is one camera",))
    xy = clip.detections.xy.copy()
    xy[:, 2] = np.nan
    blind = diagnose(seen(clip, xy, np.where(np.isnan(xy[..., 0]), np.nan, 0.5)), most_delay=5)
    assert (blind.findings, blind.unknown) == ((), ("camera cam2 detects nobody",))
    still = np.repeat(clip.detections.xy[50:51], len(clip), 0)
    frozen = diagnose(seen(clip, still, np.repeat(clip.detections.score[50:51], len(clip), 0)), most_delay=5)
    assert frozen.findings == ()
    assert frozen.unknown == ("people move too little to tell whether the cameras are in step",)
    with pytest.raises(ValueError, match="most_delay=-1: expected a number of frames"):
        diagnose(clip, most_delay=-1)
    alone = diagnose(seen(clip, np.full_like(xy, np.nan), np.full(xy.shape[:-1], np.nan)))
    assert alone.findings == ()
    assert "nothing can be compared: no two cameras see anybody in the same frame" in alone.unknown


def test_epipolar_lines_pass_through_what_both_cameras_see():
    clip, rig = full_clip(), lenses()
    xy, _ = rig.project(clip.truth.xyz)
    ideal = np.concatenate([rig.undistort(xy), np.ones_like(xy[..., :1])], -1)[:, :, 0]
    F = fundamental(rig, np.array([0]), np.array([2]))[0]
    lines = ideal[:, 0] @ F.T
    off = np.abs((lines * ideal[:, 2]).sum(-1)) / np.linalg.norm(lines[..., :2], axis=-1)
    np.testing.assert_allclose(off, 0, atol=1e-6)
    exact = replace(clip, rig=rig, detections=Detections2D(BODY25, xy, np.where(np.isnan(xy[..., 0]), np.nan, 1)))
    found = agree(look(Reading.of(exact, Convention()), np.arange(12)), [(0, 2)])
    assert found.detections.tolist() == [[4] * 12]
    # 15 joints are looked at, and one more is doubted.
    np.testing.assert_allclose(found.total, 4 * 15 / 16, rtol=1e-3)
    np.testing.assert_allclose(found.off, 0, atol=0.01)


def test_the_command_prints_writes_and_exits_by_what_it_finds(tmp_path, capsys):
    save_clip(sound("campus"), tmp_path / "well")
    run_doctor(DoctorCommand(DataConfig(path=str(tmp_path / "well")), most_delay=5), tmp_path / "good")
    said = capsys.readouterr().out
    assert "nothing found wrong" in said
    assert "0-2" in said
    save_clip(inverse(sound("campus"), 1), tmp_path / "ill")
    command = [sys.executable, "-c", "from dmae.cli import main; main()", "doctor", "data=ill", "out=bad"]
    environment = os.environ | {"PYTHONPATH": str(CONFIGS.parent)}
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (1, "")
    assert "mend: in the calibration of camera 1, invert the extrinsics" in done.stdout
    told = json.loads((tmp_path / "bad/doctor.json").read_text())
    assert told["findings"][0]["cameras"] == ["1"]
    assert (tmp_path / "bad/doctor.png").read_bytes().startswith(b"\x89PNG")
