"""The registry of metrics: what becomes a key of `scores.json`, and a column of the tables.

To add a metric, write a function into a file of this folder under the decorator `metric`. It takes a `Comparison` and
returns a number, or a list or dictionary of numbers, NaN for a score of nothing; the first line of its docstring says
what is measured, with the unit. To list metrics imports them, as columns hold functions.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from dmae.registry import Entry, Registry


@dataclass(frozen=True)
class Column:
    """A column of the tables of joints and of identities.

    Attributes:
        heading: Unique among all columns.
        unit: Of the numbers: "%", "mm" or "".
        value: Takes the score of the metric, and returns a number, or None for nothing.
        order: Columns stand in this order, then in that of the metrics.
        table: "joints" or "identities".
    """

    heading: str
    unit: str
    value: Callable[[Any], float | None] = lambda score: score
    order: int = 100
    table: str = "joints"


@dataclass(frozen=True)
class Metric(Entry):
    """A metric.

    Attributes:
        order: Metrics stand in this order, then by name.
        columns: Its columns in the tables of joints and identities.
        pool: Takes the scores of several runs, and returns that of all of them; None for the mean of each number,
            first over clips, then over subsets of cameras.
        one_clip: Whether scores of different clips cannot be averaged; then there is no mean over several clips.
    """

    order: int = 100
    columns: tuple[Column, ...] = ()
    pool: Callable[[list], Any] | None = None
    one_clip: bool = False


metric = Registry("metric", Metric, __package__)


def metrics() -> list[Metric]:
    """Return all metrics in their order."""
    return sorted(metric.values(), key=lambda each: (each.order, each.name))
