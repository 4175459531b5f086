"""Large arrays in files, and the blocks of frames in which long recordings are processed.

A long recording does not fit into memory. Its arrays are in files that are mapped into memory, and loops go over blocks
of frames. After each block, all mapped pages leave memory; they are read again when an array is accessed.
"""

import ctypes
import mmap
import os
import tempfile
from collections.abc import Callable, Iterable, Iterator
from functools import cache
from math import prod
from pathlib import Path
from typing import TypeVar
from weakref import WeakSet

import numpy as np

T = TypeVar("T")

LARGE = 16 << 20
"""Bytes; smaller arrays are in memory."""
_BLOCK = 8 << 20  # Bytes of arrays in a block
_mappings: WeakSet[mmap.mmap] = WeakSet()  # The files that are mapped now; each is closed with its last array


def empty(shape: tuple[int, ...], dtype: type | np.dtype) -> np.ndarray:
    """Return an array to be filled: in memory or, if it is large, in a file in `TMPDIR` that is removed with the array.

    Raises OSError if the disk is full.
    """
    size = prod(shape) * np.dtype(dtype).itemsize
    if size < LARGE:
        return np.empty(shape, dtype)
    with tempfile.TemporaryFile(prefix="dmae-") as file:
        try:
            # The space is allocated now. Otherwise a full disk would kill the process when the array is written to.
            getattr(os, "posix_fallocate", lambda file, _, size: os.ftruncate(file, size))(file.fileno(), 0, size)
        except OSError as error:
            raise OSError(
                error.errno, f"{error.strerror}; {size / 1e6:.0f} MB are needed", tempfile.gettempdir()
            ) from None
        mapping = mmap.mmap(file.fileno(), size)
    _mappings.add(mapping)
    return np.frombuffer(mapping, dtype).reshape(shape)


def map_file(path: Path) -> mmap.mmap:
    """Return the bytes of a file, which are read when they are accessed."""
    with path.open("rb") as file:
        mapping = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
    _mappings.add(mapping)
    return mapping


def in_steps(steps: Iterable[T]) -> Iterator[T]:
    """Yield the steps of a loop over a long recording. After each step, all mapped arrays leave memory."""
    for step in steps:
        yield step
        if _mappings:
            for mapping in list(_mappings):
                if hasattr(mapping, "madvise"):
                    mapping.madvise(mmap.MADV_DONTNEED)
            trim()


def trim() -> None:
    """Return freed memory to the system if the C library can. Otherwise a process keeps what its largest step took."""
    _malloc_trim()(0)


@cache
def _malloc_trim() -> Callable[[int], int]:
    try:
        return ctypes.CDLL(None).malloc_trim
    except (AttributeError, OSError, TypeError):
        return lambda _: 0


def frame_blocks(*arrays: np.ndarray) -> Iterator[slice]:
    """Yield the frames of arrays (F, ...) in slices that fit into memory; a single slice if the arrays are small."""
    count = len(arrays[0])
    frame = sum(prod(array.shape[1:]) * array.itemsize for array in arrays)
    step = max(_BLOCK // max(frame, 1), 1)
    blocks = [slice(start, min(start + step, count)) for start in range(0, max(count, 1), step)]
    return iter(blocks) if len(blocks) == 1 else in_steps(blocks)


def by_frames(function: Callable[..., np.ndarray], *arrays: np.ndarray) -> np.ndarray:
    """Return `function(*arrays)` of arrays (F, ...), computed in blocks of independent frames."""
    result = None
    for part in frame_blocks(*arrays):
        done = function(*(array[part] for array in arrays))
        if part == slice(0, len(arrays[0])):
            return done
        if result is None:
            result = empty((len(arrays[0]), *done.shape[1:]), done.dtype)
        result[part] = done
    assert result is not None
    return result


def column_blocks(array: np.ndarray, most: int | None = None) -> Iterator[tuple[slice, np.ndarray]]:
    """Yield blocks of the n paths of (F, n, C), over all frames: their slice, and a copy (F, k, C) in memory.

    A copy of more than one path has at most `most` bytes; by default as many as a block of frames.
    """
    frames, columns, components = array.shape
    step = max((most or _BLOCK) // max(frames * components * array.itemsize, 1), 1)
    for start in range(0, columns, step):
        chosen = slice(start, min(start + step, columns))
        copied = np.empty((frames, chosen.stop - start, components), array.dtype)
        for part in frame_blocks(array):
            copied[part] = array[part, chosen]
        yield chosen, copied
