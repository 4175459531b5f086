"""An interrupted capture of a data set goes on: whole clips of the same settings are kept, and no others."""

import shutil
from pathlib import Path

import pytest

from dmae.commands import capture as command
from dmae.commands.unfinished import UNFINISHED
from dmae.data.store import save_clip, write_manifest
from dmae.files.checksums import find_damage, find_data_set_damage
from tests.support.commands import run_command
from tests.support.stressed_clips import strollers

NAMES = ("a", "b", "c")


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """Return a folder with `data`, a data set of three clips, and `whole`, which was captured from it at once."""
    folder = tmp_path_factory.mktemp("unfinished")
    for name in NAMES:
        save_clip(strollers(frames=10, persons=1, views=3, name=name), folder / "data" / name)
    write_manifest(folder / "data", [{"id": name, "status": "ok"} for name in NAMES])
    assert run(folder, "whole") == 0
    return folder


def run(folder: Path, out: str, *options: str) -> int:
    return run_command(folder, "dmae", "capture", "data=data", f"out={out}", *options).returncode


def contents(path: Path) -> dict[str, bytes]:
    files = (file for file in path.rglob("*") if file.is_file() and file.name != "config.yaml")
    return {file.relative_to(path).as_posix(): file.read_bytes() for file in files}


@pytest.fixture
def captured(monkeypatch) -> list[str]:
    """The clips that are captured. The one called `stop` in the list interrupts."""
    done: list[str] = []

    def counted(clip, config, capture=command.capture):
        if done[-1:] == ["b"] and "stop" in done:
            raise KeyboardInterrupt
        done.append(clip.id)
        return capture(clip, config)

    monkeypatch.setattr(command, "capture", counted)
    return done


def interrupt(folder: Path, out: str, captured: list[str], *options: str) -> None:
    """Interrupt a capture at the last clip."""
    captured[:] = ["stop"]
    assert run(folder, out, *options) == 130
    assert captured == ["stop", "a", "b"]
    captured.clear()


def test_an_interrupted_capture_goes_on(folder, captured):
    interrupt(folder, "one", captured)
    assert (folder / "one" / UNFINISHED).is_file()
    assert find_data_set_damage(folder / "one", "ab") == []
    assert run(folder, "one") == 0
    assert captured == ["c"]
    assert contents(folder / "one") == contents(folder / "whole")


def test_a_killed_capture_goes_on_without_damaged_clips(folder, captured):
    interrupt(folder, "two", captured)
    for name in ("manifest.jsonl", "checksums.json", "b/checksums.json"):  # as SIGKILL leaves it
        (folder / "two" / name).unlink()
    assert run(folder, "two") == 0
    assert captured == ["b", "c"]
    interrupt(folder, "two", captured)
    data = bytearray((folder / "two/a/arrays.safetensors").read_bytes())
    data[-1] ^= 1
    (folder / "two/a/arrays.safetensors").write_bytes(data)
    assert run(folder, "two") == 0
    assert captured == ["a", "c"]
    assert contents(folder / "two") == contents(folder / "whole")


@pytest.mark.parametrize("change", ["options", "data", "earlier"])
def test_clips_of_other_settings_are_captured_anew(folder, captured, change, tmp_path):
    shutil.copytree(folder / "data", tmp_path / "data")
    if change == "earlier":  # a whole data set of the same settings was written over
        assert run(tmp_path, "out", "smooth=0.2") == 0
        captured[:] = ["stop", "b"]
        assert run(tmp_path, "out") == 130
        captured.clear()
    else:
        interrupt(tmp_path, "out", captured, *(["smooth=0.2"] if change == "options" else []))
    if change == "data":
        (tmp_path / "data").rename(tmp_path / "elsewhere")
        shutil.copytree(folder / "data", tmp_path / "more/data")
        assert run_command(tmp_path, "dmae", "capture", "data=more/data", "out=out").returncode == 0
    else:
        assert run(tmp_path, "out") == 0
    assert captured == [*NAMES]
    assert [damage for name in NAMES for damage in find_damage(tmp_path / "out" / name)] == []
    assert contents(tmp_path / "out").keys() == contents(folder / "whole").keys()
