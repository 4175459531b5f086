"""Tasks in other processes give the same results as tasks in this process."""

import os
import subprocess
import sys
import time

import pytest

from dmae.parallel import in_parallel


def square(number):
    return number**2


@pytest.mark.parametrize("workers", [1, 2])
@pytest.mark.parametrize("ordered", [True, False])
def test_results_are_those_of_the_tasks(workers, ordered):
    found = list(in_parallel(square, ((number,) for number in range(7)), workers, ordered=ordered))
    assert sorted(found) == [number**2 for number in range(7)]
    assert not ordered or found == sorted(found)


def test_no_workers_are_refused():
    with pytest.raises(ValueError, match="workers: expected a number of processes, or -1 for one per core; found 0"):
        in_parallel(square, [(1,)], 0)


def test_workers_resolve_relative_paths_in_the_current_folder(tmp_path, monkeypatch):
    for name in ("first", "second"):
        (tmp_path / name).mkdir()
        monkeypatch.chdir(tmp_path / name)
        assert set(in_parallel(os.getcwd, [()] * 4, 2)) == {str(tmp_path / name)}


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no masks of signals")
def test_workers_never_get_ctrl_c():
    program = "import signal; from dmae.parallel import in_parallel; "
    program += "print(list(in_parallel(signal.pthread_sigmask, [(signal.SIG_BLOCK, ())] * 3, 2)))"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.count("SIGINT") == 3


def test_workers_end_with_a_killed_main_process(tmp_path):
    program = """
import sys, time
from pathlib import Path
from dmae.parallel import in_parallel

def task(name):
    Path(name).touch()
    time.sleep(2)
    Path(name + " done").touch()

list(in_parallel(task, [("one",), ("two",)], 2))
"""
    process = subprocess.Popen([sys.executable, "-c", program], cwd=tmp_path)
    while len(list(tmp_path.iterdir())) < 2:
        assert process.poll() is None
        time.sleep(0.05)
    process.kill()
    process.wait()
    time.sleep(2.5)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["one", "two"]
