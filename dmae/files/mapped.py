"""Arrays that are too large for memory: they are in files, and are read and written by frames."""

import ctypes
import mmap
import os
import tempfile
from collections.abc import Callable, Iterator
from functools import cache
from math import prod

import numpy as np

LARGE = 16 << 20
"""Bytes; smaller arrays are in memory."""
_BLOCK = 8 << 20
"""Bytes of arrays in one step of a computation."""


def empty(shape: tuple[int, ...], dtype: type | np.dtype) -> np.ndarray:
    """Return an array to be filled: in memory or, if it is large, in a temporary file that is removed with the array.

    The file is in the folder named by `TMPDIR`.

    Raises:
        OSError: the disk is full.
    """
    size = prod(shape) * np.dtype(dtype).itemsize
    if size < LARGE:
        return np.empty(shape, dtype)
    with tempfile.TemporaryFile(prefix="dmae-") as file:
        try:
            # The space is allocated now. Otherwise a full disk would kill the process when the array is written to.
            getattr(os, "posix_fallocate", _set_size)(file.fileno(), 0, size)
        except OSError as error:
            raise OSError(
                error.errno, f"{error.strerror}; {size / 1e6:.0f} MB are needed", tempfile.gettempdir()
            ) from None
        return np.frombuffer(mmap.mmap(file.fileno(), size), dtype).reshape(shape)


def release(*arrays: np.ndarray) -> None:
    """Remove arrays that are in files from memory; their contents are read again when accessed."""
    for array in arrays:
        while isinstance(array, np.ndarray):
            array = array.base
        array = array.obj if isinstance(array, memoryview) else array
        if isinstance(array, mmap.mmap) and hasattr(array, "madvise"):
            array.madvise(mmap.MADV_DONTNEED)


def trim() -> None:
    """Return freed memory to the system if the C library can. Otherwise a process keeps that of its largest step."""
    _malloc_trim()(0)


@cache
def _malloc_trim() -> Callable[[int], int]:
    try:
        return ctypes.CDLL(None).malloc_trim
    except (AttributeError, OSError, TypeError):
        return lambda _: 0


def frame_blocks(*arrays: np.ndarray) -> Iterator[slice]:
    """Yield slices of the frames of arrays (F, ...) that fit into memory; a single slice if the arrays are small.

    After each block the arrays are released.
    """
    count = len(arrays[0])
    frame = sum(prod(array.shape[1:]) * array.itemsize for array in arrays)
    step = max(_BLOCK // max(frame, 1), 1)
    for start in range(0, max(count, 1), step):
        yield slice(start, min(start + step, count))
        if step < count:
            release(*arrays)


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
        release(result)
    return result


def total(function: Callable[..., np.ndarray], *arrays: np.ndarray) -> np.ndarray:
    """Return the sum over frames of `function(*arrays)`, (F, ...) of numbers with sums that are exact."""
    return sum(function(*(array[part] for array in arrays)).sum(0) for part in frame_blocks(*arrays))


def column_blocks(array: np.ndarray, most: int | None = None) -> Iterator[tuple[slice, np.ndarray]]:
    """Yield blocks of the n paths of (F, n, C), over all frames: their slice, and a copy (F, k, C) in memory.

    Args:
        most: Largest size of a copy of more than one path, bytes; by default that of a block.
    """
    frames, columns, components = array.shape
    step = max((most or _BLOCK) // max(frames * components * array.itemsize, 1), 1)
    for start in range(0, columns, step):
        chosen = slice(start, min(start + step, columns))
        copied = np.empty((frames, chosen.stop - start, components), array.dtype)
        for part in frame_blocks(array):
            copied[part] = array[part, chosen]
        yield chosen, copied


def _set_size(file: int, _: int, size: int) -> None:
    os.ftruncate(file, size)
