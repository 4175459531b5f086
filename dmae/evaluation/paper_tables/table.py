"""A table as JSON: columns, published rows, rows measured here, and how far each is from one of them."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np

from dmae.evaluation.paper_tables.config import NUMBERS, TableConfig, TableSize
from dmae.evaluation.paper_tables.published import published_rows
from dmae.metrics.intervals import Interval, bootstrap_difference, bootstrap_ratio
from dmae.metrics.time_blocks import BlockSums

_SMALL = (
    "size=small: fewer methods and short trainings; rows of models trained for this table are below what they can do."
)


class Origin(StrEnum):
    """Where the figures of a row come from."""

    published = "published"
    measured = "measured here"
    missing = "not measured"


@dataclass(frozen=True)
class TableColumn:
    """A column.

    Attributes:
        key: Name of its cells.
        heading: What people read.
        unit: "%" or "mm".
        lead: Whether rows are compared by it.
    """

    key: str
    heading: str
    unit: str = "%"
    lead: bool = False


@dataclass(frozen=True, eq=False)
class MeasuredRow:
    """A row measured here.

    Attributes:
        name: Of the method.
        cells: Sums by the key of the column, or a number that has no interval.
        note: What has to be known about it.
        missing: Why it was not measured; then it has no cells.
        protocol: Where it is not that of the table.
    """

    name: str
    cells: dict[str, BlockSums | float] = field(default_factory=dict)
    note: str = ""
    missing: str = ""
    protocol: str = ""


def paper_table(
    config: TableConfig,
    columns: Sequence[TableColumn],
    rows: Sequence[MeasuredRow],
    *,
    against: str,
    comparable: str | None,
    recording: str,
    frames: dict[str, int],
    footnotes: Sequence[str],
    rules: str = "",
) -> dict:
    """Return a table.

    Args:
        config: Says which.
        columns: In their order.
        rows: Measured here.
        against: Name of the measured row that all others are compared with.
        comparable: Data that published rows have to be of to be compared; None where no row is.
        recording: What was scored.
        frames: Annotated frames of each actor.
        footnotes: What differs from the paper, and why.
        rules: How rows are scored; by default the protocol of the configuration.

    Returns:
        JSON-able. `number`, `title`, `recording`, `protocol`, `frames`, `against`, `footnotes`, `columns`; and `rows`:
        `name`, `origin`, `protocol`, `source`, `note`, `cells` (`value`, `low`, `high` by column, None for unknown
        values) and `differences` from the row `against`, in the same form, in leading columns.
    """
    (reference,) = (row for row in rows if row.name == against)
    made = [_published(row, columns, reference, comparable) for row in published_rows(config.number)]
    rules = rules or config.protocol
    made += [_measured(row, columns, reference, rules) for row in rows]
    return {
        "number": config.number,
        "title": f"Table {config.number}: {NUMBERS[config.number]}",
        "recording": recording,
        "protocol": rules,
        "size": str(config.size),
        "frames": frames,
        "against": against,
        "columns": [vars(column) for column in columns],
        "rows": made,
        "footnotes": [*footnotes, *([_SMALL] if config.size == TableSize.small else [])],
    }


def _measured(row: MeasuredRow, columns: Sequence[TableColumn], reference: MeasuredRow, rules: str) -> dict:
    cells, differences = {}, {}
    for column in columns:
        cell = row.cells.get(column.key)
        cells[column.key] = _cell(_interval(cell))
        other = reference.cells.get(column.key)
        if column.lead and row is not reference and isinstance(cell, BlockSums) and isinstance(other, BlockSums):
            differences[column.key] = _cell(bootstrap_difference(cell, other))
    return {
        "name": row.name,
        "origin": str(Origin.missing if row.missing else Origin.measured),
        "protocol": row.protocol or rules,
        "source": "",
        "note": row.missing or row.note,
        "cells": cells,
        "differences": differences,
    }


def _published(row: dict, columns: Sequence[TableColumn], reference: MeasuredRow, comparable: str | None) -> dict:
    cells = {column.key: _cell(_interval(row["values"].get(column.key))) for column in columns}
    differences = {}
    for column in columns:
        value, ours = row["values"].get(column.key), _interval(reference.cells.get(column.key))
        if column.lead and value is not None and row["data"] == comparable:
            differences[column.key] = _cell(Interval(value - ours.value, value - ours.high, value - ours.low))
    return {
        "name": row["name"],
        "origin": str(Origin.published),
        "protocol": row["protocol"],
        "source": row["source"],
        "note": row["note"],
        "cells": cells,
        "differences": differences,
    }


def _interval(cell: BlockSums | float | None) -> Interval:
    if isinstance(cell, BlockSums):
        return bootstrap_ratio(cell)
    return Interval(np.nan if cell is None else float(cell), np.nan, np.nan)


def _cell(interval: Interval) -> dict[str, float | None]:
    return {
        name: None if np.isnan(value) else round(value, 3)
        for name, value in (("value", interval.value), ("low", interval.low), ("high", interval.high))
    }
