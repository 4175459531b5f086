"""Commands that are killed, and given again, end with the same files; a full disk leaves nothing half written."""

import resource
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from dmae.cli import compose
from synth.cli import SYNTH
from tests.endurance.kills import LINES, kill_often, run_here, run_undisturbed
from tests.endurance.memory import OPTIONS, peak_memory
from tests.support.commands import command_line, run_command

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory) -> tuple[Path, dict[str, float]]:
    folder = tmp_path_factory.mktemp("endurance")
    return folder, run_undisturbed(folder)


@pytest.mark.parametrize("name", LINES)
def test_killed_commands_end_with_the_same_files(name, undisturbed):
    """Killed after 27 % (generation), 52 % (capture) and 69 % (training) of the time."""
    folder, took = undisturbed
    (found,) = kill_often(name, 1, folder, took[name], seed=1)
    assert found.same, found


@contextmanager
def full_disk(limit: int) -> Iterator[None]:
    """Make writing fail beyond a size of files, as it does on a full disk, here and in processes started meanwhile."""
    before, most = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit, most))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (before, most))


@pytest.mark.parametrize("name", LINES)
def test_a_full_disk_leaves_nothing_half_written(name, undisturbed, tmp_path):
    """The first limit stops at the first file of settings, the other one at arrays, weights or checkpoints."""
    place, line = tmp_path / "place", (*LINES[name], "out=out")
    place.mkdir()
    for made in LINES:
        (tmp_path / made).symlink_to(undisturbed[0] / made)
    for limit in (512, 6 * 1024):
        with full_disk(limit):
            if name == "generation" and limit > 512:  # workers of other tests in this process have no limit
                done = subprocess.run(command_line(*line), cwd=place, capture_output=True, text=True)
            else:
                done = run_command(place, *line)
        assert done.returncode not in (0, -25), done.stderr
        there = [path for path in (place / "out").rglob("*") if path.is_file() and "tensorboard" not in path.parts]
        assert not [path for path in there if path.suffix in (".safetensors", ".ckpt", ".partial")], there
        assert not [path for path in there if path.name == "clip.json"]
    run_here(name, place)


def test_memory_is_measured(tmp_path):
    """Of a process that holds 40 MiB, and of its child, which holds 60."""
    child = "import time; held = b'.' * (60 << 20); time.sleep(2)"
    code = f"import subprocess, sys; held = b'.' * (40 << 20); subprocess.run([sys.executable, '-c', {child!r}])"
    found = peak_memory([sys.executable, "-c", code], tmp_path)
    assert 40 < found["main_mib"] < 60 and 100 < found["all_mib"] < 140
    compose(SYNTH.commands["generate"], [*OPTIONS, "clips=2", "out=set"])
