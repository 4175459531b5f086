"""Commands that are killed, and given again, end with the same files; a full disk leaves nothing half written."""

import resource
import subprocess
from pathlib import Path

import pytest

from tests.endurance.kills import LINES, kill_often, run_undisturbed
from tests.endurance.memory import peak_memory
from tests.support.commands import command_line

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


def full_disk(limit: int):
    """Return a function that makes writing fail beyond a size of files, as it does on a full disk."""

    def set_limit() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))

    return set_limit


@pytest.mark.parametrize("name", LINES)
def test_a_full_disk_leaves_nothing_half_written(name, undisturbed, tmp_path):
    """The first limit stops at the first file of settings, the other one at arrays, weights or checkpoints."""
    place, line = tmp_path / "place", command_line(*LINES[name], "out=out")
    place.mkdir()
    for made in LINES:
        (tmp_path / made).symlink_to(undisturbed[0] / made)
    for limit in (512, 6 * 1024):
        done = subprocess.run(line, cwd=place, capture_output=True, text=True, preexec_fn=full_disk(limit))
        assert done.returncode not in (0, -25), done.stderr
        there = [path for path in (place / "out").rglob("*") if path.is_file() and "tensorboard" not in path.parts]
        assert not [path for path in there if path.suffix in (".safetensors", ".ckpt", ".partial")], there
        assert not [path for path in there if path.name == "clip.json"]
    again = subprocess.run(line, cwd=place, capture_output=True, text=True)
    assert again.returncode == 0, again.stderr


def test_memory_is_measured(tmp_path):
    found = peak_memory(2, tmp_path)
    assert 20 < found["main_mib"] < found["all_mib"] < 4000
