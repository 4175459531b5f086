"""What readers share: lines and numbers of text files, gaps in recordings, and the motion of a recorded skeleton."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from dmae.files.contents import COMPRESSED, read_unpacked, without_compression
from dmae.numerics.paths import neighbours, pchip, runs

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

    Raises ValueError if words are no numbers, more or fewer than expected, NaN or infinite.
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


def number_table(path: Path, lines: Sequence[int], rows: list[list[str]], columns: int) -> np.ndarray:
    """Return the numbers (len(rows), columns) in the words of lines, counted from 0. Raises as `numbers`."""
    with suppress(ValueError):
        values = np.array(rows, np.float64)
        if values.shape == (len(rows), columns) and (np.abs(values) <= LARGEST).all():
            return values
    # Slow, but finds the line.
    return np.array([numbers(path, line, row, columns) for line, row in zip(lines, rows, strict=True)])


_LONGEST = 0.25
"""Longest gap that is interpolated, s; for the wrist of a walking person the error is about 2 cm."""


def fill_gaps(values: np.ndarray, names: list[str], fps: float, path: Path) -> tuple[np.ndarray, tuple[str, ...]]:
    """Fill short gaps in values (F, K, C), and return the longest stretch without gaps, and notes on both.

    Gaps of up to a quarter of a second are filled by monotone cubic interpolation (Fritsch and Carlson, SIAM Journal on
    Numerical Analysis 17, 1980).

    Raises ValueError if less than half of the recording is left.
    """
    values = np.where(np.isfinite(values), values, np.nan)
    lost = np.isnan(values).any(2)
    if not lost.any():
        return values, ()
    before, after = neighbours(~lost)
    short = lost & (before >= 0) & (after < len(values)) & (after - before - 1 <= _LONGEST * fps)
    filled = np.where(short[..., None], pchip(values), values)
    whole = ~np.any(np.isnan(filled), (1, 2))
    first, end = max(runs(whole), key=lambda run: run[1] - run[0], default=(0, 0))
    if end - first < 0.5 * len(values):
        share = lost.mean(0)
        worst = ", ".join(f"{names[k]} in {100 * share[k]:.0f} %" for k in share.argsort()[::-1][:5] if share[k])
        raise ValueError(
            f"{path}: expected at least half of {len(values)} frames in a row without gaps of more than {_LONGEST} s, "
            f"found {end - first}; missing are {worst}"
        )
    notes = [f"{short.sum()} values interpolated"] if short.any() else []
    if end - first < len(values):
        notes.append(f"frames {first + 1}-{end} of {len(values)}")
    return filled[first:end], tuple(notes)


@dataclass(frozen=True)
class SkeletonRecording:
    """J joints in a tree over F frames."""

    path: Path  # The file that it was read from
    fps: float  # Frames per second
    joints: tuple[str, ...]  # J joint names, every parent before its children; the end site of a chain is `<joint>.end`
    parents: tuple[int, ...]  # (J,) index of each joint's parent, -1 for the root, which comes first
    # (J, 3) position of each joint in its parent's frame, in the file's unit; the root's is not used
    offsets: np.ndarray
    root: np.ndarray  # (F, 3) position of the root in the world, in the file's unit
    rotations: np.ndarray  # (F, J, 3, 3) orientation of each joint in its parent's frame
    notes: tuple[str, ...] = ()  # Descriptions of repairs that were made in reading it

    def __len__(self) -> int:
        return len(self.root)

    def forward(self) -> tuple[np.ndarray, np.ndarray]:
        """Return positions (F, J, 3), in the file's unit, and orientations (F, J, 3, 3) of the joints in the world."""
        positions = np.empty((*self.rotations.shape[:2], 3))
        orientations = np.empty_like(self.rotations)
        for joint, parent in enumerate(self.parents):
            if parent < 0:
                positions[:, joint], orientations[:, joint] = self.root, self.rotations[:, joint]
            else:
                positions[:, joint] = positions[:, parent] + orientations[:, parent] @ self.offsets[joint]
                orientations[:, joint] = orientations[:, parent] @ self.rotations[:, joint]
        return positions, orientations

    def turned(self, turn: np.ndarray) -> "SkeletonRecording":
        """Return the recording with its world turned by a rotation (3, 3)."""
        rotations = self.rotations.copy()
        rotations[:, 0] = turn @ rotations[:, 0]
        return replace(self, root=self.root @ turn.T, rotations=rotations)
