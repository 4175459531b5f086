"""Tasks for the tests of clusters."""

import os
import signal
from pathlib import Path


def square_or_die(folder: str, number: int) -> int:
    """Return the square of a number; the first time that it is asked for that of 3, end the process without a word."""
    if number < 0:
        raise ValueError(f"expected 0 or more, got {number}")
    mark = Path(folder, "died")
    if number == 3 and not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return number**2
