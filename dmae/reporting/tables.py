"""Tables of text: for a terminal, a pipe, or a page."""

from collections.abc import Sequence
from dataclasses import dataclass

import rich.table
from rich.box import SIMPLE
from rich.console import Console


@dataclass(frozen=True)
class Moment:
    """A place in the page's player: a frame of a clip, and the person to look at, if one is meant."""

    clip: str
    frame: int
    person: int | None = None


@dataclass(frozen=True)
class Choices:
    """What a reader of the page may decide on each row of a table, and the JSON file that the page saves of it.

    Attributes:
        name: Of the file.
        options: Values that a row can be given; without one it is left out of the file.
        rows: One for each row of the table: what the file says of it, with the value added as `verdict`.
        file: Content of the file in addition to its list of `decisions`.
    """

    name: str
    options: Sequence[str]
    rows: Sequence[dict]
    file: dict


@dataclass(frozen=True)
class Table:
    """A caption, a header, and rows of cells, which are written as they are; format numbers first.

    Attributes:
        bars: Columns, by index, that a page draws with a bar behind each number, in proportion to the largest.
        moments: What the first cell of each row opens in the player of a page; none, or one a row.
        choices: What may be decided on each row; by default nothing.
    """

    caption: str
    header: Sequence[str]
    rows: Sequence[Sequence[str]]
    bars: Sequence[int] = ()
    moments: Sequence[Moment | None] = ()
    choices: Choices | None = None

    def __post_init__(self):
        if self.moments and len(self.moments) != len(self.rows):
            raise ValueError(f"table {self.caption!r}: {len(self.rows)} rows, but {len(self.moments)} moments")
        if self.choices and len(self.choices.rows) != len(self.rows):
            raise ValueError(f"table {self.caption!r}: {len(self.rows)} rows, but {len(self.choices.rows)} choices")


def print_tables(tables: Sequence[Table]) -> None:
    """Print tables; in a pipe as plain text, every cell in full."""
    console = Console()
    if not console.is_terminal:
        console = Console(width=1000)
    for table in tables:
        drawn = rich.table.Table(title=table.caption, title_justify="left", box=SIMPLE, padding=0)
        for column, heading in enumerate(table.header):
            drawn.add_column(heading, justify="right" if column else "left", no_wrap=True)
        for row in table.rows:
            drawn.add_row(*row)
        console.print(drawn)
