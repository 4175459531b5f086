"""Progress with the time left: a bar on a terminal, otherwise one line per minute."""

import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sized
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
    if total is None and isinstance(items, Sized):
        total = len(items)
    console, done = Console(stderr=True), 0
    if console.is_terminal:
        # Names of clips may have brackets.
        yield from track(items, escape(description), total, console=console, transient=True)
        return
    with _lines(description, lambda: (done, total)):
        for item in items:
            yield item
            done += 1


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
    console = Console(stderr=True)
    with _bar(console, description, count) if console.is_terminal else _lines(description, count):
        yield from items


@contextmanager
def _bar(console: Console, description: str, count: Callable[[], tuple[int, int]]) -> Iterator[None]:
    """Show a bar in the block, in a thread."""

    def show(over: threading.Event) -> None:
        with Progress(console=console, transient=True) as bar:
            task = bar.add_task(description)
            while not over.wait(0.5):
                done, total = count()
                bar.update(task, completed=done, total=total)

    with _watched(show):
        yield


@contextmanager
def _lines(description: str, count: Callable[[], tuple[int, int | None]]) -> Iterator[None]:
    """Print a line each minute in the block, in a thread: a single part may take many minutes.

    While another loop runs inside, which prints its own lines, a line is printed only if further parts are done.
    """

    def show(over: threading.Event) -> None:
        start, first, shown, lines = time.monotonic(), (0, 0.0), 0, 0
        while not over.wait(LINE_EVERY / 120):
            (done, total), seconds = count(), time.monotonic() - start
            if not first[0]:
                first = (done, seconds)
            if seconds >= (lines + 1) * LINE_EVERY:
                if done > shown or _running[-1] is over:
                    print(progress_line(description, done, total, seconds, first), file=sys.stderr, flush=True)
                shown, lines = done, int(seconds // LINE_EVERY)

    with _watched(show):
        yield


_running: list[threading.Event] = []
"""The loops that are shown, from the outermost to the innermost."""


@contextmanager
def _watched(show: Callable[[threading.Event], None]) -> Iterator[None]:
    """Run `show` in a thread until the end of the block, which sets the event that it is given."""
    over = threading.Event()
    watcher = threading.Thread(target=show, args=(over,), daemon=True)
    _running.append(over)
    watcher.start()
    try:
        yield
    finally:
        over.set()
        watcher.join()
        _running.remove(over)
