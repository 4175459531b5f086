"""The time limit of a training, which includes everything that the user waits for."""

import time
from collections.abc import Callable, Iterable, Iterator
from typing import TypeVar

T = TypeVar("T")

_MOST_CLOSING = 0.35
"""Share of the whole time that may be reserved for what follows training."""

_MOST_PREPARING = 0.2
"""Share of the time that is left that the examples of an epoch may take to make."""


class TimeLimit:
    """The time by which a command has to end; without minutes, never.

    Args:
        minutes: How long it may take; None for no limit.
        since: When it began, by `time.monotonic`; None for now.
    """

    def __init__(self, minutes: float | None, since: float | None = None):
        self.seconds = float("inf") if minutes is None else 60 * minutes
        self.end = (time.monotonic() if since is None else since) + self.seconds
        self.closing = 0.0
        """s reserved for what follows training."""
        self.preparing = 0.0
        """s that the examples of the last epoch took to make."""

    @property
    def limited(self) -> bool:
        return self.seconds < float("inf")

    def left(self) -> float:
        """Return the s until the end."""
        return self.end - time.monotonic()

    def training(self, done: float = 0.0) -> float:
        """Return the s left for training; `done` of them were used by the run that this one resumes."""
        return min(self.left(), self.seconds - done) - self.closing

    def reserve(self, *parts: tuple[Callable[[], object], float]) -> None:
        """Reserve time for what follows training, by timing one call of each part; with the number of calls to come."""
        if not self.limited:
            return
        for part, times in parts:
            begun = time.monotonic()
            part()
            self.closing += times * (time.monotonic() - begun)
        self.closing = min(self.closing, _MOST_CLOSING * self.seconds)

    def until(self) -> float:
        """Return the time, by `time.monotonic`, by which the examples of an epoch have to be made."""
        return time.monotonic() + _MOST_PREPARING * max(self.training(), 0) if self.limited else float("inf")

    def while_left(self, items: Iterable[T]) -> Iterator[T]:
        """Yield items while there is time; the first always."""
        for number, item in enumerate(items):
            if number and self.left() <= 0:
                return
            yield item
