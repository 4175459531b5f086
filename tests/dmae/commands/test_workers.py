"""Clips that are scored and completed on two processes, and forecasts of that."""

from dataclasses import replace
from pathlib import Path

import pytest

from dmae.data.store import save_clip, write_manifest
from tests.support.clips import walkers
from tests.support.commands import run_command
from tests.support.stressed_clips import strollers

NAMES = ("a", "b", "c")
LINES = {
    "complete": ("complete", "clip=data"),
    "evaluate": ("evaluate", "data=data", "methods=[measured,linear,dmae]", "views=[3,2]"),
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """Return a folder with `data`, three clips with truth and poses that lack joints."""
    folder = tmp_path_factory.mktemp("workers")
    for number, name in enumerate(NAMES):
        clip = strollers(frames=12 + number, persons=1, views=3, name=name)
        poses = walkers(len(clip), 1)
        missing = poses.source < 0
        missing[4:7, 0, number : number + 4] = True
        save_clip(replace(clip, poses=poses.without(missing)), folder / "data" / name)
    write_manifest(folder / "data", [{"id": name, "status": "ok"} for name in NAMES])
    return folder


@pytest.mark.slow
@pytest.mark.parametrize("command", LINES)
def test_two_processes_write_the_files_of_one(folder, command):
    for workers in (1, 2):
        done = run_command(folder, "dmae", *LINES[command], f"workers={workers}", f"out={command}{workers}")
        assert done.returncode == 0, done.stderr
    one, two = (_contents(folder / f"{command}{workers}") for workers in (1, 2))
    assert len(one) >= (1 if command == "evaluate" else 6)
    assert one == two


def _contents(out: Path) -> dict[str, bytes]:
    """Return the files of a result, without the record of its options."""
    files = (path for path in out.rglob("*") if path.is_file() and path.name != "config.yaml")
    return {path.relative_to(out).as_posix(): path.read_bytes() for path in files}


@pytest.mark.parametrize("command", LINES)
def test_a_dry_run_prints_a_forecast_and_writes_nothing(folder, command):
    done = run_command(folder, "dmae", *LINES[command], "dry_run=true", "out=dry")
    assert done.returncode == 0, done.stderr
    assert "dry: 3 clips, 39 frames: about " in done.stdout
    assert (" MB" in done.stdout) == (command == "complete")
    assert not (folder / "dry").exists()


@pytest.mark.parametrize("command", LINES)
def test_a_number_of_workers_is_not_0(folder, command):
    done = run_command(folder, "dmae", *LINES[command], "workers=0", "out=none")
    assert done.returncode == 1
    assert "workers: expected a number of processes, or -1 for one a core; got 0" in done.stderr
