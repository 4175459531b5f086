"""Ctrl-C: one line that says what is whole on disk and how to go on, and exit status 130."""

import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

began: float | None = None
"""When the command began, by `time.monotonic`; None where none did."""
STATUS = 130
"""128 + SIGINT, as shells have it."""


class Interruption:
    """What to say should the user interrupt."""

    def __init__(self):
        self.pressed = False
        self.describe: Callable[[], str] = lambda: "nothing was begun"
        """What is whole, and how to go on."""

    def check(self) -> None:
        """Stop now if the user has interrupted. Imports can swallow the exception that tells it."""
        if self.pressed:
            raise KeyboardInterrupt


@contextmanager
def one_line(label: str) -> Iterator[Interruption]:
    """Answer Ctrl-C in the block with one line and exit status 130. A second Ctrl-C ends the process at once.

    Args:
        label: The command, which the line begins with.
    """
    interruption, main = Interruption(), os.getpid()

    def press(*_) -> None:
        if os.getpid() != main:  # a forked worker, which leaves the message to its parent
            raise KeyboardInterrupt
        if interruption.pressed:
            os._exit(STATUS)
        interruption.pressed = True
        raise KeyboardInterrupt

    # A shell that starts a command in the background has it ignore Ctrl-C.
    ours = threading.current_thread() is threading.main_thread() and signal.getsignal(signal.SIGINT) != signal.SIG_IGN
    before = signal.signal(signal.SIGINT, press) if ours else None
    try:
        yield interruption
    except BaseException as error:
        # An import that is interrupted can fail with another error.
        if not (interruption.pressed or isinstance(error, KeyboardInterrupt)):
            raise
        clear = "\r" if sys.stderr.isatty() else ""  # over the terminal's ^C
        print(f"{clear}{label}: interrupted; {interruption.describe()}", file=sys.stderr, flush=True)
        sys.exit(STATUS)
    finally:
        if ours:
            signal.signal(signal.SIGINT, before)
