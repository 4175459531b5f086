"""Tasks in several processes. Ctrl-C reaches the main process alone, which then ends the others."""

import os
import signal
import threading
import time
import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from functools import cache
from multiprocessing import resource_tracker

from joblib import Parallel, delayed

# joblib replaces workers that have grown by 300 MB, as with many people in one clip; their tasks are not lost.
warnings.filterwarnings("ignore", "A worker stopped while some jobs were given", UserWarning)

_CHECKED_EVERY = 0.5
"""s; a worker outlives a killed main process by no more than this."""


def in_parallel(function: Callable, tasks: Iterable[tuple], workers: int, *, ordered: bool = True) -> Iterator:
    """Yield `function(*task)` of each task. Workers end when the main process is killed.

    Args:
        workers: Processes; -1 for one a core. With 1 everything runs in this process.
        ordered: In the order of the tasks, or else as they are ready.
    """
    how = "generator" if ordered else "generator_unordered"
    with _interrupts_blocked(workers != 1):
        results = Parallel(n_jobs=workers, return_as=how)(
            delayed(_in_worker)(os.getpid(), function, *task) for task in tasks
        )
    yield from results


def _in_worker(main: int, function: Callable, *task):
    if os.getpid() != main:
        _end_with(main)
    return function(*task)


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
    # Python 3.11 unblocks SIGINT once it has started this process, which joblib would have it do in the block.
    resource_tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
