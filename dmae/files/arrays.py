"""Arrays in `.npy`, `.npz` and safetensors files: sizes are checked before memory is taken, and nothing is run."""

import hashlib
import io
import json
import zipfile
from collections.abc import Iterator, Sequence
from math import prod
from pathlib import Path
from tokenize import TokenError

import numpy as np
from safetensors import SafetensorError, safe_open
from safetensors.numpy import load

from dmae.files.contents import check_file, read_bytes
from dmae.files.mapped import LARGE, frame_blocks, map_file
from dmae.files.pickles import pickled_values

_LEAST_LIMIT, _EXPANSION = 1 << 28, 100
"""Bytes that an archive may unpack to: the first number, or the second number times its own size."""
_MOST_ARRAYS = 1000


def read_npy(path: Path):
    """Return the content of a `.npy` file: an array, or the pickled object. Nothing in the file is run.

    Raises FileNotFoundError, or ValueError if it is no such file, or refers to more than arrays and Python's
    containers.
    """
    try:
        value = _array(read_bytes(path), pickled=True)
    except ValueError as error:
        raise ValueError(f"{path}: expected an array or a dictionary of arrays; {error}") from None
    return value.tolist() if isinstance(value, np.ndarray) and value.dtype.hasobject else value


def read_arrays(path: Path, what: str, needed: Sequence[str], also: Sequence[str] = ()) -> dict[str, np.ndarray]:
    """Return arrays of an `.npz` archive, required and optional ones. Nothing in it is run, no other is read.

    Args:
        what: The kind of archive expected, for messages.

    Raises:
        FileNotFoundError: no such file.
        OSError: the file may not be read.
        ValueError: it is not an archive, is damaged, contains pickled objects, lacks arrays, or unpacks to more bytes
            than its size justifies.
    """
    # Read outside the block below, because errors of the system are not damage of the archive.
    data = read_bytes(path)
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            members = {member.filename.removesuffix(".npy"): member for member in archive.infolist()}
            wanted = {name: member for name, member in members.items() if name in (*needed, *also)}
            _check_sizes(len(data), list(members.values()), list(wanted.values()))
            arrays = {name: _array(_member(archive, member)) for name, member in wanted.items()}
    # Damaged archives make zipfile and NumPy raise errors of many undocumented types, from NotImplementedError to
    # SyntaxError. The block only reads them.
    except Exception as error:
        raise ValueError(f"{path}: expected {what}; {type(error).__name__}: {error}") from error
    lacking = sorted(set(needed) - set(members))
    if lacking:
        found = ", ".join(list(members)[:20])
        raise ValueError(f"{path}: expected arrays {' and '.join(needed)}, found {found}; it lacks {lacking}")
    return arrays


def _check_sizes(size: int, members: list[zipfile.ZipInfo], wanted: list[zipfile.ZipInfo]) -> None:
    if len(members) > _MOST_ARRAYS:
        raise ValueError(f"it holds {len(members)} arrays, expected at most {_MOST_ARRAYS}")
    unpacked, most = sum(member.file_size for member in wanted), max(_LEAST_LIMIT, _EXPANSION * size)
    if unpacked > most:
        raise ValueError(f"it unpacks to {unpacked / 1e6:.4g} MB, expected at most {most / 1e6:.4g} MB of its size")


def _member(archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> bytes:
    """Return a member's bytes, at most as many as it states, because members can unpack to more."""
    with archive.open(member) as file:
        data = file.read(member.file_size + 1)
    if len(data) != member.file_size:
        raise ValueError(f"{member.filename} states {member.file_size} bytes and unpacks to another size")
    return data


def _array(data: bytes, *, pickled: bool = False):
    """Return the array in the bytes of a `.npy` file or, with `pickled`, the object."""
    file = io.BytesIO(data)
    try:
        version = np.lib.format.read_magic(file)
        header = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        shape, fortran, dtype = header(file)
    except (ValueError, TypeError, SyntaxError, RecursionError, MemoryError, OverflowError, TokenError) as error:
        # NumPy evaluates the header as a literal, to any depth that the file states.
        raise ValueError(f"the header of an array is damaged, {error}") from None
    content = data[file.tell() :]
    if dtype.hasobject:
        if not pickled:
            raise ValueError("it holds pickled Python objects, which are not read as they could run anything")
        return pickled_values(content)
    if dtype.kind not in "biufcSU" or dtype.itemsize == 0 or len(shape) > 16 or min(shape, default=0) < 0:
        raise ValueError(f"it holds an array of {dtype} and shape {shape}, expected numbers or texts")
    if prod(shape) * dtype.itemsize != len(content) or (not content and max(shape) > _MOST_ARRAYS * 1000):
        raise ValueError(f"it states an array of {dtype} and shape {shape}, and holds {len(content)} bytes")
    return np.frombuffer(content, dtype).reshape(shape, order="F" if fortran else "C").copy(order="K")


_TYPES = {
    "F64": np.float64, "F32": np.float32, "F16": np.float16, "I64": np.int64, "I32": np.int32, "I16": np.int16,
    "I8": np.int8, "U64": np.uint64, "U32": np.uint32, "U16": np.uint16, "U8": np.uint8, "BOOL": np.bool_,
}  # fmt: skip
_NAMES = {np.dtype(kind): name for name, kind in _TYPES.items()}
_ORDER = ("U64", "I64", "F64", "F32", "U32", "I32", "F16", "U16", "I16", "I8", "U8", "BOOL")
_HEAD = 8  # Number of bytes that state the length of the header


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

    Errors are those of `dmae.files.contents.check_file`, or ValueError if it has another checksum, or is malformed.
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
    mapped = map_file(path)
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
