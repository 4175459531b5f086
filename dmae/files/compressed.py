"""Read compressed files, up to a limit of size."""

import lzma
import zlib
from pathlib import Path

from dmae.files.contents import read_bytes

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
