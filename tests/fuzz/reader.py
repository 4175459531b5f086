"""A reader to fuzz: a function that reads files, and example files for it."""

import hashlib
import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Reader:
    """Something that reads files.

    Attributes:
        name: `<kind>/<name>`; `tests.fuzz.test_fuzz` checks that the registries' names are all there.
        write: Writes the files into an empty folder.
        read: Reads them, and returns what should be looked at.
        targets: Patterns of the files that are changed, one at a time.
        repair: Called after a change: puts checksums right, which would hide what lies behind.
        finite: Whether NaN is implausible in what is read.
        unnamed: Whether it reads a text, so that errors cannot name a file.
        errors: Those that its documentation states.
    """

    name: str
    write: Callable[[Path], object]
    read: Callable[[Path], object]
    targets: tuple[str, ...] = ("**/*",)
    repair: Callable[[Path], None] | None = None
    finite: bool = False
    unnamed: bool = False
    errors: tuple[type[Exception], ...] = (ValueError, FileNotFoundError)


def repair_sums(described: str, data: str, folder: Path) -> None:
    """Put the checksum of a file of arrays into the JSON beside it."""
    try:
        meta = json.loads((folder / described).read_bytes())
        meta["sha256"] = hashlib.sha256((folder / data).read_bytes()).hexdigest()
    except (ValueError, TypeError, RecursionError):
        return
    (folder / described).write_text(json.dumps(meta))
