"""Arrays and texts in HDF5 files, including netCDF 4. Sizes and filters are checked before memory is allocated.

h5py reads the files. Before it opens one, damaged heaps of texts are looked for, on which its library hangs.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import wraps
from mmap import ACCESS_READ, mmap
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import numpy as np

from dmae.files.contents import check_file

P = ParamSpec("P")
T = TypeVar("T")

_LEAST_LIMIT, _EXPANSION = 1 << 28, 100
"""Bytes that an array may have: the larger of the first number, and the second number times the size of the file."""
_FILTERS = {1, 2, 3, 4, 32000}  # Deflate, shuffle, Fletcher, szip and LZF. For other filters HDF5 would load plugins.
_MOST_TEXTS, _LONGEST_TEXT = 5000, 20_000
_SIGNATURE = b"\x89HDF\r\n\x1a\n"
_HEAP, _HEAD = b"GCOL\x01\0\0\0", 16
_SHORTEST = 48  # Smallest size of the block at the start of a file, bytes


def _refused(read: Callable[P, T]) -> Callable[P, T]:
    """Return a method of `Hdf5` that raises ValueError, with the path, for anything that is wrong with the file."""

    @wraps(read)
    def method(*args: P.args, **kwargs: P.kwargs) -> T:
        try:
            return read(*args, **kwargs)
        # h5py raises errors of many types for damaged files. The methods only read them.
        except Exception as error:
            file: Any = args[0]
            raise ValueError(f"{file.path}: expected {file.what}; {error}") from None

    return method


class Hdf5:
    """An open HDF5 file. Links to other files are not followed. Methods raise ValueError if it is damaged."""

    def __init__(self, path: Path, what: str, file):
        self.path, self.what, self._file = path, what, file
        self._most = max(_LEAST_LIMIT, _EXPANSION * path.stat().st_size)

    @_refused
    def __contains__(self, name: str) -> bool:
        return self._found(name) is not None

    @_refused
    def array(self, name: str) -> np.ndarray:
        """Return an array of numbers, or a table with fields of numbers."""
        found = self._dataset(name)
        if found.dtype.hasobject or (found.dtype.names is None and found.dtype.kind not in "fiub"):
            raise ValueError(f"expected numbers as {name}, found {found.dtype}")
        return np.asarray(found[()])

    @_refused
    def texts(self, name: str) -> list[str]:
        """Return a list of texts."""
        found = self._dataset(name)
        if found.ndim != 1 or found.dtype.kind not in "SO" or len(found) > _MOST_TEXTS:
            raise ValueError(f"expected up to {_MOST_TEXTS} texts as {name}, found {found.dtype} {found.shape}")
        # One at a time, because many could refer to one long text.
        return [_text(found[number]) for number in range(len(found))]

    @_refused
    def attribute(self, name: str, of: str = "/") -> object:
        """Return an attribute of a group or an array: a text or a number, or None if it does not exist."""
        found = self._found(of) if of != "/" else self._file
        value = None if found is None or name not in found.attrs else found.attrs[name]
        if isinstance(value, np.ndarray) and value.size == 1:
            value = value.reshape(-1)[0]
        return _text(value, longest=None) if isinstance(value, bytes | str) else value

    @_refused
    def axes(self, name: str) -> list[str]:
        """Return the names of the axes of an array, as netCDF stores them."""
        return [each[0].name.rpartition("/")[2] if len(each) else "" for each in self._dataset(name).dims]

    def _found(self, name: str):
        import h5py

        group = self._file
        for part in name.split("/"):
            if not isinstance(group, h5py.Group) or not isinstance(group.get(part, getlink=True), h5py.HardLink):
                return None
            group = group[part]
        return group

    def _dataset(self, name: str):
        import h5py

        found = self._found(name)
        if not isinstance(found, h5py.Dataset) or found.shape is None:
            raise ValueError(f"it lacks {name}")
        if found.external or found.is_virtual:
            raise ValueError(f"{name} is kept in another file, which is not read")
        plan = found.id.get_create_plist()
        if not {plan.get_filter(number)[0] for number in range(plan.get_nfilters())} <= _FILTERS:
            raise ValueError(f"{name} is compressed by a plugin, which is not loaded; save it with gzip")
        if found.nbytes > self._most:
            raise ValueError(f"{name} of shape {found.shape} would take {found.nbytes:.3g} bytes")
        return found


@contextmanager
def open_hdf5(path: Path, what: str) -> Iterator[Hdf5]:
    """Open an HDF5 file. Messages name the kind, `what`, of file expected.

    Raises FileNotFoundError, or ValueError if it is not an HDF5 file, or h5py is not installed.
    """
    path = Path(path)
    check_file(path)
    with path.open("rb") as file:
        start = file.read(len(_SIGNATURE))
    if start != _SIGNATURE:
        older = "; it is netCDF 3, save it as netCDF 4" if start.startswith(b"CDF") else ""
        raise ValueError(f"{path}: expected {what}, found no HDF5 file{older}")
    try:
        import h5py
    except ImportError:
        raise ValueError(f"{path}: h5py reads {what}; pip install dmae-synth[animals]") from None
    try:
        _check_heaps(path)
        file = h5py.File(path, "r", locking=False)
    except Exception as error:
        raise ValueError(f"{path}: expected {what}; {error}") from None
    with file:
        yield Hdf5(path, what, file)


def _check_heaps(path: Path) -> None:
    """Refuse damaged heaps of texts, on which the HDF5 library hangs: an object of size 0 follows itself.

    A heap is `GCOL`, version 1, its size, and objects with index, count and size. Index 0 is free space, whose size
    includes its header (HDF5 File Format Specification, III.E).
    """
    with path.open("rb") as file, mmap(file.fileno(), 0, access=ACCESS_READ) as data:
        if len(data) < _SHORTEST:
            raise ValueError(f"it ends after {len(data)} bytes")
        # Sizes of offsets and lengths, bytes; they are at another place in newer files.
        if set(data[13:15] if data[8] < 2 else data[9:11]) != {8}:
            raise ValueError("its offsets and lengths are not of 8 bytes")
        start = data.find(_HEAP)
        while start >= 0:
            end, at = start + int.from_bytes(data[start + 8 : start + 16], "little"), start + _HEAD
            while end <= len(data) and at + _HEAD <= end:
                size = int.from_bytes(data[at + 8 : at + 16], "little")
                whole = size if data[at : at + 2] == b"\0\0" else _HEAD + -(-size // 8) * 8
                if not _HEAD <= whole <= end - at:
                    raise ValueError(f"its texts are damaged, at byte {at}")
                at += whole
            start = data.find(_HEAP, start + 1)


def _text(value: object, longest: int | None = _LONGEST_TEXT) -> str:
    text = value.decode() if isinstance(value, bytes) else value
    if not isinstance(text, str) or (longest and len(text) > longest):
        raise ValueError(f"expected a text, found {value!r:.60}")
    return text
