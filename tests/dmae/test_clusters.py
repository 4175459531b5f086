"""Tasks on local clusters of Ray and Dask give the same results as tasks here, and survive the loss of a worker."""

import json
import os
import signal
import subprocess
import sys
import time

import pytest

from dmae.parallel import CLUSTERS, Backend, in_parallel, process_count, running_on
from tests.support.cluster_tasks import square_or_die
from tests.support.commands import command_line, synth
from tests.support.processes import command_of, family, processor_seconds

ENVIRONMENT = {
    name: value for name, value in os.environ.items() if name not in ("RAY_ADDRESS", "DASK_SCHEDULER_ADDRESS")
}
_WORKER = "ray::_on_node"
"""What is in the command line of processes of Ray that run tasks."""
PROGRAM = """
import json, sys
from dmae.parallel import in_parallel, running_on
from tests.support.cluster_tasks import square_or_die

if __name__ == "__main__":
    backend, folder, order = sys.argv[1:]
    with running_on(backend), open(folder + "/found", "w") as file:
        tasks = ((folder, number) for number in range(9))
        print(json.dumps(list(in_parallel(square_or_die, tasks, 2, ordered=order == "ordered"))), file=file)
        try:
            list(in_parallel(square_or_die, [(folder, 1), (folder, -1)], 2))
        except ValueError as error:
            print(json.dumps(str(error)), file=file)
"""


def needs(backend):
    pytest.importorskip({"ray": "ray", "dask": "distributed"}[backend], reason="needs the extra cluster")


def test_each_backend_beside_this_machine_is_a_cluster():
    assert {*CLUSTERS} == {*Backend} - {Backend.loky}


def test_the_backend_holds_for_the_block_alone(monkeypatch):
    class Two:
        cores = 2

    monkeypatch.setattr("dmae.parallel._connect", lambda name, processes: Two())
    with running_on("ray"):
        assert process_count(-1) == 2
        assert process_count(7) == 2
        assert process_count(1) == 1
    assert process_count(3) == 3


def test_a_library_that_is_missing_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "ray", None)
    with running_on("ray"), pytest.raises(ValueError, match=r"backend=ray: .*dmae-synth\[cluster\]"):
        in_parallel(square_or_die, [], 5)


def test_a_cluster_that_does_not_start_is_named(monkeypatch):
    def late(processes):
        raise Exception("The current node timed out during startup.")

    monkeypatch.setitem(CLUSTERS, "ray", late)
    with running_on("ray"), pytest.raises(ValueError, match=r"backend=ray: cannot be started: The current node timed"):
        in_parallel(square_or_die, [], 6)


@pytest.mark.slow
@pytest.mark.parametrize(("backend", "order"), [("ray", "ordered"), ("dask", "unordered")])
def test_a_task_outlives_the_death_of_its_worker(backend, order, tmp_path):
    needs(backend)
    file = tmp_path / "program.py"
    file.write_text(PROGRAM)
    line = [sys.executable, str(file), backend, str(tmp_path), order]
    subprocess.run(line, env=ENVIRONMENT, timeout=300, check=True)
    found, error = map(json.loads, (tmp_path / "found").read_text().splitlines())
    assert (tmp_path / "died").exists()
    assert (found if order == "ordered" else sorted(found)) == [number**2 for number in range(9)]
    assert error == "expected 0 or more, got -1"


@pytest.mark.slow
def test_a_data_set_is_the_same_with_a_killed_worker(tmp_path):
    """`synth generate` on a local Ray of two processes, one of which is killed over its first clip."""
    needs("ray")
    options = ("clips=3", "seed=5", "scene.seconds=0.4", "scene.persons=[1,1]")
    assert synth(tmp_path, "generate", *options, "out=here").returncode == 0
    line = command_line("synth", "generate", *options, "workers=2", "backend=ray", "out=there")
    process = subprocess.Popen(line, cwd=tmp_path, env=ENVIRONMENT)
    killed = None
    while process.poll() is None:
        writing = list((tmp_path / "there").glob(".*.partial"))
        if writing and killed is None:
            workers = [each for each in family(process.pid) if _WORKER in command_of(each)]
            killed = max(workers, key=processor_seconds)
            os.kill(killed, signal.SIGKILL)
        time.sleep(0.02)
    assert killed is not None
    assert process.returncode == 0
    here, there = ((tmp_path / name / "checksums.json").read_bytes() for name in ("here", "there"))
    assert here == there
