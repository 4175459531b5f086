"""The error of clips that cannot be used, and attempts until one can."""

from collections.abc import Callable
from contextlib import suppress
from typing import TypeVar

Made = TypeVar("Made")


class FailedSimulation(ValueError):
    """A clip cannot be used; the message says why."""


def until_success(attempt: Callable[[int], Made], last: int) -> Made:
    """Return `attempt(number)` of the first number from 0 on that does not raise FailedSimulation. Raise that of the
    last number if all do."""
    for number in range(last):
        with suppress(FailedSimulation):
            return attempt(number)
    return attempt(last)
