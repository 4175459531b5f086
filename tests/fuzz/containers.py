"""Changes inside files that pack others: behind the checksums and lengths that stop most changes of their bytes."""

import io
import lzma
import struct
import zipfile
import zlib
from collections.abc import Callable

_PNG = b"\x89PNG\r\n\x1a\n"
_CHECKPOINT = b"dmae checkpoint "
Pieces = list[bytes]
Pack = Callable[[Pieces], bytes]


def unpacked(data: bytes) -> tuple[Pieces, Pack] | None:
    """Return what a file packs, and the function that packs it again; None for a file that packs nothing known."""
    try:
        if data.startswith(_CHECKPOINT):
            head, _, content = data.partition(b"\n")
            pieces, pack = _zip(content)
            return pieces, lambda changed: head + b"\n" + pack(changed)
        for starts, unpack in _UNPACK.items():
            if data.startswith(starts):
                return unpack(data)
        return _safetensors(data) if data[8:9] == b"{" else None
    except (ValueError, EOFError, struct.error, zlib.error, lzma.LZMAError, zipfile.BadZipFile):
        return None


def _zip(data: bytes) -> tuple[Pieces, Pack]:
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        names = archive.namelist()
        pieces = [archive.read(name) for name in names]

    def pack(changed: Pieces) -> bytes:
        buffer = io.BytesIO()
        with zipfile.ZipFile(buffer, "w") as archive:
            for name, piece in zip(names, changed, strict=True):
                archive.writestr(name, piece)
        return buffer.getvalue()

    return pieces, pack


def _xz(data: bytes) -> tuple[Pieces, Pack]:
    return [lzma.decompress(data)], lambda changed: lzma.compress(changed[0], preset=0)


def _png(data: bytes) -> tuple[Pieces, Pack]:
    """The chunks of a PNG; its pixels are the last piece, inflated."""
    kinds, pieces, pixels, place = [], [], b"", 8
    while place < len(data):
        (length,), kind = struct.unpack(">I", data[place : place + 4]), data[place + 4 : place + 8]
        if kind == b"IDAT":
            pixels += data[place + 8 : place + 8 + length]
        elif kind != b"IEND":
            kinds.append(kind)
            pieces.append(data[place + 8 : place + 8 + length])
        place += length + 12

    def pack(changed: Pieces) -> bytes:
        *chunks, rows = changed
        listed = [*zip(kinds, chunks, strict=True), (b"IDAT", zlib.compress(rows)), (b"IEND", b"")]
        return _PNG + b"".join(
            struct.pack(">I", len(chunk)) + kind + chunk + struct.pack(">I", zlib.crc32(kind + chunk))
            for kind, chunk in listed
        )

    return [*pieces, zlib.decompress(pixels)], pack


def _glb(data: bytes) -> tuple[Pieces, Pack]:
    """The chunks of a binary glTF: JSON, and numbers."""
    kinds, pieces, place = [], [], 12
    while place < len(data):
        length, kind = struct.unpack("<I4s", data[place : place + 8])
        kinds.append(kind)
        pieces.append(data[place + 8 : place + 8 + length])
        place += 8 + length

    def pack(changed: Pieces) -> bytes:
        body = b""
        for kind, piece in zip(kinds, changed, strict=True):
            piece += (b" " if kind == b"JSON" else b"\0") * (-len(piece) % 4)
            body += struct.pack("<I4s", len(piece), kind) + piece
        return data[:8] + struct.pack("<I", 12 + len(body)) + body

    return pieces, pack


def _safetensors(data: bytes) -> tuple[Pieces, Pack]:
    (length,) = struct.unpack("<Q", data[:8])
    pieces = [data[8 : 8 + length], data[8 + length :]]
    return pieces, lambda changed: struct.pack("<Q", len(changed[0])) + b"".join(changed)


_UNPACK: dict[bytes, Callable[[bytes], tuple[Pieces, Pack]]] = {
    b"PK\x03\x04": _zip,
    b"\xfd7zXZ\0": _xz,
    _PNG: _png,
    b"glTF": _glb,
}
