"""Published rows: figures of others, each with its source and its protocol, from `published.toml` in the same
folder."""

import tomllib
from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from importlib.resources import files

import numpy as np

from dmae.evaluation.config import NUMBERS, TableConfig, TableSize
from dmae.evaluation.evaluate import Trial
from dmae.metrics.intervals import BlockSums, Interval, block_members, bootstrap_difference, bootstrap_ratio
from dmae.reporting.tables import Table

_SECOND_HAND = "figures from a secondary source, not from the publication itself"
_REQUIRED = {"table", "name", "data", "protocol", "source", "values"}
_OPTIONAL = {"note", "second_hand"}


def published_rows(number: int) -> list[dict]:
    """Return the published rows of a table.

    Args:
        number: Of the table.

    Returns:
        In the order of the file: `name`, `data` (what it was scored on), `protocol`, `source`, `note`, and `values` by
        the key of the column.

    Raises:
        ValueError: a row has other keys than it may have, or lacks one.
    """
    text = files(__package__).joinpath("published.toml").read_text(encoding="utf-8")
    rows = tomllib.loads(text)["row"]
    for row in rows:
        if unfit := (set(row) - _OPTIONAL) ^ _REQUIRED:
            raise ValueError(f"published.toml, {row.get('name')!r}: unknown or missing {sorted(unfit)}")
    return [_with_note(row) for row in rows if row["table"] == number]


def _with_note(row: dict) -> dict:
    notes = [row.get("note", ""), _SECOND_HAND if row.get("second_hand") else ""]
    return {key: row[key] for key in ("name", "data", "protocol", "source", "values")} | {
        "note": "; ".join(filter(None, notes))
    }


# Tallies: numbers of correct and of counted items by blocks of time, for the cells of tables and their intervals.


@dataclass(frozen=True, eq=False)
class Tally:
    """Sums of one clip with one subset of its cameras.

    Attributes:
        clip: Id of the clip.
        cameras: Indices of the views used.
        total: (G, K, B) numerators of G persons and K kinds (limbs), over B blocks of time.
        count: (G, K, B) denominators.
        annotated: (G, K, B) number of items with truth, counted or not.
    """

    clip: str
    cameras: tuple[int, ...]
    total: np.ndarray
    count: np.ndarray
    annotated: np.ndarray


def limb_tally(trial: Trial, correct: np.ndarray, counted: np.ndarray, known: np.ndarray) -> Tally:
    """Return the tally of the limbs (F, T, L) of a trial's actors: correct, counted, and known at all."""
    frames = np.flatnonzero(known.any((1, 2)))
    _, member = block_members(frames, trial.clip.fps)

    def summed(limbs: np.ndarray) -> np.ndarray:
        return np.einsum("ftl,bf->tlb", limbs[frames][:, actors_of(trial)].astype(float), member.astype(float))

    return Tally(trial.clip.id, tuple(trial.cameras), summed(correct & counted), summed(counted), summed(known))


def actors_of(trial: Trial) -> list[int]:
    """Return the true persons that averages include: the actors of the trial, or all annotated persons."""
    if trial.actors is not None:
        return list(trial.actors)
    return np.flatnonzero((~np.isnan(trial.truth.xyz).any(-1)).any((0, 2))).tolist()


def pooled(
    tallies: Sequence[Tally], persons: Sequence[int] | None = None, kinds: Sequence[int] | None = None, scale=100.0
) -> BlockSums:
    """Return the sums of a cell: the mean over persons, then clips, then subsets of cameras.

    Args:
        tallies: Tallies of one method for each clip and subset.
        persons: Indices into G; by default all.
        kinds: Indices into K. Their counts are added; by default all.
        scale: Factor from a ratio to the unit of the cell.
    """
    clips = list(dict.fromkeys(tally.clip for tally in tallies))
    subsets = [tally.cameras for tally in tallies]
    parts = [[_selected(part, persons, kinds) for part in (each.total, each.count, each.annotated)] for each in tallies]
    # Blocks without truth for these persons are left out. They are the same for all methods.
    kept = {each.clip: annotated.any(0) for each, (_, _, annotated) in zip(tallies, parts, strict=True)}
    longest = max((int(known.sum()) for known in kept.values()), default=0)
    total, count, clip, share = [], [], [], []
    for each, (sums, counts, _) in zip(tallies, parts, strict=True):
        padding = ((0, 0), (0, longest - int(kept[each.clip].sum())))
        total.append(np.pad(sums[:, kept[each.clip]], padding))
        count.append(np.pad(counts[:, kept[each.clip]], padding))
        clip += [clips.index(each.clip)] * len(sums)
        share += [1 / (len(set(subsets)) * subsets.count(each.cameras) * len(sums))] * len(sums)
    return BlockSums(
        np.concatenate(total), np.concatenate(count), np.array(clip, int), np.array(share),
        np.array([int(kept[name].sum()) for name in clips]), scale,
    )  # fmt: skip


def _selected(part: np.ndarray, persons: Sequence[int] | None, kinds: Sequence[int] | None) -> np.ndarray:
    """(G, B) of some persons, added up over some kinds."""
    part = part if persons is None else part[list(persons)]
    return (part if kinds is None else part[:, list(kinds)]).sum(1)


# A table as JSON: columns, published rows, rows measured here, and how far each is from one of them.

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


# A table of the paper as text: for the terminal, and as Markdown with its notes.


def terminal_table(table: dict) -> Table:
    """Return a table to print.

    Args:
        table: What `dmae.evaluation.paper_tables.learned.make_table` returned, or its JSON.
    """
    header, rows = _grid(table)
    return Table(_caption(table), header, rows)


def markdown(table: dict) -> str:
    """Return a table as a section of Markdown: title, grid, notes and sources.

    Args:
        table: As for `terminal_table`.
    """
    header, rows = _grid(table, notes := _Notes())
    lines = [header, ["---"] * len(header), *rows]
    parts = [f"## {table['title']}", f"{_scored(table)}.", "\n".join(f"| {' | '.join(line)} |" for line in lines)]
    return "\n\n".join(filter(None, [*parts, notes.list(), *table["footnotes"]])) + "\n"


class _Notes:
    """Numbered notes; a note that is used again keeps its number."""

    def __init__(self):
        self.texts: list[str] = []

    def mark(self, *texts: str) -> str:
        """Return the numbers of some notes, in brackets; empty ones have none."""
        numbers = []
        for text in filter(None, texts):
            if text not in self.texts:
                self.texts.append(text)
            numbers.append(str(self.texts.index(text) + 1))
        return f" ({', '.join(numbers)})" if numbers else ""

    def list(self) -> str:
        return "\n".join(f"{number}. {text}" for number, text in enumerate(self.texts, 1))


def _caption(table: dict) -> str:
    return f"{table['title']}. {_scored(table)}"


def _scored(table: dict) -> str:
    frames = ", ".join(f"{name} {count}" for name, count in table["frames"].items())
    return f"Measured on {table['recording']}, protocol {table['protocol']}" + (
        f"; annotated frames: {frames}" if frames else ""
    )


def _grid(table: dict, notes: _Notes | None = None) -> tuple[list[str], list[list[str]]]:
    """Return header and rows of text; with `notes` rows refer to them."""
    columns = table["columns"]
    leading = [column for column in columns if column["lead"]]
    header = ["", "", "protocol", *(f"{column['heading']}, {column['unit']}" for column in columns)]
    header += [f"from {table['against']}: {column['heading'].partition(' (')[0]}" for column in leading]
    rows = []
    for row in table["rows"]:
        name = row["name"] + (notes.mark(row["source"], row["note"]) if notes else "")
        unknown = "-" if row["origin"] == Origin.published else Origin.missing
        cells = [_rendering_cell(row["cells"][column["key"]], unknown) for column in columns]
        differences = [_difference(row["differences"].get(column["key"])) for column in leading]
        rows.append([name, row["origin"], row["protocol"], *cells, *differences])
    return header, rows


def _rendering_cell(cell: dict, unknown: str) -> str:
    if cell["value"] is None:
        return unknown
    return f"{cell['value']:.1f}" + ("" if cell["low"] is None else f" [{cell['low']:.1f}, {cell['high']:.1f}]")


def _difference(cell: dict | None) -> str:
    """A difference, and whether it is noise."""
    if cell is None or cell["value"] is None:
        return ""
    if cell["low"] is None:
        return f"{cell['value']:+.1f}"
    noise = cell["low"] <= 0 <= cell["high"]
    return f"{cell['value']:+.1f} [{cell['low']:+.1f}, {cell['high']:+.1f}]{' noise' if noise else ''}"
