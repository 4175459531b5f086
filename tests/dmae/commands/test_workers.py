"""Clips that are scored and completed on two processes, and forecasts of that."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dmae.data.store import load_clip, save_clip, write_manifest
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
def test_two_processes_write_what_one_writes(folder, command):
    for workers in (1, 2):
        done = run_command(folder, "dmae", *LINES[command], f"workers={workers}", f"out={command}{workers}")
        assert done.returncode == 0, done.stderr
    one, two = (folder / f"{command}{workers}" for workers in (1, 2))
    assert _names(one) == _names(two)
    # Products of matrices may differ in their last digits between processes.
    if command == "evaluate":
        first, second = (_numbers(out / "scores.json") for out in (one, two))
        np.testing.assert_allclose(first, second, rtol=1e-3, atol=1e-3)
        return
    for name in NAMES:
        first, second = (load_clip(out / name).poses for out in (one, two))
        np.testing.assert_array_equal(first.source, second.source)
        np.testing.assert_allclose(first.xyz, second.xyz, atol=1e-4)


def _names(out: Path) -> list[str]:
    return sorted(path.relative_to(out).as_posix() for path in out.rglob("*") if path.is_file())


def _numbers(path: Path) -> list[float]:
    return [float(number) for number in re.findall(r"-?\d+(?:\.\d+)?(?:e[-+]?\d+)?", path.read_text())]


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
    assert "workers: expected a number of processes, or -1 for one per core; found 0" in done.stderr
