"""A table of the paper as text: for the terminal, and as Markdown with its notes."""

from dmae.evaluation.paper_tables.table import Origin
from dmae.reporting.tables import Table


def terminal_table(table: dict) -> Table:
    """Return a table to print.

    Args:
        table: What `dmae.evaluation.paper_tables.make.make_table` returned, or its JSON.
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
        cells = [_cell(row["cells"][column["key"]], unknown) for column in columns]
        differences = [_difference(row["differences"].get(column["key"])) for column in leading]
        rows.append([name, row["origin"], row["protocol"], *cells, *differences])
    return header, rows


def _cell(cell: dict, unknown: str) -> str:
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
