"""The registry of metrics. Each metric is a key of `scores.json`, and may be a column of the tables.

To add a metric, write a function with the decorator `metric` in a file of this folder. It takes a `Comparison` and
returns a number, or a list or dictionary of numbers, with NaN if there is nothing to score, or None if an option turns
it off. The first line of its docstring names the measured quantity and its unit. Listing the metrics imports them, as
columns contain functions.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from dmae.registry import Entry, Registry


@dataclass(frozen=True)
class Column:
    """A column of the tables of joints and of identities."""

    heading: str  # Heading, unique among all columns
    unit: str  # Unit of the numbers: "%", "mm" or ""
    # Takes the score of the metric, and returns a number, or None if there is none
    value: Callable[[Any], float | None] = lambda score: score
    order: int = 100  # Columns are sorted by this number, then by the order of the metrics
    table: str = "joints"  # "joints" or "identities"


@dataclass(frozen=True)
class Metric(Entry):
    """A metric."""

    order: int = 100  # Metrics are sorted by this number, then by name
    columns: tuple[Column, ...] = ()  # Its columns in the tables of joints and identities
    # Takes the scores of several runs, and returns the score of all runs; None for the mean of each number, first over
    # clips, then over subsets of cameras
    pool: Callable[[list], Any] | None = None
    # True if scores of different clips cannot be averaged; then there is no mean over several clips
    one_clip: bool = False


@dataclass(frozen=True)
class Protocol(Entry):
    """A protocol: its function assigns predictions to true persons, as `dmae.metrics.comparison.match` does."""

    missed_count: bool = True  # Whether limbs of a person without a prediction count as not correct
    at_half: bool = True  # Whether a limb with an error of exactly half its length is correct
    head: str = "4da"  # How the ends of the annotated head are placed (`dmae.evaluation.paper_tables.tables`)


metric = Registry("metric", Metric, __package__)
protocol = Registry("protocol", Protocol, __package__)


def metrics() -> list[Metric]:
    """Return all metrics in their order."""
    return sorted(metric.values(), key=lambda each: (each.order, each.name))
