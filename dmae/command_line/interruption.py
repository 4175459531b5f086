"""Ctrl-C and SIGTERM: one line that states what is complete on disk and how to continue, and exit status 130 or 143."""

import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

began: float | None = None
"""When the command began, by `time.monotonic`; None where none did."""
running: "Interruption | None" = None
"""The command that runs in this process; None where none does."""
_SIGNALS = (signal.SIGINT, signal.SIGTERM)


class Interruption:
    """What to say should the user interrupt."""

    def __init__(self):
        self.signal: int | None = None
        """The signal that interrupted; None before."""
        self.describe: Callable[[], str] = lambda: "nothing was begun"
        """What is complete, and how to continue."""

    @property
    def status(self) -> int:
        """The exit status for the signal, as in shells."""
        return 128 + (self.signal or signal.SIGINT)

    def check(self) -> None:
        """Stop now if the user has interrupted: an import or a library can swallow the exception of the signal."""
        if self.signal:
            raise KeyboardInterrupt


@contextmanager
def one_line(label: str) -> Iterator[Interruption]:
    """Answer Ctrl-C and SIGTERM in the block with one line, begun by `label`, and exit status 128 plus the signal.

    A second signal ends the process immediately.
    """
    global running
    interruption, main = Interruption(), os.getpid()
    running = interruption

    def press(number: int, _) -> None:
        if os.getpid() != main:  # in a forked worker: the parent prints the message
            raise KeyboardInterrupt
        if interruption.signal:
            os._exit(interruption.status)
        interruption.signal = number
        raise KeyboardInterrupt

    # A command that a shell starts in the background ignores Ctrl-C; this does not change here.
    main_thread = threading.current_thread() is threading.main_thread()
    ours = [number for number in _SIGNALS if main_thread and signal.getsignal(number) != signal.SIG_IGN]
    before = {number: signal.signal(number, press) for number in ours}
    try:
        yield interruption
    except BaseException as error:
        # An interrupted import can raise another error than KeyboardInterrupt.
        if not (interruption.signal or isinstance(error, KeyboardInterrupt)):
            raise
        clear = "\r" if sys.stderr.isatty() else ""  # overwrites the ^C that the terminal shows
        print(f"{clear}{label}: interrupted; {interruption.describe()}", file=sys.stderr, flush=True)
        sys.exit(interruption.status)
    finally:
        running = None
        for number, handler in before.items():
            signal.signal(number, handler)
