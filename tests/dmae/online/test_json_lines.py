"""Lines of JSON: the same people as without them, and no line that ends the run."""

import json
import re
import socket
import subprocess
import time
from dataclasses import replace
from io import BytesIO

import numpy as np
import pytest

from dmae.commands import live
from dmae.commands.config import LiveCommand, WorldConfig
from dmae.data.clip import Source
from dmae.data.skeleton import BODY25
from dmae.formats.calibrations import write_calibration
from dmae.formats.config import Convention, LengthUnit, UpDirection
from dmae.online.capture import OnlineCapture
from dmae.online.json_lines import answer_lines, read_frame
from dmae.reconstruction.config import CaptureConfig
from tests.support.commands import command_line
from tests.support.detected_people import crossing, detected_clip

CLIP = detected_clip(crossing()[:40], views=4)
CAMERAS = CLIP.rig.names


def line(frame: int, views: range | list[int] = range(4)) -> str:
    cameras = {}
    for view in views:
        found = np.concatenate([CLIP.detections.xy, CLIP.detections.score[..., None]], -1)[frame, view]
        cameras[CAMERAS[view]] = [
            [None if np.isnan(joint[0]) else joint.tolist() for joint in detection] for detection in found
        ]
    return json.dumps({"cameras": cameras})


def online() -> OnlineCapture:
    return OnlineCapture(CLIP.rig, BODY25, CLIP.fps, CaptureConfig())


def answered(lines: list[str]) -> list[dict]:
    return [json.loads(each) for each in answer_lines(lines, online(), CAMERAS, BODY25, CLIP.fps)]


def test_the_answers_are_what_online_capture_finds():
    about, *answers = answered([line(frame) for frame in range(40)])
    assert about["joints"] == list(BODY25.joints) and about["cameras"] == list(CAMERAS)
    assert about["delay_frames"] == online().delay
    capture = online()
    expected = [done for frame in range(40) for done in capture.push(CLIP.detections.select([frame]))]
    expected += capture.flush()
    assert [answer["frame"] for answer in answers] == list(range(40))
    for answer, frame in zip(answers, expected, strict=True):
        assert [person["id"] for person in answer["people"]] == frame.people.tolist()
        for number, person in enumerate(answer["people"]):
            xyz = np.array([[np.nan] * 3 if joint is None else joint for joint in person["xyz"]])
            np.testing.assert_allclose(xyz, frame.poses.xyz[0, number], atol=1e-4)
            assert person["source"] == [Source(kind).name.lower() for kind in frame.poses.source[0, number]]
            assert [error is None for error in person["error_mm"]] == np.isnan(xyz[:, 0]).tolist()


def test_a_dropped_camera_is_named_and_survived():
    lines = [line(frame, [0, 1, 3] if 10 <= frame < 30 else range(4)) for frame in range(40)]
    _, *answers = answered(lines)
    assert [answer["missing"] for answer in answers] == [["cam2"] if 10 <= frame < 30 else [] for frame in range(40)]
    assert all(len(answer["people"]) == 3 for answer in answers)


@pytest.mark.parametrize(
    ("broken", "message"),
    [
        ("{", "expected a frame as JSON"),
        ("[" * 100_000, "expected a frame as JSON"),
        ("[]", 'expected {"cameras": {name: detections, ...}}, found []'),
        ('{"cameras": {"attic": []}}', r"no cameras ['attic'] in the calibration; there are ['cam0',"),
        ('{"cameras": {"cam0": 3}}', "camera 'cam0': expected a list of at most 1000 detections, found 3"),
        ('{"cameras": {"cam0": [[[1, 2, 3]]]}}', "expected a list of the 25 joints of body25, found 1 of them"),
        ('{"cameras": {"cam1": [[' + "[1, 2]," * 24 + "[1, 2]]]}}", "camera 'cam1', detection 0: expected each joint"),
        ('{"cameras": {"cam1": [[' + '"a",' * 24 + "[1, 2, 3]]]}}", "camera 'cam1', detection 0: expected each joint"),
        (" " * 4_000_000 + "{}", "a line of 4000002 characters"),
    ],
)
def test_a_broken_line_is_answered_and_the_run_goes_on(broken, message):
    lines = [line(frame) for frame in range(40)]
    _, *answers = answered([*lines[:20], broken, "", *lines[20:]])
    errors = [answer for answer in answers if "error" in answer]
    assert [error["frame"] for error in errors] == [20] and message in errors[0]["error"]
    found = [answer for answer in answers if "error" not in answer]
    assert [answer["frame"] for answer in found] == list(range(41))
    assert found[20]["missing"] == list(CAMERAS)
    assert {person["id"] for person in found[40]["people"]} == {person["id"] for person in found[0]["people"]}


def test_joints_without_meaning_are_absent():
    joints = [[1.0, 2.0, 0.0], [1.0, 2.0, -1.0], [float("nan"), 1.0, 0.5], [1e999, 1.0, 0.5], *[[1.0, 2.0, 0.5]] * 21]
    found, missing = read_frame(json.dumps({"cameras": {"cam3": [joints]}}), CAMERAS, BODY25)
    assert missing == ["cam0", "cam1", "cam2"]
    assert np.flatnonzero(~found.observed[0, 3, 0]).tolist() == [0, 1, 2, 3]


def test_a_line_that_is_too_long_is_one_frame(monkeypatch):
    """What is behind its cut would be frames of their own, and all later ones would be late."""
    monkeypatch.setattr(live, "LONGEST", 10)
    sent = b"a" * 10 + b"\n" + b"b" * 11 + b"\n" + b"c" * 35 + b"\nlast"
    assert [line[:1] for line in live.lines_of(BytesIO(sent))] == ["a", "b", "c", "l"]


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"fps": 0.0}, "fps: expected frames per second"),
        ({"fps": np.nan}, "fps: expected frames per second"),
        ({"capture": CaptureConfig(persons=2)}, "capture.persons"),
        ({}, r"listen=203\.0\.113\.1:0: Cannot assign requested address; give another address or port"),
    ],
)
def test_impossible_options_are_refused_before_a_program_connects(tmp_path, options, said):
    write_calibration(replace(CLIP.rig, names=CAMERAS), tmp_path / "rig.toml", "pose2sim")
    given = {"fps": 25.0, "listen": "203.0.113.1:0"} | options  # An address that cannot be listened on
    with pytest.raises(ValueError, match=said):
        live.run(LiveCommand(calibration=str(tmp_path / "rig.toml"), **given), None)


def test_weights_that_complete_nothing_are_refused():
    with pytest.raises(ValueError, match="weights=model: nothing is completed; add complete=true"):
        LiveCommand(calibration="rig.toml", fps=25.0, weights="model")


@pytest.mark.parametrize(("every", "said"), [(60.0, 1), (0.0, 4)])
def test_answers_that_fall_behind_are_said_each_minute_and_at_the_end(monkeypatch, capsys, every, said):
    """Frames of the first second do not count: they compile."""
    monkeypatch.setattr(live, "LINE_EVERY", every)
    for number, line in enumerate(live.timed(["a frame"] * 54, fps=50)):
        assert line == "a frame"
        time.sleep(0.03 if number in (0, *range(50, 54)) else 0)
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == said
    took = re.fullmatch(
        r"answers fall behind the cameras: a frame took (\S+) ms, and there are 20 ms at 50 frames/s", lines[-1]
    )
    assert took and float(took[1]) >= 30
    for _ in live.timed(["a frame"] * 8, fps=2):
        pass
    assert capsys.readouterr().err == ""


def test_the_command_takes_the_conventions_of_a_calibration(tmp_path, monkeypatch, capsys):
    written = Convention(LengthUnit.cm, UpDirection.y)
    write_calibration(written.written_rig(replace(CLIP.rig, names=CAMERAS)), tmp_path / "rig.toml", "pose2sim")
    monkeypatch.setattr("sys.stdin", [line(frame) for frame in range(25)])
    world = WorldConfig(LengthUnit.cm, UpDirection.y)
    live.run(LiveCommand(calibration=str(tmp_path / "rig.toml"), fps=CLIP.fps, world=world), None)
    people = json.loads(capsys.readouterr().out.splitlines()[-1])["people"]
    hips = [person["xyz"][BODY25.joints.index("mid_hip")] for person in people]
    assert len(hips) == 3 and all(0.5 < z < 1.3 for *_, z in hips)


@pytest.mark.slow
@pytest.mark.parametrize("by", ["pipe", "socket"])
def test_the_command_answers_other_programs(tmp_path, by):
    rig = replace(CLIP.rig, names=CAMERAS)
    write_calibration(rig, tmp_path / "rig.toml", "pose2sim")
    arguments = ["live", "calibration=rig.toml", f"fps={CLIP.fps:g}"]
    lines = "".join(f"{line(frame)}\n" for frame in range(25))
    if by == "pipe":
        done = subprocess.run(
            command_line("dmae", *arguments), cwd=tmp_path, input=lines, capture_output=True, text=True, check=True
        )
        answers = done.stdout.splitlines()
    else:
        command = command_line("dmae", *arguments, "listen=127.0.0.1:0")
        with subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, text=True) as process:
            port = int(process.stdout.readline().rpartition(":")[2])
            for _ in range(2):  # one program after the other
                with socket.create_connection(("127.0.0.1", port), timeout=60) as connection:
                    connection.sendall(lines.encode())
                    connection.shutdown(socket.SHUT_WR)
                    answers = connection.makefile().read().splitlines()
            process.terminate()
    assert [json.loads(answer).get("frame") for answer in answers] == [None, *range(25)]
    assert len(json.loads(answers[-1])["people"]) == 3
