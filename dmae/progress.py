"""Progress with the time left: a bar on a terminal, otherwise one line per minute."""

import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, nullcontext

from rich.console import Console
from rich.markup import escape
from rich.progress import Progress, track

LINE_EVERY = 60.0
"""s between lines where there is no terminal."""


def progress(items: Iterable, description: str, total: int | None = None) -> Iterator:
    """Yield the items, and show on stderr how many are done ("capturing") and how long the rest takes.

    `total` is by default the length of `items`, where it has one.
    """
    console = Console(stderr=True)
    if console.is_terminal:
        # Names of clips may have brackets.
        yield from track(items, escape(description), total, console=console, transient=True)
        return
    if total is None and hasattr(items, "__len__"):
        total = len(items)
    start = last = time.monotonic()
    first = (0, 0.0)
    for done, item in enumerate(items):
        now = time.monotonic()
        if done == 1:
            first = (1, now - start)
        if done and now - last >= LINE_EVERY:
            print(progress_line(description, done, total, now - start, first), file=sys.stderr, flush=True)
            last = now
        yield item


@contextmanager
def waiting(description: str) -> Iterator[None]:
    """Show on a terminal that something is done for which no progress is known, as "loading"."""
    console = Console(stderr=True)
    with console.status(description) if console.is_terminal else nullcontext():
        yield


def progress_line(
    description: str, done: int, total: int | None, seconds: float, first: tuple[int, float] = (0, 0.0)
) -> str:
    """Return a line such as "capturing: 12 of 40, 3.0 min, about 7.0 min left".

    `first` says how many items were done first, and after how many seconds; the forecast leaves them out, as the first
    ones load and compile for all.
    """
    line = f"{description}: {done}{f' of {total}' if total else ''}, {seconds / 60:.1f} min"
    parts, spent = done - first[0], seconds - first[1]
    return line + (f", about {spent / parts * (total - done) / 60:.1f} min left" if total and parts else "")


def duration(seconds: float) -> str:
    """Return a time in words, as "40 s", "12 min" or "3.5 h"."""
    if seconds < 120:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 7200 else f"{seconds / 3600:.1f} h"


def counted_progress(items: Iterable, description: str, count: Callable[[], tuple[int, int]]) -> Iterator:
    """Yield the items, and show progress ("rendering images") and the time left on stderr.

    `count` returns how many parts are done, and how many there are; called from another thread.
    """
    console, over, start = Console(stderr=True), threading.Event(), time.monotonic()

    def show_bar() -> None:
        with Progress(console=console, transient=True) as bar:
            task = bar.add_task(description)
            while not over.wait(0.5):
                done, total = count()
                bar.update(task, completed=done, total=total)

    def print_lines() -> None:
        first, lines = (0, 0.0), 0
        while not over.wait(LINE_EVERY / 120):
            (done, total), seconds = count(), time.monotonic() - start
            if not first[0]:
                first = (done, seconds)
            if done and seconds >= (lines + 1) * LINE_EVERY:
                print(progress_line(description, done, total, seconds, first), file=sys.stderr, flush=True)
                lines = seconds // LINE_EVERY

    watcher = threading.Thread(target=show_bar if console.is_terminal else print_lines, daemon=True)
    watcher.start()
    try:
        yield from items
    finally:
        over.set()
        watcher.join()
