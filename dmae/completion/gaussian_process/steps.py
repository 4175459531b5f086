"""Steps: work that can be spread over time."""

from collections.abc import Generator
from typing import TypeVar

T = TypeVar("T")
Steps = Generator[float, None, T]
"""Work in steps, and its result. A step ends with what it cost, about: 1 is a millisecond of one core."""


def finished(steps: Steps[T]) -> T:
    """Return the result of all steps."""
    while True:
        try:
            next(steps)
        except StopIteration as end:
            return end.value
