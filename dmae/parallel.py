"""Tasks in several processes. Ctrl-C reaches the main process alone, which then ends the others."""

import signal
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from multiprocessing import resource_tracker

from joblib import Parallel, delayed


def in_parallel(function: Callable, tasks: Iterable[tuple], workers: int, *, ordered: bool = True) -> Iterator:
    """Yield `function(*task)` of each task.

    Args:
        workers: Processes; -1 for one a core. With 1 everything runs in this process.
        ordered: In the order of the tasks, or else as they are ready.
    """
    how = "generator" if ordered else "generator_unordered"
    with _interrupts_blocked(workers != 1):
        results = Parallel(n_jobs=workers, return_as=how)(delayed(function)(*task) for task in tasks)
    yield from results


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
