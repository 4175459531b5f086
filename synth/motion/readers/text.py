"""Lines and numbers of text files, with errors that give the line."""

from pathlib import Path

import numpy as np

from dmae.files.compressed import COMPRESSED, read_unpacked, without_compression

_MOST_BYTES, _MOST_UNPACKED = 1 << 30, 1 << 28
_CELLS = 200_000
LARGEST = 1e9
"""Greatest absolute value of any number, in any unit."""


def read_lines(path: Path) -> list[str]:
    """Return the lines of a text file, which may be compressed.

    Raises:
        FileNotFoundError: there is no such file.
        ValueError: the file is empty or binary, or its compression is damaged.
    """
    data = read_unpacked(path, _MOST_BYTES if without_compression(path.name) == path.name else _MOST_UNPACKED)
    if not data.strip() or b"\0" in data:
        raise ValueError(f"{path}: expected a text file, found {'binary data' if data.strip() else 'an empty one'}")
    return data.decode("latin-1").splitlines()


def find_text(path: Path) -> Path | None:
    """Return the path of a text file, with or without the extension of a compression; None if there is neither."""
    there = [found for end in ("", *COMPRESSED) if (found := path.with_name(path.name + end)).is_file()]
    return there[0] if there else None


def check_size(path: Path, lines: list[str], frames: int, joints: int) -> None:
    """Raise ValueError if a small file states many joints and frames, which would take far more memory."""
    size = sum(map(len, lines))
    if frames * joints > max(_CELLS, size):
        raise ValueError(f"{path}: expected numbers for {joints} joints in {frames} frames, found {size} bytes")


def malformed(path: Path, line: int, expected: str, found: str) -> ValueError:
    """Return the error for a line, counted from 0."""
    return ValueError(f"{path}, line {line + 1}: expected {expected}, found {found.strip()[:80]!r}")


def numbers(path: Path, line: int, words: list[str], expected: int) -> list[float]:
    """Return the finite numbers in the words of a line, counted from 0.

    Raises:
        ValueError: words are no numbers, more or fewer than expected, NaN or infinite.
    """
    try:
        values = [float(word) for word in words]
    except ValueError:
        raise malformed(path, line, f"{expected} numbers", " ".join(words)) from None
    if len(values) != expected:
        raise malformed(path, line, f"{expected} numbers", f"{len(values)} numbers")
    if not np.isfinite(values).all():
        column = int(np.flatnonzero(~np.isfinite(values))[0])
        raise malformed(path, line, f"a finite number in column {column + 1}", words[column])
    if np.abs(values).max(initial=0) > LARGEST:
        raise malformed(path, line, f"numbers up to {LARGEST:g}", " ".join(words))
    return values
