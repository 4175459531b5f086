"""The error of clips that cannot be used, and attempts until one can."""

from collections.abc import Callable
from contextlib import suppress
from typing import TypeVar

Made = TypeVar("Made")


class FailedSimulation(ValueError):
    """A clip cannot be used; the message says why."""


def until_success(attempt: Callable[[int], Made], last: int) -> Made:
    """Return the result of the first of `attempt(0)` to `attempt(last)` that succeeds. If all raise FailedSimulation,
    the last one is raised."""
    for number in range(last):
        with suppress(FailedSimulation):
            return attempt(number)
    return attempt(last)
