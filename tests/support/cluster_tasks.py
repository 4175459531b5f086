"""Tasks for the tests of clusters."""

import os
import signal
from pathlib import Path


def square_or_die(folder: str, number: int) -> int:
    """Return the square of a number. The first call with 3 ends the process without a message."""
    if number < 0:
        raise ValueError(f"expected 0 or more, got {number}")
    mark = Path(folder, "died")
    if number == 3 and not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return number**2
