"""Tasks in several processes, here or on a cluster. Ctrl-C reaches the main process alone, which ends the others.

Configurations name a `Backend`, so this module imports joblib only to run tasks.
"""

from __future__ import annotations

import gc
import logging
import os
import signal
import socket
import sys
import threading
import time
import warnings
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from enum import StrEnum
from functools import cache
from itertools import islice
from multiprocessing import resource_tracker
from pathlib import Path

from dmae.data.typed import Configuration
from dmae.files.mapped import trim

# joblib replaces workers that grew by 300 MB, for example because a clip has many people. No task is lost.
warnings.filterwarnings("ignore", "A worker stopped while some jobs were given", UserWarning)

_CHECKED_EVERY = 0.5  # s; a worker outlives a killed main process by no more than this


class Backend(StrEnum):
    """What runs the processes."""

    loky = "loky"
    """This machine."""
    ray = "ray"
    """The Ray cluster that RAY_ADDRESS names, or else a local one."""
    dask = "dask"
    """The Dask cluster that DASK_SCHEDULER_ADDRESS names, or else a local one."""


_backend: ContextVar[Backend] = ContextVar("backend", default=Backend.loky)


@contextmanager
def running_on(backend: Backend | str) -> Iterator[None]:
    """Have `in_parallel` use a backend, in the block."""
    token = _backend.set(Backend(backend))
    try:
        yield
    finally:
        _backend.reset(token)


def backend_in_use() -> Backend:
    """Return the backend that `in_parallel` uses."""
    return _backend.get()


def check_workers(workers: int) -> None:
    """Raise ValueError for an impossible number of processes."""
    if workers == 0:
        raise ValueError("workers: expected a number of processes, or -1 for one per core; found 0")


@dataclass(frozen=True, kw_only=True)
class ProcessesConfig(Configuration):
    """Options of what runs in several processes."""

    workers: int = 1
    """Processes; -1 for one per core. The results are the same."""
    backend: Backend = Backend.loky
    """What runs the processes: this machine, or a cluster."""

    def __post_init__(self):
        super().__post_init__()
        check_workers(self.workers)


def in_parallel(function: Callable, tasks: Iterable[tuple], workers: int, *, ordered: bool = True) -> Iterator:
    """Yield `function(*task)` of each task, on the backend of `running_on`, in order or as soon as each is ready.

    Workers end when the main process is killed. On a cluster, if a worker dies, its task is given to another. `workers`
    are processes; -1 for one per core, on a cluster of all its machines. With 1 everything runs in this process, unless
    the backend is a cluster.
    """
    check_workers(workers)
    backend = backend_in_use()
    if backend != Backend.loky:
        cluster = _cluster(backend, workers)
        return _on_cluster(function, tasks, cluster, _processes(cluster, workers), ordered=ordered)
    return _on_this_machine(function, tasks, workers, ordered)


def process_count(workers: int) -> int:
    """Return how many tasks `in_parallel` runs at a time."""
    from joblib import effective_n_jobs

    backend = backend_in_use()
    if backend == Backend.loky:
        return effective_n_jobs(workers)
    return _processes(_cluster(backend, workers), workers)


def _cluster(backend: Backend, workers: int) -> Cluster:
    from joblib import cpu_count

    # Processes and threads of the cluster never receive Ctrl-C.
    with _interrupts_blocked(True):
        return _connect(backend, cpu_count() if workers < 1 else workers)


def _processes(cluster: Cluster, workers: int) -> int:
    return cluster.cores if workers < 1 else min(workers, cluster.cores)


def _on_this_machine(function: Callable, tasks: Iterable[tuple], workers: int, ordered: bool) -> Iterator:
    from joblib import Parallel, delayed

    how = "generator" if ordered else "generator_unordered"
    with _interrupts_blocked(workers != 1):
        results = Parallel(n_jobs=workers, return_as=how)(
            delayed(_in_worker)(os.getpid(), str(Path.cwd()), function, *task) for task in tasks
        )
    yield from results


def _in_worker(main: int, folder: str, function: Callable, *task):
    if os.getpid() != main:
        _end_with(main)
        # joblib reuses workers. Their current folder is the one in which they were started.
        os.chdir(folder)
    result = function(*task)
    if os.getpid() != main:
        trim()
    return result


@cache
def _end_with(main: int) -> None:
    """End this worker when its main process, which is its parent, has gone: nothing must be written any more."""

    def watch() -> None:
        while os.getppid() == main:
            time.sleep(_CHECKED_EVERY)
        os._exit(1)

    gc.freeze()  # What the worker has loaded stays
    threading.Thread(target=watch, name="end with the main process", daemon=True).start()


@contextmanager
def _interrupts_blocked(wanted: bool) -> Iterator[None]:
    """Hold SIGINT back. Processes and threads that are begun in the block never get it."""
    if not wanted:
        yield
        return
    # Python 3.11 unblocks SIGINT when it starts the resource tracker. joblib would start it inside the block.
    resource_tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def one_thread() -> Iterator[None]:
    """Limit torch, if it is loaded, to one thread of the CPU, so that sums do not depend on the number of workers."""
    torch = sys.modules.get("torch")
    if torch is None:
        yield
        return
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)


# Clusters. Both libraries are wrapped alike: `cores` tasks run at a time; `submit` returns a future, `first` waits for
# futures and returns one that has ended, `result` returns or raises what its function did, and `cancel` ends a task or
# leaves it out. If a process or machine dies, its task is given to another.

_RETRIES = 3  # Number of times that a task is given to another process after its process died
_AHEAD = 2  # Number of waiting tasks for each running task
_CARRIED = ("LP_NUM_THREADS", "MUJOCO_GL", "OMP_NUM_THREADS", "PYOPENGL_PLATFORM")
"""Environment variables of this process that tasks run with."""


class Ray:
    """The cluster that `RAY_ADDRESS` names, or else a local one of some processes.

    joblib's backend for Ray is not used: it returns results when all tasks have ended, and gives no task to another
    process.
    """

    def __init__(self, processes: int):
        import ray

        # Tasks request no GPU, but can still use those of their machine. Ray must not send usage statistics.
        os.environ.setdefault("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "0")
        os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
        if not ray.is_initialized():
            quiet: dict = {"log_to_driver": False, "logging_level": "ERROR"}
            if not os.environ.get("RAY_ADDRESS"):
                quiet |= {"num_cpus": processes, "include_dashboard": False}
            ray.init(**quiet)
        self.ray, self.cores = ray, int(ray.cluster_resources().get("CPU", 1))
        self.remote = ray.remote(_on_node).options(max_retries=_RETRIES)

    def submit(self, function, *arguments):
        return self.remote.remote(function, *arguments)

    def cancel(self, future):
        self.ray.cancel(future)

    def first(self, futures):
        return self.ray.wait(futures, num_returns=1)[0][0]

    def result(self, future):
        try:
            return self.ray.get(future)
        except self.ray.exceptions.RayTaskError as error:
            raise error.cause from None
        except self.ray.exceptions.WorkerCrashedError as error:
            raise RuntimeError(f"a task ended {_RETRIES + 1} processes, for lack of memory or by a crash") from error


class Dask:
    """The cluster that `DASK_SCHEDULER_ADDRESS` names, or else a local one of some processes."""

    def __init__(self, processes: int):
        import dask
        import distributed

        self.distributed = distributed
        try:
            self.client = distributed.default_client()
        except ValueError:
            local = {} if dask.config.get("scheduler-address", None) else {
                "n_workers": processes, "threads_per_worker": 1, "dashboard_address": None,
                "silence_logs": logging.CRITICAL,
            }  # fmt: skip
            self.client = distributed.Client(**local)
        self.cores = max(1, sum(self.client.ncores().values()))

    def submit(self, function, *arguments):
        return self.client.submit(_on_node, function, *arguments, pure=False)

    def cancel(self, future):
        future.cancel()

    def first(self, futures):
        done = self.distributed.wait(futures, return_when="FIRST_COMPLETED").done
        return next(future for future in futures if future in done)

    def result(self, future):
        return future.result()


Cluster = Ray | Dask
CLUSTERS: dict[str, type[Cluster]] = {"ray": Ray, "dask": Dask}


@cache
def _connect(name: str, processes: int) -> Cluster:
    """Return one of `CLUSTERS`, connected until this process ends; one of this machine, with so many processes, if none
    is named."""
    try:
        return CLUSTERS[name](processes)
    except ImportError as error:
        raise ValueError(f"backend={name}: {error}; pip install 'dmae-synth[cluster]'") from None
    except Exception as error:  # Ray raises nothing narrower where it takes too long to start
        raise ValueError(f"backend={name}: cannot be started: {error}") from error


def _on_cluster(
    function: Callable, tasks: Iterable[tuple], cluster: Cluster, at_once: int, *, ordered: bool
) -> Iterator:
    """Yield `function(*task)` of each task, run on a cluster, so many at once, in their order or as each is ready."""
    carried = {name: os.environ[name] for name in _CARRIED if name in os.environ}
    remaining = ((str(Path.cwd()), carried, function, *task) for task in tasks)
    running: deque = deque()
    try:
        while True:
            running.extend(cluster.submit(*task) for task in islice(remaining, at_once * _AHEAD - len(running)))
            if not running:
                return
            future = running[0] if ordered else cluster.first(list(running))
            running.remove(future)
            yield cluster.result(future)
    finally:
        for future in running:
            cluster.cancel(future)


def _on_node(folder: str, environment: dict[str, str], function: Callable, *task):
    """Run a task in a worker, in the folder that relative paths begin in."""
    os.environ.update(environment)
    try:
        os.chdir(folder)
    except OSError as error:
        raise ValueError(
            f"{folder}: not there on {socket.gethostname()}, {error.strerror}; a cluster needs a folder that all its "
            "machines share, at the same path"
        ) from None
    return function(*task)
