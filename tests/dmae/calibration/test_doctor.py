"""Diagnoses of recordings with planted faults, and of recordings without faults.

Detections are simulated, with errors measured on a real detector, of people who walk about and occlude each other; four
rigs, and two real recordings.
"""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dmae.calibration.bundle_adjustment import ROTATION, Calibration, Observations, Q, adjust
from dmae.calibration.doctor import Diagnosis, Finding, PairFit, _confirmed, _remedy, diagnose, examined, undetermined
from dmae.calibration.epipolar import Hypothesis, pairs_to_compare
from dmae.calibration.examination import BODIES, CameraDifference, Examination, Kind, _fit, _start
from dmae.calibration.faults import Correction, Fault, rescale
from dmae.calibration.matching import match_tracks
from dmae.cli import DMAE, compose
from dmae.commands import convert as convert_command
from dmae.commands import doctor as command
from dmae.commands.config import ConvertCommand, DoctorCommand
from dmae.commands.doctor import unexplained
from dmae.data.clip import Clip
from dmae.data.store import save_clip
from dmae.formats.config import Convention, LengthUnit, UpDirection
from dmae.formats.reading import Clips, DataConfig, written_convention
from tests.support.animals import dog_clip, hands_clip
from tests.support.commands import run_command
from tests.support.faulty_recordings import (
    RIGS,
    centres,
    focal,
    inverse,
    late,
    lens,
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
# Rig; how a fault is planted; what is to be found: fault, cameras, part of the remedy.
CASES = [
    ("shelf", lambda c: written(c, unit=LengthUnit.mm), [("unit", ALL, "data.unit=mm")]),
    ("shelf", lambda c: focal(c, *ALL), [("focal", ALL, "exchange fx and fy")]),
    ("shelf", lambda c: late(c, 6, 2), [("delay", (2,), "data.offsets=[0,0,6,0,0]")]),
    ("campus", lambda c: inverse(c, 1), [("inverse", (1,), "camera 1, invert the extrinsics")]),
    (
        "campus",
        lambda c: written(c, unit=LengthUnit.cm, up=UpDirection.minus_y),
        [("unit", (0, 1, 2), "data.unit=cm"), ("up", (0, 1, 2), "data.up=minus_y")],
    ),
    ("campus", lambda c: late(c, -9, 1), [("delay", (1,), "data.offsets=[0,-9,0]")]),
    ("campus", lambda c: swapped(c, 0, 2), [("order", (0, 2), "exchange the detections of cameras 0 and 2")]),
    ("campus", lambda c: scaled(c, 2 / 3, 0, 1, 2), [("scale", (0, 1, 2), "multiply fx, fy, cx, cy")]),
    ("campus", lambda c: mirrored(c, 1), [("mirrored", (1,), "width - 1 - x")]),
    ("campus", lambda c: principal(c, 2), [("principal", (2,), "exchange cx and cy")]),
    ("ring", lambda c: centres(c, 0, 1, 2, 3), [("centre", (0, 1, 2, 3), "t = -R C")]),
    ("ring", lambda c: written(c, up=UpDirection.x), [("up", (0, 1, 2, 3), "data.up=x")]),
    ("ring", lambda c: late(c, 2, 3), [("delay", (3,), "data.offsets=[0,0,0,2]")]),
    ("ring", lambda c: scaled(c, 1.5, 1), [("scale", (1,), "1.5")]),
    ("ring", lambda c: turned(c, 2), [("turned_right", (2,), "height - 1 - x")]),
    ("ring", size, [("size", (0, 1, 2, 3), "960 x 600")]),
    ("lenses", lambda c: focal(c, 2), [("focal", (2,), "cam2, exchange fx and fy")]),
    ("lenses", lambda c: lens(c, 0), [("distorted", (0, 1, 2, 3), "k1 is about -0.")]),
    ("lenses", lambda c: lens(c, -1), [("distortion_sign", (0, 1, 2, 3), "change the sign")]),
    (
        "lenses",
        lambda c: written(c, unit=LengthUnit.mm, up=UpDirection.y, inverse=True),
        [
            ("inverse", (0, 1, 2, 3), "data.inverse=true"),
            ("unit", (0, 1, 2, 3), "data.unit=mm"),
            ("up", (0, 1, 2, 3), "data.up=y"),
        ],
    ),
]


@pytest.mark.slow
@pytest.mark.parametrize(("rig", "plant", "expected"), CASES, ids=[f"{rig}-{found[0][0]}" for rig, _, found in CASES])
def test_planted_faults_are_named_with_their_remedy(rig, plant, expected):
    # A time offset shows in how people move, for which two seconds are short.
    frames, most = (80, 10) if expected[0][0] == "delay" else (50, 4)
    clip = plant(sound(rig, frames))
    names = clip.rig.names
    found = diagnose(clip, Convention(), [0] * len(names), max_offset=most).findings
    assert [(x.fault.name, x.cameras) for x in found] == [
        (x, tuple(names[v] for v in views)) for x, views, _ in expected
    ]
    for finding, (_, _, part) in zip(found, expected, strict=True):
        assert part in finding.remedy


@pytest.mark.parametrize("rig", RIGS)
def test_sound_recordings_have_no_findings(rig):
    diagnosis = diagnose(sound(rig), Convention(), max_offset=10)
    assert diagnosis.findings == diagnosis.unknown == ()
    assert all(fit.agreement > 0.25 for fit in diagnosis.pairs)
    assert diagnosis.pairs == diagnosis.corrected


@pytest.fixture(scope="module")
def diagnosis_of_shelf(data_folder) -> Diagnosis:
    return diagnose(Clips(DataConfig("shelf", str(data_folder / "shelf")))[0])


def test_the_real_shelf_is_sound_and_its_faults_are_found(shelf, diagnosis_of_shelf):
    diagnosis = diagnosis_of_shelf
    assert diagnosis.findings == diagnosis.unknown == ()
    assert all(3 < fit.residual < 9 and fit.agreeing > 0.6 for fit in diagnosis.pairs)
    # Focal lengths differ by 1.6 % at most.
    (finding,) = diagnose(focal(shelf, *ALL), max_offset=10).findings
    assert (finding.fault.name, finding.cameras) == ("focal", shelf.rig.names)


def test_the_real_pose2sim_trial_is_sound_and_faulty_with_other_conventions(data_folder):
    config = DataConfig(name="pose2sim", path=str(data_folder / TRIAL))
    assert diagnose(Clips(config)[0], written_convention(config), max_offset=10).findings == ()
    wrong = replace(config, unit=LengthUnit.mm, up=UpDirection.y, inverse=True)
    found = diagnose(Clips(wrong)[0], written_convention(wrong), max_offset=10).findings
    assert [finding.remedy for finding in found] == ["data.inverse=false", "data.unit=m", "data.up=z"]


def test_a_camera_far_from_the_others_is_named_though_no_single_difference_explains_it(data_folder):
    """It is displaced, in the files, and seven frames late, planted here."""
    clip = Clips(DataConfig(name="pose2sim", path=str(data_folder / TRIAL), offsets=["cam_03:-7"]))[0]
    found = diagnose(clip, max_offset=10)
    assert found.findings == found.unknown == ()
    (said,) = unexplained(found)
    assert said.startswith("why cam_03 lies 24 px from the others, which have 7: no single difference explains it")


def test_nothing_is_unexplained_in_sound_cameras():
    assert unexplained(diagnose(sound("shelf", 80), max_offset=5)) == []


def test_two_cameras_do_not_tell_a_late_or_scaled_one_from_a_turned_one(data_folder):
    """The trial's videos are synchronised and of the calibrated size; its calibration is off by centimetres."""
    clip = Clips(DataConfig(name="pose2sim", path=str(data_folder / TRIAL)))[0]
    for views in ([0, 2], [2, 3]):
        found = diagnose(clip.select(views=views), max_offset=10)
        assert found.findings == ()
        a, b = (clip.rig.names[view] for view in views)
        assert any(each.startswith(f"{a} and {b} disagree, and one that moved") for each in found.unknown)


def test_the_remedy_is_a_change_to_the_file_if_the_format_has_no_options():
    found = diagnose(written(sound("campus"), unit=LengthUnit.mm, up=UpDirection.y), max_offset=5).findings
    assert [finding.fault.name for finding in found] == ["unit", "up"]
    assert "multiply the translations of all cameras by 0.001: they are in mm" in found[0].remedy
    assert "replace R by R Q^T, where Q = [[1, 0, 0], [0, 0, -1], [0, 1, 0]]" in found[1].remedy


def test_a_camera_that_was_turned_is_named():
    clip = sound("shelf", 80)
    pose = clip.rig.cam_from_world.copy()
    tilt = np.deg2rad(8)
    pose[2, :3] = [[1, 0, 0], [0, np.cos(tilt), -np.sin(tilt)], [0, np.sin(tilt), np.cos(tilt)]] @ pose[2, :3]
    moved = replace(clip, rig=replace(clip.rig, cam_from_world=pose))
    (finding,) = diagnose(moved, max_offset=5).findings
    # Three seconds do not always tell a turned camera from one that also stands elsewhere.
    assert finding.fault.name in ("turned", "differs")
    assert finding.cameras == ("2",)
    assert re.search(r"turned by [78]\.\d\d degrees", finding.evidence)
    assert "calibrate camera 2 again" in finding.remedy


def test_what_cannot_be_decided_is_reported_as_unknown():
    clip = sound("ring", 80)
    one = diagnose(clip.select(views=[1]))
    assert (one.pairs, one.findings, one.unknown) == ((), (), ("nothing can be compared: there is one camera",))
    xy = clip.detections.xy.copy()
    xy[:, 2] = np.nan
    without = diagnose(seen(clip, xy, np.where(np.isnan(xy[..., 0]), np.nan, 0.5)), max_offset=5)
    assert (without.findings, without.unknown) == ((), ("cam2 detects no people",))
    still = np.repeat(clip.detections.xy[50:51], len(clip), 0)
    frozen = diagnose(seen(clip, still, np.repeat(clip.detections.score[50:51], len(clip), 0)), max_offset=5)
    assert frozen.findings == ()
    assert frozen.unknown == ("people move too little to decide whether the cameras are synchronised",)
    with pytest.raises(ValueError, match="max_offset=-1: expected a number of frames"):
        diagnose(clip, max_offset=-1)
    alone = diagnose(seen(clip, np.full_like(xy, np.nan), np.full(xy.shape[:-1], np.nan)))
    assert alone.findings == ()
    assert "nothing can be compared: no two cameras detect people in the same frame" in alone.unknown


@pytest.mark.parametrize("suspects", [(1,), (0, 1)])
def test_a_suspicion_is_a_question_not_a_verdict(suspects):
    """Beside "nothing found wrong", an exact calibration was said to seem wrong."""
    campus = sound("campus")
    tried = (CameraDifference(1, Kind.focal, np.full(Q, 0.2), 1.0, np.ones(4), np.ones(4)),)
    (said,) = undetermined(Hypothesis.of(campus, Convention()), Examination((), suspects, tried, None, {}))
    names = " or ".join(f"camera {campus.rig.names[view]}" for view in suspects)
    assert said.startswith(f"whether {names} differs from its calibration: ") and "seems" not in said


def test_the_command_prints_and_writes_findings_and_exits_by_them(tmp_path, capsys, monkeypatch):
    save_clip(sound("campus"), tmp_path / "sound")
    with monkeypatch.context() as patch:
        patch.setattr("dmae.progress.LINE_EVERY", 0.005)
        command.run(DoctorCommand(DataConfig(path=str(tmp_path / "sound")), max_offset=5), tmp_path / "good")
    printed, progress = capsys.readouterr()
    unknown = "not known: " in printed
    assert f"nothing found wrong{'; what is not known is listed above' if unknown else ''}\n" in printed
    assert "0-2" in printed
    assert re.search("comparing cameras: [1-3] of 3", progress)
    assert re.search(r"examining cameras: [1-9]\d* of 12", progress)
    save_clip(inverse(sound("campus"), 1), tmp_path / "faulty")
    done = run_command(tmp_path, "dmae", "doctor", "data=faulty", "out=bad", "max_offset=4")
    assert (done.returncode, done.stderr) == (1, "")
    assert "correction: in the calibration of camera 1, invert the extrinsics" in done.stdout
    written_json = json.loads((tmp_path / "bad/doctor.json").read_text())
    assert written_json["findings"][0]["cameras"] == ["1"]
    assert (tmp_path / "bad/doctor.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize("kind", Kind)
def test_the_options_of_a_remedy_are_those_of_dmae_calibrate(kind, tmp_path):
    given = Hypothesis.of(sound("campus"), Convention())
    differences = [CameraDifference(0, each, np.zeros(Q), 1.0, np.ones(4), np.ones(4)) for each in (kind, Kind.turned)]
    said = _remedy(differences, given, given, None).partition("run dmae calibrate with the same data")[2].split()
    assert len(said) == (kind in (Kind.focal, Kind.lens, Kind.late))
    compose(DMAE.commands["calibrate"], ["data=pose2sim", f"data.path={tmp_path}", *said])


def test_what_is_not_known_is_said_with_nothing_found_wrong(capsys):
    doubtful = Diagnosis((PairFit(("0", "1"), 1.0, 1.0, 0.5, 9),), (), (), ("which of two cameras differs",))
    command._print(sound("campus"), doubtful, True)
    assert capsys.readouterr().out.endswith("nothing found wrong; what is not known is listed above\n")


def test_what_length_a_correction_needs_is_said_with_the_finding(capsys):
    remedy = "calibrate camera 1 again, or run dmae calibrate with the same data"
    found = Diagnosis((), (), (Finding(Fault.scale, ("1",), "it moved", remedy),), ())
    short = sound("campus")
    command._print(short, found, True)
    said = f"campus: the recording lasts {len(short) / short.fps:.1f} s, so dmae calibrate leaves larger errors"
    assert len(short) / short.fps < 10 and said in capsys.readouterr().out
    command._print(replace(short, fps=len(short) / 30), found, True)
    assert "lasts" not in capsys.readouterr().out


def test_a_camera_turned_is_not_called_one_of_another_resolution():
    """Where a turn explains more than a scale does and yet is not certain, neither is named."""
    clip = sound("ring")
    step = np.zeros((4, Q))
    step[1, ROTATION] = np.radians(2) * np.array([0.6, 0.64, 0.48])
    hypothesis = Hypothesis.of(replace(clip, rig=Calibration.of(clip.rig).changed(step).rig), Convention())
    found, pairs = examined(hypothesis)[0], pairs_to_compare(4)
    scale = Correction(Fault.scale, (1,), rescale(hypothesis, [1], 1.05), 1.05)
    assert not _confirmed(scale, hypothesis, found, pairs)
    small = Hypothesis.of(scaled(clip, 0.5, 1), Convention())
    scale = Correction(Fault.scale, (1,), rescale(small, [1], 0.5), 0.5)
    assert _confirmed(scale, small, examined(small)[0], pairs)


def test_offsets_do_not_make_up_for_the_pose_of_another_camera():
    clip, pairs, third = sound("ring"), pairs_to_compare(4), np.arange(4) == 2
    step = np.zeros((4, Q))
    step[1, ROTATION] = np.radians(2) * np.array([0.6, 0.64, 0.48])
    hypothesis = Hypothesis.of(replace(clip, rig=Calibration.of(clip.rig).changed(step).rig), Convention())
    delay = Correction(Fault.delay, (2,), hypothesis.delayed(-3 * third))
    assert not _confirmed(delay, hypothesis, examined(hypothesis)[0], pairs)
    behind = Hypothesis.of(late(clip, 3, 2), Convention())
    delay = Correction(Fault.delay, (2,), behind.delayed(3 * third))
    assert _confirmed(delay, behind, examined(behind)[0], pairs)


@pytest.mark.parametrize("frames", [2, 3, 5])
def test_an_offset_is_not_left_half_way_between_two_frames(frames):
    """Lines in the image are fitted around whole frames, and their cost has a step there."""
    clip = sound("ring")
    xy = clip.detections.xy + np.random.default_rng(0).normal(0, 6, clip.detections.xy.shape).astype(np.float32)
    clip = late(replace(clip, detections=replace(clip.detections, xy=xy)), frames, 2)
    observations, calibration = Observations.of(match_tracks(clip), BODIES), Calibration.of(clip.rig)
    bodies = _start(observations, adjust(observations, calibration))
    found = _fit(observations, calibration, bodies, 2, Kind.late)
    assert -found.calibration.offset[2] * clip.fps == pytest.approx(frames, abs=0.2)


CLIPS = {"dogs": (lambda: dog_clip(70, dogs=2), 4.0), "hands": (lambda: hands_clip(70), 8.0)}


def camera_turned(clip: Clip, view: int, degrees: float) -> Clip:
    world = clip.rig.cam_from_world.copy()
    turn = np.eye(4)
    turn[:3, :3] = Rotation.from_euler("y", degrees, degrees=True).as_matrix()
    world[view] = turn @ world[view]
    return replace(clip, rig=replace(clip.rig, cam_from_world=world))


@pytest.mark.parametrize("kind", CLIPS)
def test_sound_cameras_have_no_findings_and_a_turned_one_is_named(kind):
    make, degrees = CLIPS[kind]
    clip = make()
    assert not diagnose(clip, max_offset=10).findings
    (finding,) = diagnose(camera_turned(clip, 1, degrees), max_offset=10).findings
    # Bodies as small as hands do not always tell a turned camera from one that also stands elsewhere.
    assert finding.fault.name in ("turned", "differs", *(("unexplained",) if kind == "hands" else ()))
    assert finding.cameras == ("cam1",)


def test_shelf_has_the_same_findings_and_floor_as_files_of_openpose(data_folder, diagnosis_of_shelf, tmp_path):
    source, out = DataConfig("shelf", str(data_folder / "shelf")), tmp_path / "openpose"
    convert_command.run(ConvertCommand(source, "openpose", str(out)), out)
    expected, found = diagnosis_of_shelf, diagnose(Clips(DataConfig("openpose", str(out), fps=25.0))[0], max_offset=10)
    assert not expected.findings and not found.findings
    assert 0 < expected.floor.tilt_deg == pytest.approx(found.floor.tilt_deg, abs=0.01)
    assert expected.floor.height_m == pytest.approx(found.floor.height_m, abs=1e-3)


@pytest.mark.slow
def test_a_moved_camera_is_undone_in_the_unit_of_its_calibration():
    """In mm its 30 cm were undone by 0.3 mm, and residuals were those of people of a kilometre."""
    clip = sound("shelf", 80)
    pose = clip.rig.cam_from_world.copy()
    pose[2, :3, 3] += pose[2, :3, :3] @ [0.3, 0.2, 0.0]
    moved = replace(clip, rig=replace(clip.rig, cam_from_world=pose))
    found = diagnose(written(moved, unit=LengthUnit.mm), Convention(), max_offset=5)
    assert [finding.cameras for finding in found.findings] == [("2",), tuple("01234")]
    after, before = (float(value) for value in re.findall(r"([\d.]+) px", found.findings[0].evidence))
    assert after < before / 2 < 50
