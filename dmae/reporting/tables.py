"""Tables of text: for a terminal, a pipe, or a page."""

from collections.abc import Sequence
from dataclasses import dataclass

import rich.table
from rich.box import SIMPLE
from rich.console import Console


@dataclass(frozen=True)
class Table:
    """A caption, a header, and rows of cells, which are written as they are; format numbers first."""

    caption: str
    header: Sequence[str]
    rows: Sequence[Sequence[str]]


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
