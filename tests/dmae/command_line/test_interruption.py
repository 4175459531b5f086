"""Ctrl-C, with real processes and signals: one line, status 130, and finished results are named and can be resumed."""

import os
import signal
import sys
import time
from pathlib import Path

import pytest

from dmae.cli import main
from dmae.command_line.interruption import one_line
from dmae.commands import convert
from dmae.data.store import load_clip, read_manifest, save_clip, write_manifest
from tests.support.clips import full_clip
from tests.support.commands import run_command, start_command

SMALL = ("scene.seconds=0.2", "scene.persons=[1,1]")


def interrupt(process, *, group: bool = True, by: int = signal.SIGINT):
    """Press Ctrl-C, which a terminal sends to the whole process group, or send another signal."""
    (os.killpg if group else os.kill)(process.pid, by)
    return process.communicate(timeout=60)


def wait_for(path, process, seconds=120):
    """Until there is a file that the pattern matches."""
    end = time.monotonic() + seconds
    while not list(path.parent.parent.glob(f"{path.parent.name}/{path.name}")):
        assert process.poll() is None and time.monotonic() < end, process.communicate()
        time.sleep(0.05)


def wait_for_numpy(process, seconds=60):
    """Until a command has begun to import its packages: before that Python itself answers a signal."""
    maps = Path(f"/proc/{process.pid}/maps")
    if not maps.parent.parent.joinpath("self/maps").is_file():
        pytest.skip("looks up loaded libraries in /proc")
    end = time.monotonic() + seconds
    while "_multiarray_umath" not in maps.read_text():
        assert process.poll() is None and time.monotonic() < end, process.communicate()
        time.sleep(0.01)


@pytest.mark.slow
def test_generating_in_several_processes_resumes_after_an_interruption(tmp_path):
    arguments = ("generate", "out=set", "clips=60", "workers=2", *SMALL)
    process = start_command(tmp_path, "synth", *arguments)
    wait_for(tmp_path / "set/000003", process)
    _, error = interrupt(process)
    assert process.returncode == 130
    whole = len(list((tmp_path / "set").glob("[0-9]*")))
    assert error.splitlines() == [
        f"synth generate: interrupted; {whole} of 60 clips in set are whole; the same command makes the others"
    ]
    assert not list((tmp_path / "set").glob(".*"))
    assert 0 < len(read_manifest(tmp_path / "set")) <= whole < 60
    # Whichever worker was faster: clips are not whole in their order.
    name = read_manifest(tmp_path / "set")[0]["id"]
    before = load_clip(tmp_path / "set" / name).truth.xyz
    done = run_command(tmp_path, "synth", "generate", "out=set", f"clips={whole + 1}", *SMALL)
    assert done.returncode == 0, done.stderr
    assert (load_clip(tmp_path / "set" / name).truth.xyz == before).all()


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("work")
    names = [f"{number:02}" for number in range(40)]
    for name in names:
        save_clip(full_clip(frames=50), folder / "set" / name)
    write_manifest(folder / "set", [{"id": name, "status": "ok"} for name in names])
    return folder


def test_clips_captured_before_an_interruption_are_a_data_set(folder):
    process = start_command(folder, "dmae", "capture", "data=set", "out=captured")
    wait_for(folder / "captured/02", process)
    _, error = interrupt(process, group=False)
    assert process.returncode == 130
    names = [line["id"] for line in read_manifest(folder / "captured")]
    assert 2 <= len(names) < 40 and all(load_clip(folder / "captured" / name).poses is not None for name in names)
    assert "can be used; the same command continues" in error
    assert len(error.splitlines()) == 1


def test_a_reader_that_stops_reading_ends_a_command_without_a_word(folder, monkeypatch, capfd):
    def closed(*_):
        raise BrokenPipeError

    monkeypatch.setattr(convert, "run", closed)
    monkeypatch.setattr(os, "dup2", lambda *_: None)
    monkeypatch.setattr(sys, "argv", ["dmae", "convert", f"data={folder}/set/00", f"out={folder}/closed"])
    with pytest.raises(SystemExit) as end:
        main()
    assert end.value.code == 1 and capfd.readouterr() == ("", "")


@pytest.mark.slow
@pytest.mark.parametrize(("by", "status"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_training_resumes_from_its_checkpoint(folder, by, status):
    tiny = [f"model.encoder.{size}" for size in ("dim=8", "heads=1", "head_dim=8")]
    tiny += ["model.decoder.dim=8", "learning.epoch=2", "learning.batch=2", "learning.steps=100000"]
    process = start_command(folder, "dmae", "train", "data=set/00", f"out=model{status}", *tiny)
    wait_for(folder / f"model{status}/checkpoint.ckpt", process)
    _, error = interrupt(process, by=by)
    assert process.returncode == status
    *steps, last = error.splitlines()
    assert last == f"dmae train: interrupted; model{status} holds a checkpoint; the same command continues"
    assert all(line.startswith("step ") for line in steps)


def test_an_interruption_before_training_begins_is_one_line(folder):
    process = start_command(folder, "dmae", "train", "data=set", "out=none")
    wait_for_numpy(process)
    _, error = interrupt(process)
    assert process.returncode == 130
    assert error.splitlines()[-1].startswith("dmae train: interrupted;") and "Traceback" not in error


@pytest.mark.parametrize("command", ["generate", "plan"])
def test_an_interrupted_dry_run_promises_no_clips(command, tmp_path, monkeypatch):
    def run(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(f"synth.commands.{command}.run", run)
    done = run_command(tmp_path, "synth", command, "dry_run=true", "out=dry")
    assert done.returncode == 130
    assert done.stderr == f"synth {command}: interrupted; nothing was made, as in any dry run\n"
    made = run_command(tmp_path, "synth", command, "out=made").stderr
    assert "made" in made and "dry run" not in made


def test_errors_of_interrupted_imports_are_not_shown(capsys):
    with pytest.raises(SystemExit) as end, one_line("dmae x") as interruption:
        interruption.describe = lambda: "all is well"
        interruption.signal = signal.SIGINT
        raise ImportError("numpy is broken")
    assert end.value.code == 130
    assert capsys.readouterr().err == "dmae x: interrupted; all is well\n"


def test_the_previous_signal_handler_is_restored():
    outside, before = signal.getsignal(signal.SIGINT), signal.default_int_handler
    signal.signal(signal.SIGINT, before)
    try:
        with one_line("dmae x"):
            assert signal.getsignal(signal.SIGINT) != before
        assert signal.getsignal(signal.SIGINT) == before
    finally:
        signal.signal(signal.SIGINT, outside)


def test_other_errors_pass():
    with pytest.raises(ZeroDivisionError), one_line("dmae x"):
        raise ZeroDivisionError
