"""Named arrays in one safetensors file, read and written without loading all of it into memory."""

import hashlib
import json
import mmap
from collections.abc import Iterator
from math import prod
from pathlib import Path

import numpy as np
from safetensors import SafetensorError, safe_open
from safetensors.numpy import load

from dmae.files.contents import check_file, read_bytes
from dmae.files.mapped import LARGE, frame_blocks

_TYPES = {
    "F64": np.float64, "F32": np.float32, "F16": np.float16, "I64": np.int64, "I32": np.int32, "I16": np.int16,
    "I8": np.int8, "U64": np.uint64, "U32": np.uint32, "U16": np.uint16, "U8": np.uint8, "BOOL": np.bool_,
}  # fmt: skip
_NAMES = {np.dtype(kind): name for name, kind in _TYPES.items()}
_ORDER = ("U64", "I64", "F64", "F32", "U32", "I32", "F16", "U16", "I16", "I8", "U8", "BOOL")
_HEAD = 8
"""Number of bytes that state the length of the header."""


def tensor_pieces(arrays: dict[str, np.ndarray]) -> Iterator[bytes]:
    """Yield the content of a safetensors file in pieces, the same bytes that the library writes."""
    ordered = sorted(arrays, key=lambda name: (_ORDER.index(_NAMES[arrays[name].dtype]), name))
    header, end = {}, 0
    for name in ordered:
        array, start = arrays[name], end
        end += prod(array.shape) * array.itemsize
        header[name] = {"dtype": _NAMES[array.dtype], "shape": list(array.shape), "data_offsets": [start, end]}
    text = json.dumps(header, separators=(",", ":"), ensure_ascii=False).encode()
    text += b" " * (-len(text) % _HEAD)
    yield len(text).to_bytes(_HEAD, "little") + text
    for name in ordered:
        array = arrays[name]
        if array.ndim == 0:
            yield array.tobytes()
            continue
        for part in frame_blocks(array):
            yield array[part].tobytes()


def digest_of(pieces: Iterator[bytes], digest) -> Iterator[bytes]:
    """Yield the pieces of a file, and update a digest of `hashlib` with them."""
    for piece in pieces:
        digest.update(piece)
        yield piece


def read_tensors(path: Path, sha256: str) -> dict[str, np.ndarray]:
    """Return the arrays of a file, read-only. Those of a large file are read when they are accessed.

    Raises:
        FileNotFoundError, ValueError: as `dmae.files.contents.check_file`, or the file has another checksum, or is
            malformed.
    """
    path = Path(path)
    large = check_file(path) >= LARGE
    data = b"" if large else read_bytes(path)
    if large:
        with path.open("rb") as file:
            found = hashlib.file_digest(file, "sha256").hexdigest()
    else:
        found = hashlib.sha256(data).hexdigest()
    if found != sha256:
        raise ValueError(f"{path}: does not match the checksum in clip.json; the clip is damaged, make it again")
    try:
        return _mapped(path) if large else load(data)
    except (SafetensorError, ValueError, KeyError) as error:
        raise ValueError(f"{path}: expected arrays in the format of safetensors: {error}") from None


def _mapped(path: Path) -> dict[str, np.ndarray]:
    """Return the arrays of a file, reading only its header."""
    with safe_open(path, framework="numpy") as file:
        # The library checks that types, shapes and places of all arrays are consistent and within the file.
        names = list(file.keys())
    with path.open("rb") as file:
        mapped = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
    begin = _HEAD + int.from_bytes(mapped[:_HEAD], "little")
    header, arrays = json.loads(mapped[_HEAD:begin]), {}
    for name in names:
        entry = header[name]
        if entry["dtype"] not in _TYPES:
            raise ValueError(f"{path}: expected {name} of numbers, found type {entry['dtype']}")
        shape = tuple(entry["shape"])
        values = np.frombuffer(mapped, _TYPES[entry["dtype"]], prod(shape), begin + entry["data_offsets"][0])
        arrays[name] = values.reshape(shape)
    return arrays
