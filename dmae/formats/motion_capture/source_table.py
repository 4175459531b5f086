"""A table of the source of each joint, for files in formats that have no place for it."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from dmae.data.clip import Source
from dmae.data.store import write_atomic


def write_source_table(path: Path, names: Sequence[str], source: np.ndarray) -> None:
    """Write `<name>.source.csv`: measured, denoised, completed or absent, a row a frame from 1 on, a column a joint.

    Args:
        path: The file that the table is about.
        names: J names of joints, as in that file.
        source: (F, J) `Source`.
    """
    words = np.array([kind.name.lower() for kind in Source])[source]
    rows = [",".join(["Frame#", *names])]
    rows += [",".join([str(frame), *row]) for frame, row in enumerate(words, 1)]
    write_atomic(source_table(path), "\n".join(rows) + "\n")


def source_table(path: Path) -> Path:
    """Return the path of the table about a file."""
    return Path(path).with_suffix(".source.csv")


def person_paths(path: Path, persons: int) -> list[Path]:
    """Return the files of several persons, `<name>_P1.<suffix>` and on; of a single one the path itself."""
    path = Path(path)
    if persons == 1:
        return [path]
    return [path.with_name(f"{path.stem}_P{person + 1}{path.suffix}") for person in range(persons)]
