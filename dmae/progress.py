"""Progress with time left on a terminal, nothing when piped."""

from collections.abc import Iterable, Iterator

from rich.console import Console
from rich.progress import track


def progress(items: Iterable, description: str, total: int | None = None) -> Iterator:
    """Yield the items, drawing a bar with the time left on stderr while they last."""
    console = Console(stderr=True)
    yield from track(items, description, total, console=console, disable=not console.is_terminal, transient=True)
