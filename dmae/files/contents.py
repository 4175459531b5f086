"""Read the contents of files: only regular files, and no more bytes than expected."""

import lzma
import os
import stat
import zlib
from collections.abc import Iterable, Iterator
from pathlib import Path

MOST_BYTES = 4 << 30
"""Largest size of a file that is read whole, bytes."""


def check_file(path: Path, most: int = MOST_BYTES) -> int:
    """Return the size of a file, bytes, without opening it, because a named pipe or a device would block.

    Raises:
        FileNotFoundError: no such file.
        ValueError: it is not a regular file, or larger than `most` bytes.
    """
    path = Path(path)
    try:
        found = path.stat()
    except (FileNotFoundError, NotADirectoryError):
        raise FileNotFoundError(f"{path}: no such file") from None
    except (OSError, ValueError) as error:
        # The name contains a NUL or is too long, or links form a circle.
        raise ValueError(f"{str(path)!r:.200}: expected a file that can be read, {error}") from None
    if stat.S_ISDIR(found.st_mode):
        raise FileNotFoundError(f"{path}: expected a file, found a folder")
    if not stat.S_ISREG(found.st_mode):
        raise ValueError(f"{path}: expected a regular file, found a pipe, socket or device")
    if found.st_size > most:
        raise ValueError(f"{path}: expected at most {_size(most)}, found {_size(found.st_size)}")
    return found.st_size


def read_bytes(path: Path, most: int = MOST_BYTES) -> bytes:
    """Return the contents of a file; errors as in `check_file`."""
    size = check_file(path, most)
    # A file could be replaced by a pipe after the check. Opening it must not block either.
    with os.fdopen(
        os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)), "rb"
    ) as file:
        data = file.read(size + 1)
    if len(data) > size:
        raise ValueError(f"{path}: the file grows while it is read")
    return data


def read_text(path: Path, most: int = 1 << 30) -> str:
    """Return the text of a file in UTF-8, with line ends as `\\n`.

    Raises:
        FileNotFoundError, ValueError: as in `check_file`, or it is not text.
    """
    try:
        text = read_bytes(path, most).decode()
    except UnicodeDecodeError as error:
        raise ValueError(f"{path}: expected text in UTF-8, {error}") from None
    return text.replace("\r\n", "\n").replace("\r", "\n")


def written(lines: Iterable[str]) -> Iterator[bytes]:
    """Yield lines of text as bytes of a file."""
    return (f"{line}\n".encode() for line in lines)


def _size(count: int) -> str:
    return f"{count / 1e6:.3g} MB" if count >= 100_000 else f"{count} bytes"


# Read compressed files, up to a limit of size.

COMPRESSED = (".xz", ".gz")
"""Last extensions of files that `read_unpacked` unpacks."""
_MEMORY = 256 << 20
"""Bytes of memory that unpacking may take; files of `xz -9` need 65 MiB."""
_PART = 1 << 20
"""Bytes unpacked at a time."""


def without_compression(name: str) -> str:
    """Return the name of a file without the extension of its compression, if any."""
    return name[:-3] if name.lower().endswith(COMPRESSED) else name


def read_unpacked(path: Path, most: int) -> bytes:
    """Return the contents of a file, unpacked if its name ends with `.xz` or `.gz`.

    Args:
        path: The file.
        most: Largest size, packed and unpacked, bytes.

    Raises:
        FileNotFoundError, ValueError: as in `dmae.files.contents.read_bytes`, or the file is damaged, not
            compressed as its name says, or larger after unpacking.
    """
    data = read_bytes(path, most)
    if without_compression(path.name) == path.name:
        return data
    try:
        return _unpack(data, path, most)
    except (lzma.LZMAError, zlib.error, EOFError) as error:
        raise ValueError(f"{path}: expected a file compressed by {path.suffix[1:]}, {error}") from None


def _unpack(data: bytes, path: Path, most: int) -> bytes:
    parts, size = [], 0
    xz = path.suffix.lower() == ".xz"
    # Files may contain several streams in sequence; xz pads them with zeros.
    while data := data.lstrip(b"\0") if xz and parts else data:
        engine = lzma.LZMADecompressor(lzma.FORMAT_XZ, _MEMORY) if xz else zlib.decompressobj(zlib.MAX_WBITS | 16)
        while not engine.eof:
            part = engine.decompress(data, _PART)
            data = b"" if xz else engine.unconsumed_tail
            parts.append(part)
            size += len(part)
            if size > most:
                raise ValueError(f"{path}: expected at most {most} bytes, found more when unpacked")
            if not part and not engine.eof and (engine.needs_input if xz else not data):
                raise EOFError("the file ends too early")
        data = engine.unused_data
    return b"".join(parts)
