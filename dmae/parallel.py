"""Tasks in several processes, here or on a cluster. Ctrl-C reaches the main process alone, which ends the others.

Configurations name a `Backend`, so this module imports joblib only to run tasks.
"""

import os
import signal
import sys
import threading
import time
import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from enum import StrEnum
from functools import cache
from multiprocessing import resource_tracker
from pathlib import Path

from dmae.clusters import Cluster, connect, on_cluster
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
        raise ValueError("workers: expected a number of processes, or -1 for one per core; got 0")


@dataclass(frozen=True, kw_only=True)
class ProcessesConfig:
    """Options of what runs in several processes."""

    workers: int = 1
    """Processes; -1 for one per core. The results are the same."""
    backend: Backend = Backend.loky
    """What runs the processes: this machine, or a cluster."""

    def __post_init__(self):
        check_workers(self.workers)


def in_parallel(function: Callable, tasks: Iterable[tuple], workers: int, *, ordered: bool = True) -> Iterator:
    """Yield `function(*task)` of each task, on the backend of `running_on`, in order or as soon as each is ready.

    Workers end when the main process is killed. On a cluster, if a worker dies, its task is given to another. `workers`
    are processes; -1 for one per core, on a cluster of all its machines. With 1 everything runs in this process, unless
    the backend is a cluster.
    """
    backend = backend_in_use()
    if backend != Backend.loky:
        cluster = _cluster(backend, workers)
        return on_cluster(function, tasks, cluster, _processes(cluster, workers), ordered=ordered)
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
        return connect(backend, cpu_count() if workers < 1 else workers)


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
