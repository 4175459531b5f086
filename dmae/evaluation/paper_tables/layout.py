"""A table of the paper: published rows, rows measured here, and their differences from one row; as JSON and as text."""

import tomllib
from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from importlib.resources import files

from dmae.data.json_values import rounded
from dmae.evaluation.config import NUMBERS, TableConfig, TableSize
from dmae.metrics.table import Score
from dmae.reporting.tables import Table, markdown_table

_SECOND_HAND = "figures from a secondary source, not from the publication itself"


def published_rows(number: int) -> list[dict]:
    """Return the published rows of a table, in the order of the file.

    A row has `table`, `name`, `data` (what it was scored on), `protocol`, `source`, `note`, and `values` by the key of
    the column.
    """
    text, found = files(__package__).joinpath("published.toml").read_text(encoding="utf-8"), []
    for group in tomllib.loads(text)["group"]:
        shared = {key: value for key, value in group.items() if key != "rows"}
        for row in (shared | own for own in group["rows"]):
            notes = (row.get("note"), _SECOND_HAND if row.pop("second_hand", False) else None)
            found.append(row | {"note": "; ".join(filter(None, notes))})
    return [row for row in found if row["table"] == number]


_JOINT_TABLES = (5, 6)  # They count joints within 0.2 m, not limbs by a protocol
_NOISE = (
    "Brackets: 95 % bootstrap intervals over blocks of one second. A difference with zero in its interval is noise. "
    "Published figures come without an interval, and theirs is taken to be nothing; under another protocol they differ "
    "by that, too. No interval is stated for fewer than five blocks."
)

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
    """A column."""

    key: str  # Name of its cells
    heading: str  # What people read
    unit: str = "%"  # "%" or "mm"
    lead: bool = False  # Whether rows are compared by it


@dataclass(frozen=True, eq=False)
class MeasuredRow:
    """A row measured here."""

    name: str  # Name of the method
    # Scores by the key of the column, or a number that has no interval
    cells: dict[str, Score | float] = field(default_factory=dict)
    note: str = ""  # What readers have to know about it
    missing: str = ""  # Why it was not measured; then it has no cells
    protocol: str = ""  # Its protocol, if it is not the one of the table
    against: str = ""  # Name of the row that it is compared with, if it is not the one of the table
    paper: str = ""  # Its publication, as published rows name it, if it is a re-implemented system


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
    pairs: Sequence[tuple[str, str]] = (),
) -> dict:
    """Return a table.

    Args:
        config: Number, protocol and size of the table.
        columns: Columns, in their order.
        rows: Rows that are measured here.
        against: Name of the measured row that all others are compared with.
        comparable: Data set on which published rows are compared with ours; None to compare none.
        recording: Name of the scored data.
        frames: Number of annotated frames of each actor.
        footnotes: Differences from the paper, with their reasons.
        pairs: Further comparisons: the name of a measured row, and of the row that it is compared with.

    Returns:
        JSON-able. `number`, `title`, `recording`, `protocol`, `frames`, `against`, `footnotes`, `columns`; `rows`:
        `name`, `origin`, `protocol`, `source`, `note`, `cells` (`value`, `low`, `high` by column, None for unknown
        values) and `differences` from the row `against`, its own or the table's, in the same form, in leading columns;
        and `pairs`: `name`, `against` and `differences` in all columns.
    """
    by_name = {row.name: row for row in rows}
    reference = by_name[against]
    made = [_published(row, columns, reference, comparable) for row in published_rows(config.number)]
    rules = "joints within 0.2 m" if config.number in _JOINT_TABLES else config.protocol
    for row in rows:
        made.append(_measured(row, columns, by_name[row.against or against], rules))
        if row.paper and comparable:
            made[-1]["note"] += below_publication(made[-1]["cells"], row.paper, columns, config.number)
    compared = [
        {"name": name, "against": other, "differences": _differences(by_name[name], by_name[other], columns)}
        for name, other in pairs
    ]
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
        "pairs": compared,
        "footnotes": [*footnotes, _NOISE, *([_SMALL] if config.size == TableSize.small else [])],
    }


def _measured(row: MeasuredRow, columns: Sequence[TableColumn], reference: MeasuredRow, rules: str) -> dict:
    return {
        "name": row.name,
        "origin": str(Origin.missing if row.missing else Origin.measured),
        "protocol": row.protocol or rules,
        "source": "",
        "note": row.missing or row.note,
        "against": row.against,
        "cells": {column.key: _cell(row.cells.get(column.key)) for column in columns},
        "differences": {} if row is reference else _differences(row, reference, [c for c in columns if c.lead]),
    }


def below_publication(cells: dict[str, dict], paper: str, columns: Sequence[TableColumn], number: int) -> str:
    """Return a note on the leading columns in which a row is below its publication; empty if in none."""
    published = [row["values"] for row in published_rows(number) if row["name"].endswith(f"({paper})")]
    below = []
    for column in columns:
        greatest = max((values[column.key] for values in published if column.key in values), default=None)
        value = cells[column.key]["value"]
        if column.lead and greatest is not None and value is not None and value < greatest:
            below.append(f"{greatest:.1f} {column.unit} ({column.heading.partition(' (')[0]})")
    return f"; below its publication, which has {', '.join(below)}" if below else ""


def _differences(row: MeasuredRow, other: MeasuredRow, columns: Sequence[TableColumn]) -> dict[str, dict]:
    """Return how far a row is from another in the columns that have scores of both, on the same draws of time."""
    both = {column.key: (row.cells.get(column.key), other.cells.get(column.key)) for column in columns}
    return {key: _cell(a - b) for key, (a, b) in both.items() if isinstance(a, Score) and isinstance(b, Score)}


def _published(row: dict, columns: Sequence[TableColumn], reference: MeasuredRow, comparable: str | None) -> dict:
    cells = {column.key: _cell(row["values"].get(column.key)) for column in columns}
    differences = {}
    for column in columns:
        value, ours = row["values"].get(column.key), reference.cells.get(column.key)
        if column.lead and value is not None and row["data"] == comparable:
            differences[column.key] = _cell(value - ours)
    return {
        "name": row["name"],
        "origin": str(Origin.published),
        "protocol": row["protocol"],
        "source": row["source"],
        "note": row["note"],
        "cells": cells,
        "differences": differences,
    }


def _cell(cell: Score | float | None) -> dict[str, float | None]:
    if isinstance(cell, Score):
        return cell.json(3)
    return {"value": rounded(cell, 3), "low": None, "high": None}


def terminal_tables(table: dict) -> list[Table]:
    """Return a table of `make_table`, or its JSON, to print, and its compared pairs of rows if there are any."""
    header, rows = _grid(table)
    pairs = [Table("Differences between rows.", *_pairs(table))] if table.get("pairs") else []
    return [Table(f"{table['title']}. {_scored(table)}", header, rows), *pairs]


def markdown(table: dict) -> str:
    """Return a table of `make_table` as a section of Markdown: title, grid, compared pairs, notes and sources."""
    notes: dict[str, int] = {}
    grid = markdown_table(*_grid(table, notes))
    pairs = markdown_table(*_pairs(table)) if table.get("pairs") else ""
    parts = [f"## {table['title']}", f"{_scored(table)}.", grid, pairs]
    parts += ["\n".join(f"{number}. {text}" for text, number in notes.items()), *table["footnotes"]]
    return "\n\n".join(filter(None, parts)) + "\n"


def _scored(table: dict) -> str:
    frames = ", ".join(f"{name} {count}" for name, count in table["frames"].items())
    return f"Measured on {table['recording']}, protocol {table['protocol']}" + (
        f"; annotated frames: {frames}" if frames else ""
    )


def _grid(table: dict, notes: dict[str, int] | None = None) -> tuple[list[str], list[list[str]]]:
    """Return header and rows of text. Rows refer by number to their sources and notes, which are added to `notes`."""
    columns = table["columns"]
    leading = [column for column in columns if column["lead"]]
    header = ["", "", "protocol", *(f"{column['heading']}, {column['unit']}" for column in columns)]
    header += [f"from {table['against']}: {column['heading'].partition(' (')[0]}" for column in leading]
    rows = []
    for row in table["rows"]:
        name = row["name"]
        texts = filter(None, (row["source"], row["note"]))
        if notes is not None and (marks := [str(notes.setdefault(text, len(notes) + 1)) for text in texts]):
            name += f" ({', '.join(marks)})"
        unknown = "-" if row["origin"] == Origin.published else Origin.missing
        cells = [_cell_text(row["cells"][column["key"]], unknown) for column in columns]
        differences = [_difference(row["differences"].get(column["key"])) for column in leading]
        if row.get("against"):
            differences = [f"{text} (from {row['against']})" if text else "" for text in differences]
        rows.append([name, row["origin"], row["protocol"], *cells, *differences])
    return header, rows


def _pairs(table: dict) -> tuple[list[str], list[list[str]]]:
    """Return a header and a row of text for each compared pair, with the columns in which any pair has scores."""
    pairs = table["pairs"]
    columns = [c for c in table["columns"] if any(c["key"] in pair["differences"] for pair in pairs)]
    header = ["", *(f"{column['heading'].partition(' (')[0]}, {column['unit']}" for column in columns)]
    return header, [
        [f"{pair['name']}, from {pair['against']}", *(_difference(pair["differences"].get(c["key"])) for c in columns)]
        for pair in pairs
    ]


def _cell_text(cell: dict, unknown: str) -> str:
    if cell["value"] is None:
        return unknown
    return f"{cell['value']:.1f}" + ("" if cell["low"] is None else f" [{cell['low']:.1f}, {cell['high']:.1f}]")


def _difference(cell: dict | None) -> str:
    """Return a difference as text, and whether it is noise."""
    if cell is None or cell["value"] is None:
        return ""
    if cell["low"] is None:
        return f"{cell['value']:+.1f}"
    noise = cell["low"] <= 0 <= cell["high"]
    return f"{cell['value']:+.1f} [{cell['low']:+.1f}, {cell['high']:+.1f}]{' noise' if noise else ''}"
