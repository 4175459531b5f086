"""Data sets that commands write grow clip by clip, and are never a mixture; what is printed is what was written."""

import re
import shutil
import sys
from dataclasses import replace
from pathlib import Path
from threading import Thread

import numpy as np
import pytest

from dmae.commands import capture as command
from dmae.commands import complete, convert, detect, doctor, train
from dmae.commands.config import CaptureCommand, CompleteCommand, ConvertCommand, DetectCommand, DoctorCommand
from dmae.commands.data_sets import (
    SETTINGS,
    ClipSet,
    describe_joints,
    describe_people,
    describe_sides,
    finished,
    forecast,
)
from dmae.completion import weights
from dmae.data.clip import Poses3D, Source
from dmae.data.conversion import convert as convert_poses
from dmae.data.skeleton import BODY25, SHELF14
from dmae.data.store import load_clip, read_manifest, save_clip, write_manifest
from dmae.evaluation import evaluate as evaluation
from dmae.evaluation.config import EvaluateConfig
from dmae.evaluation.review import Decision, ReviewVerdict, save_decisions
from dmae.files import checksums
from dmae.files.checksums import find_data_set_damage
from dmae.formats.calibrations import write_calibration
from dmae.formats.config import Convention, DataConfig, UpDirection
from dmae.formats.reading import Clips
from dmae.reconstruction.config import CaptureConfig
from tests.support.clips import full_clip, walkers
from tests.support.commands import Done, run_command
from tests.support.stressed_clips import strollers

NAMES = ("a", "b", "c")


def with_absences() -> Poses3D:
    """Two people in 12 frames: the second is there in 9; of the first some joints are completed, some absent."""
    poses = walkers()
    xyz, source = poses.xyz.copy(), poses.source.copy()
    xyz[:3, 1], source[:3, 1] = np.nan, Source.ABSENT
    xyz[5, 0, :5], source[5, 0, :5] = np.nan, Source.ABSENT
    source[6, 0, :10] = Source.COMPLETED
    return Poses3D(BODY25, xyz, source)


def test_cameras_that_disagree_on_sides_are_not_accused(monkeypatch):
    exchanged, disagreeing = np.zeros((2, 12, 4), bool)
    exchanged[:3, 0], disagreeing[4:9, 1:3] = True, True
    monkeypatch.setattr("dmae.commands.data_sets.exchanged_detections", lambda clip, poses: (exchanged, disagreeing))
    clip = full_clip()
    names = clip.rig.names
    accused, said = describe_sides(clip, Poses3D(clip.detections.skeleton, walkers().xyz), "put right")
    assert accused.endswith("its detections have left and right exchanged in 3 of 12 frames, put right")
    assert said.startswith(f"cameras {names[1]}, {names[2]} disagree on left and right of a person in 5 of 12 frames")


def test_absent_joints_and_absent_people_are_counted_separately():
    said = describe_joints(with_absences())
    joints = 21 * 25
    assert said == (
        f"joints {1 - 15 / joints:.1%} measured, {10 / joints:.1%} completed, {5 / joints:.1%} absent; not counting 3 "
        f"of 24 person-frames (12.5%) in which no joint of the person is known: with them {(3 * 25 + 5) / 600:.1%} of "
        "all joints are NaN"
    )
    assert "person-frames" not in describe_joints(walkers())
    assert describe_people(with_absences()) == "captured in P1 100.0%, P2 75.0% of 12 frames"
    # Completion adds no frame to those in which a person is captured, and rejection takes none away.
    source, views = with_absences().source.copy(), np.zeros((12, 2, 25), int)
    source[2, 1], source[7, 1], views[7, 1, 0] = Source.COMPLETED, Source.COMPLETED, 2
    xyz = np.where((source == Source.ABSENT)[..., None], np.nan, walkers().xyz)
    completed = Poses3D(BODY25, xyz, source, views=views)
    assert describe_people(completed) == "captured in P1 100.0%, P2 75.0% of 12 frames; only completed in P2 8.3%"
    views = np.zeros((12, 2, 25), int)
    views[6, 0, :4] = 2
    said = describe_joints(replace(with_absences(), views=views))
    assert (
        f"{10 / joints:.1%} completed ({4 / joints:.1%} rejected and replaced, {6 / joints:.1%} not measured)" in said
    )
    # No share is told twice.
    smoothed = np.full((12, 2, 25), Source.DENOISED)
    assert describe_joints(Poses3D(BODY25, walkers().xyz, smoothed)).startswith("joints 100.0% measured (smoothed), ")
    smoothed[:3] = Source.MEASURED
    said = describe_joints(Poses3D(BODY25, walkers().xyz, smoothed))
    assert said.startswith("joints 100.0% measured (75.0% of all smoothed), ")
    assert describe_joints(walkers().without(np.ones((12, 2, 25), bool))) == "no person captured"


def test_captured_clips_are_of_one_content_of_own_code(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    save_clip(full_clip(), tmp_path / "set/a")
    write_manifest(tmp_path / "set", [{"id": "a", "status": "ok"}])
    own = "import dmae\n\ndef capture(clip, config):\n    return clip.truth\n"
    (tmp_path / "own_capture.py").write_text(own)
    config = CaptureCommand(DataConfig(path="set"), CaptureConfig(method="own_capture:capture"))
    command.run(config, tmp_path / "out")
    command.run(config, tmp_path / "out")
    assert "1 of 1 clips are done already" in capsys.readouterr().out
    (tmp_path / "own_capture.py").write_text(own + "\n")
    with pytest.raises(ValueError, match="differs in code"):
        command.run(config, tmp_path / "out")


def test_clips_without_frames_take_no_time(tmp_path):
    save_clip(full_clip().select(frames=[]), tmp_path)
    said = evaluation.forecast(EvaluateConfig(DataConfig(path=str(tmp_path)), methods=["linear"]))
    assert said.startswith("1 clip, 0 frames: about 0")
    said = forecast(CaptureCommand(), 2, lambda number: (0, full_clip().select(frames=[])))
    assert said.startswith("2 clips, 0 frames: about 0")


@pytest.mark.parametrize("run", [
    lambda path, out: command.run(CaptureCommand(DataConfig(path=path)), out),
    lambda path, out: command.run(CaptureCommand(DataConfig(path=path), dry_run=True), out),
    lambda path, out: complete.run(CompleteCommand(clip=path), out),
    lambda path, out: complete.run(CompleteCommand(clip=path, dry_run=True), out),
    lambda path, out: detect.run(DetectCommand(clip=path), out),
    lambda path, out: convert.run(ConvertCommand(DataConfig(path=path)), out),
    lambda path, out: doctor.run(DoctorCommand(DataConfig(path=path)), out),
])  # fmt: skip
def test_a_data_set_without_a_whole_clip_is_refused(tmp_path, run):
    (tmp_path / "set").mkdir()
    write_manifest(tmp_path / "set", [{"id": "a", "status": "failed"}])
    with pytest.raises(ValueError, match="set: no clip of this data set is ok, nothing to do"):
        run(str(tmp_path / "set"), tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("run", "config"),
    [
        (command.run, lambda folder: CaptureCommand(DataConfig(path=folder))),
        (complete.run, lambda folder: CompleteCommand(clip=folder)),
        (convert.run, lambda folder: ConvertCommand(DataConfig(path=folder), format="clip")),
        (detect.run, lambda folder: DetectCommand(clip=folder)),
    ],
)
def test_a_clip_is_never_overwritten_by_what_is_made_of_it(tmp_path, run, config):
    """A second run would smooth the joints again, or find only the frames that the first had kept."""
    save_clip(full_clip(), tmp_path / "walk")
    before = contents(tmp_path / "walk")
    (tmp_path / "same").symlink_to("walk")
    with pytest.raises(ValueError, match=f"expected another folder than .*for example out={tmp_path}/walk_2"):
        run(config(str(tmp_path / "walk")), tmp_path / "same")
    assert contents(tmp_path / "walk") == before


def test_the_printed_share_is_that_of_nan_in_the_export(tmp_path):
    save_clip(replace(full_clip(), poses=with_absences()), tmp_path / "clip")
    done = run_command(tmp_path, "dmae", "complete", "clip=clip", "out=full")
    assert done.returncode == 0, done.stderr
    assert run_command(tmp_path, "dmae", "export", "clip=full", "out=full.npz").returncode == 0
    with np.load(tmp_path / "full.npz") as archive:
        share = np.isnan(archive["joints"]).any(-1).mean()
    assert float(re.search(r"with them ([\d.]+)% of all joints", done.stdout)[1]) == pytest.approx(
        100 * share, abs=0.06
    )


def test_blanked_joints_need_not_be_joints_of_the_completed_skeleton(tmp_path, monkeypatch):
    """Weights of two skeletons return poses on the second."""

    class Turned:
        notes = staticmethod(lambda poses, fps: [])

        def __call__(self, poses, fps):
            return convert_poses(poses, SHELF14)

    save_clip(replace(full_clip(), poses=walkers()), tmp_path / "clip")
    save_decisions(tmp_path / "clip", walkers(), [Decision(0, "l_heel", 0, 3, ReviewVerdict.blank)])
    monkeypatch.setattr(complete, "completers", lambda *_, **__: lambda skeleton: Turned())
    complete.run(CompleteCommand(clip=str(tmp_path / "clip")), tmp_path / "out")
    assert load_clip(tmp_path / "out").poses.skeleton == SHELF14


def test_completed_clips_are_of_one_content_of_the_weights_of_the_package(tmp_path, monkeypatch):
    save_clip(replace(full_clip(), poses=walkers()), tmp_path / "set/a")
    write_manifest(tmp_path / "set", [{"id": "a", "status": "ok"}])
    config = CompleteCommand(clip=str(tmp_path / "set"))
    complete.run(config, tmp_path / "out")
    complete.run(config, tmp_path / "out")
    shutil.copytree(weights.SHIPPED, tmp_path / "updated", ignore=shutil.ignore_patterns("*.safetensors"))
    with (tmp_path / "updated/body25/model.json").open("a") as record:
        record.write("\n")
    monkeypatch.setattr(weights, "SHIPPED", tmp_path / "updated")
    with pytest.raises(ValueError, match=r"differs in options\.weights"):
        complete.run(config, tmp_path / "out")


def test_what_is_whole_is_a_data_set_even_after_an_error(tmp_path):
    with pytest.raises(KeyboardInterrupt), ClipSet(tmp_path, {"command": "dmae x"}) as made:
        made.write(full_clip(), "a")
        raise KeyboardInterrupt
    assert read_manifest(tmp_path) == [{"id": "a", "status": "ok"}]
    assert find_data_set_damage(tmp_path, ["a"]) == []
    assert finished(None, tmp_path) == f"{tmp_path}: 1 whole clip, which can be used; the same command continues"
    with ClipSet(tmp_path / "none", {"command": "dmae x"}):
        pass
    assert not (tmp_path / "none").exists()
    assert finished(None, tmp_path / "none") == "nothing was written; the same command continues"


def test_commands_that_end_together_list_the_clips_of_both(tmp_path, monkeypatch):
    one, other = ClipSet(tmp_path, {"command": "dmae x"}), ClipSet(tmp_path, {"command": "dmae x"})
    writing = checksums.write_manifest

    def while_the_other_ends(path, lines):
        """The other writes its clip, and leaves, after this one has looked which clips there are."""
        monkeypatch.setattr(checksums, "write_manifest", writing)
        other.write(full_clip(), "b")
        ending.start()
        ending.join(0.5)
        writing(path, lines)

    monkeypatch.setattr(checksums, "write_manifest", while_the_other_ends)
    with one:
        other.__enter__()
        one.write(full_clip(), "a")
        ending = Thread(target=other.__exit__, args=(None, None, None))
    ending.join()
    assert [line["id"] for line in read_manifest(tmp_path)] == ["a", "b"]
    assert find_data_set_damage(tmp_path, ["a", "b"]) == []


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """Return a folder with `data`, a data set of three clips, and `whole`, which was captured from it at once."""
    folder = tmp_path_factory.mktemp("unfinished")
    for name in NAMES:
        save_clip(strollers(frames=10, persons=1, views=3, name=name), folder / "data" / name)
    write_manifest(folder / "data", [{"id": name, "status": "ok"} for name in NAMES])
    assert run(folder, "whole").returncode == 0
    return folder


def run(folder: Path, out: str, *options: str) -> Done:
    return run_command(folder, "dmae", "capture", "data=data", f"out={out}", *options)


def test_clips_are_of_one_content_of_another_calibration(tmp_path):
    save_clip(strollers(frames=10, persons=1, views=3, name="a"), tmp_path / "data" / "a")
    write_manifest(tmp_path / "data", [{"id": "a", "status": "ok"}])
    (clip,) = Clips(DataConfig(path=str(tmp_path / "data")))
    write_calibration(clip.rig, tmp_path / "rig.toml", "pose2sim")
    config = CaptureCommand(DataConfig(path=str(tmp_path / "data"), calibration=str(tmp_path / "rig.toml")))
    command.run(config, tmp_path / "captured")
    write_calibration(replace(clip.rig, dist=clip.rig.dist + 0.001), tmp_path / "rig.toml", "pose2sim")
    with pytest.raises(ValueError, match=r"settings\.json differs in options\.data\.calibration"):
        command.run(config, tmp_path / "captured")


def test_doctor_explains_its_columns_once(tmp_path, capsys):
    for name in ("a", "b"):
        save_clip(strollers(frames=30, persons=2, views=3, name=name), tmp_path / "set" / name)
    write_manifest(tmp_path / "set", [{"id": "a", "status": "ok"}, {"id": "b", "status": "ok"}])
    doctor.run(DoctorCommand(DataConfig(path=str(tmp_path / "set"))), tmp_path / "out")
    said = capsys.readouterr().out
    assert (said.count("pairs of cameras"), said.count("agreeing: share of people")) == (2, 1)


def test_doctor_names_the_way_to_an_option_where_a_clip_has_none(tmp_path):
    clip = strollers(frames=60, persons=2, views=3, name="a")
    save_clip(replace(clip, rig=Convention(up=UpDirection.y).written_rig(clip.rig)), tmp_path / "a")
    done = run_command(tmp_path, "dmae", "doctor", "data=a", "max_offset=4")
    assert "or by an option, which dmae doctor names if data.calibration= is the file" in done.stdout, done.stdout
    write_calibration(Convention(up=UpDirection.y).written_rig(clip.rig), tmp_path / "rig.toml", "pose2sim")
    done = run_command(tmp_path, "dmae", "doctor", "data=a", "data.calibration=rig.toml", "max_offset=4")
    assert "correction: data.up=y" in done.stdout, done.stdout
    given = ("capture", "data=a", "data.calibration=rig.toml")
    wrong, right = (run_command(tmp_path, "dmae", *given, *each) for each in (("out=w",), ("data.up=y", "out=r")))
    said = (
        "all the time, or another axis than z is up: dmae doctor, with the same data=..., names the value for data.up"
    )
    assert said in wrong.stdout and said not in right.stdout


def contents(path: Path) -> dict[str, bytes]:
    files = (file for file in path.rglob("*") if file.is_file() and file.name != "config.yaml")
    return {file.relative_to(path).as_posix(): file.read_bytes() for file in files}


@pytest.fixture
def captured(monkeypatch) -> list[str]:
    """The clips that are captured. The one called `stop` in the list interrupts."""
    done: list[str] = []

    def counted(clip, config, noise, capture=command.capture):
        if done[-1:] == ["b"] and "stop" in done:
            raise KeyboardInterrupt
        done.append(clip.id)
        return capture(clip, config, noise)

    monkeypatch.setattr(command, "capture", counted)
    return done


def interrupt(folder: Path, out: str, captured: list[str], *options: str) -> None:
    """Interrupt a capture at the last clip."""
    captured[:] = ["stop"]
    assert run(folder, out, *options).returncode == 130
    assert captured == ["stop", "a", "b"]
    captured.clear()


def test_an_interrupted_capture_goes_on(folder, captured):
    interrupt(folder, "one", captured)
    assert find_data_set_damage(folder / "one", "ab") == []
    assert run(folder, "one").returncode == 0
    assert captured == ["c"]
    assert contents(folder / "one") == contents(folder / "whole")
    assert "3 of 3 clips are done already" in run(folder, "one").stdout
    assert captured == ["c"]


def test_a_killed_capture_goes_on_without_damaged_clips(folder, captured):
    interrupt(folder, "two", captured)
    for name in ("manifest.jsonl", "checksums.json", "b/checksums.json"):  # as SIGKILL leaves it
        (folder / "two" / name).unlink()
    assert run(folder, "two").returncode == 0
    assert captured == ["b", "c"]
    data = bytearray((folder / "two/a/arrays.safetensors").read_bytes())
    data[-1] ^= 1
    (folder / "two/a/arrays.safetensors").write_bytes(data)
    captured.clear()
    assert run(folder, "two").returncode == 0
    assert captured == ["a"]
    assert contents(folder / "two") == contents(folder / "whole")


def test_several_machines_fill_one_folder(folder, captured):
    for part in ("first=2", "clips=1", "first=1 clips=1"):
        assert run(folder, "parts", *part.split()).returncode == 0
    assert captured == ["c", "a", "b"]
    assert contents(folder / "parts") == contents(folder / "whole")


def spoil(clip: Path) -> bytes:
    """Cut the arrays of a clip, and return what they were."""
    arrays = clip / "arrays.safetensors"
    before = arrays.read_bytes()
    arrays.write_bytes(before[:100])
    return before


@pytest.mark.parametrize("workers", [1, 2])
def test_a_clip_that_fails_is_noted_and_the_others_are_made(folder, tmp_path, workers):
    shutil.copytree(folder / "data", tmp_path / "data")
    arrays = spoil(tmp_path / "data/b")
    done = run(tmp_path, "out", f"workers={workers}")
    assert done.returncode == 0, done.stderr
    ok, failed, last = read_manifest(tmp_path / "out")
    assert (ok, last) == ({"id": "a", "status": "ok"}, {"id": "c", "status": "ok"})
    assert (failed["id"], failed["status"]) == ("b", "failed") and "b/arrays.safetensors" in failed["reason"]
    assert f"b: failed: {failed['reason']}" in done.stdout and "1 of 3 clips failed" in done.stdout
    assert find_data_set_damage(tmp_path / "out", "ac") == []
    # The same command tries it again.
    (tmp_path / "data/b/arrays.safetensors").write_bytes(arrays)
    assert run(tmp_path, "out").returncode == 0
    assert contents(tmp_path / "out") == contents(folder / "whole")


def test_a_run_in_which_every_clip_fails_ends_with_an_error(folder, tmp_path):
    shutil.copytree(folder / "data", tmp_path / "data")
    done = run(tmp_path, "out", "draw=[9]")
    assert done.returncode == 1
    assert "out: all 3 clips failed, the first because of this: draw=[9]: expected numbers from 2 to 3" in done.stderr
    assert [line["status"] for line in read_manifest(tmp_path / "out")] == ["failed"] * 3
    # Its options bind nobody.
    assert run(tmp_path, "out").returncode == 0
    assert contents(tmp_path / "out") == contents(folder / "whole")


def test_errors_of_ours_end_the_run(folder, tmp_path, monkeypatch):
    shutil.copytree(folder / "data", tmp_path / "data")

    def wrong(*_):
        raise TypeError("unsupported operand")

    monkeypatch.setattr(command, "capture", wrong)
    with pytest.raises(TypeError, match="unsupported operand"):
        command.run(CaptureCommand(DataConfig(path=str(tmp_path / "data"))), tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_conversions_and_detections_go_on_after_a_clip_that_fails(folder, tmp_path, monkeypatch, capsys):
    shutil.copytree(folder / "data", tmp_path / "data")
    spoil(tmp_path / "data/b")
    convert.run(ConvertCommand(DataConfig(path=str(tmp_path / "data"))), tmp_path / "converted")
    monkeypatch.setattr(detect, "detect_clip", lambda clip, *_: clip)
    detect.run(DetectCommand(clip=str(tmp_path / "data")), tmp_path / "detected")
    assert capsys.readouterr().out.count("b: failed: ") == 2
    for out in ("converted", "detected"):
        assert [line["status"] for line in read_manifest(tmp_path / out)] == ["ok", "failed", "ok"]
        assert load_clip(tmp_path / out / "c") == load_clip(tmp_path / "data/c")


@pytest.mark.parametrize(
    ("option", "said"),
    [("first=3", "expected the number of a clip, from 0 to 2"), ("clips=4", "expected from 1 to 3")],
)
def test_clips_that_are_not_there_are_refused(folder, option, said):
    assert said in run(folder, "none", option).stderr


def test_clips_of_other_settings_are_refused_and_kept(folder, tmp_path):
    for name in ("data", "whole"):
        shutil.copytree(folder / name, tmp_path / name)
    before = contents(tmp_path / "whole")
    done = run(tmp_path, "whole", "smooth=0.2")
    assert done.returncode == 1 and "settings.json differs in options.smooth" in done.stderr
    save_clip(strollers(frames=11, persons=1, views=3, name="b"), tmp_path / "data/b")
    assert "settings.json differs in data" in run(tmp_path, "whole").stderr
    (tmp_path / "whole" / SETTINGS).rename(tmp_path / SETTINGS)
    assert "holds clips of another command" in run(tmp_path, "whole").stderr
    (tmp_path / SETTINGS).rename(tmp_path / "whole" / SETTINGS)
    assert contents(tmp_path / "whole") == before
    done = run_command(tmp_path, "dmae", "capture", "data=data/a", "out=whole")
    assert done.returncode == 1 and "expected a folder for one clip, found a data set" in done.stderr


def test_clips_to_learn_from_differ_in_name_where_the_folders_of_their_sets_do_not(tmp_path):
    paths = [tmp_path / part / "captured" for part in "abc"]
    for path in paths:
        save_clip(full_clip(), path / "000000")
        write_manifest(path, [{"id": "000000", "status": "ok"}])
    sets = [Clips(DataConfig(path=str(path))) for path in paths]
    assert [clip.id for clip in train._named(sets)] == ["000000", "captured/000000", "2/captured/000000"]
    # A set that is given twice is still refused.
    assert [clip.id for clip in train._named([sets[1], sets[1]], first=1)] == ["captured/000000"] * 2
