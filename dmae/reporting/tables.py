"""Tables of text for a terminal, a pipe, or a page; numbers of things in words."""

from collections.abc import Sequence
from dataclasses import dataclass

import rich.table
from rich.box import SIMPLE
from rich.cells import cell_len
from rich.console import Console


@dataclass(frozen=True)
class Moment:
    """A moment in the page's player: a frame of a clip, and optionally the person to look at."""

    clip: str
    frame: int
    person: int | None = None


@dataclass(frozen=True)
class Choices:
    """Decisions that a reader of the page can make on each row of a table. The page saves them as a JSON file."""

    name: str  # Name of the file
    options: Sequence[str]  # Values that a reader can choose for a row. Rows without a choice are left out of the file.
    rows: Sequence[dict]  # The file's entry for each row of the table. The page adds the chosen value as `verdict`.
    file: dict  # Content of the file. Chosen values are added to its list `decisions`.


@dataclass(frozen=True)
class Table:
    """A caption, a header, and rows of cells. Cells are text and are written unchanged, so format numbers first."""

    caption: str
    header: Sequence[str]
    rows: Sequence[Sequence[str]]
    # Indices of the columns that a page draws with a bar behind each number, in proportion to the largest
    bars: Sequence[int] = ()
    # For each row, the moment that its first cell opens in the player of a page; empty for none
    moments: Sequence[Moment | None] = ()
    choices: Choices | None = None  # Decisions that a reader can make on each row; None for none

    def __post_init__(self):
        if self.moments and len(self.moments) != len(self.rows):
            raise ValueError(f"table {self.caption!r}: {len(self.rows)} rows, but {len(self.moments)} moments")
        if self.choices and len(self.choices.rows) != len(self.rows):
            raise ValueError(f"table {self.caption!r}: {len(self.rows)} rows, but {len(self.choices.rows)} choices")


def print_tables(tables: Sequence[Table]) -> None:
    """Print tables. No cell is shortened: in a narrow terminal cells wrap between words, in a pipe lines are long."""
    for table in tables:
        console = Console()
        widths = _widths(table, console.width if console.is_terminal else 1000)
        # If not even single words fit, the terminal breaks the lines. A name with brackets or colons is no markup.
        width = max(console.width if console.is_terminal else 1000, sum(widths) + len(widths) + 1)
        console = Console(width=width, markup=False, emoji=False)
        drawn = rich.table.Table(title=table.caption, title_justify="left", box=SIMPLE, padding=0)
        for column, (heading, width) in enumerate(zip(table.header, widths, strict=True)):
            drawn.add_column(heading, justify="right" if column else "left", width=width)
        for row in table.rows:
            drawn.add_row(*row)
        console.print(drawn)


def _widths(table: Table, most: int) -> list[int]:
    """Return widths of the columns, in a line of at most so many characters unless a word is longer than its column."""
    columns = [*zip(table.header, *table.rows, strict=True)]
    widths = [max(map(cell_len, cells)) for cells in columns]
    words = [max(map(cell_len, " ".join(cells).split()), default=0) for cells in columns]
    while sum(widths) + len(widths) + 1 > most and widths != words:
        widest = max(range(len(widths)), key=lambda column: (widths[column] > words[column]) * widths[column])
        widths[widest] -= 1
    return widths


def markdown_table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table in Markdown."""
    return "\n".join(f"| {' | '.join(line)} |" for line in (header, ["---"] * len(header), *rows))


def counted(number: int, noun: str, plural: str = "") -> str:
    """Return "1 clip" or "1,200 clips"; the plural of `noun` ends in s unless it is given."""
    return f"{number:,} {noun if number == 1 else plural or noun + 's'}"


def listed(names: Sequence[str], most: int, between: str = ", ") -> str:
    """Return "a, b and 3 more": at most so many names, and how many more there are."""
    shown = between.join(names[:most])
    return f"{shown} and {len(names) - most} more" if len(names) > most else shown


def number_text(value: float | None, digits: int = 1) -> str:
    """Return a number as text, "-" if it is not known."""
    return "-" if value is None else f"{value:.{digits}f}"
