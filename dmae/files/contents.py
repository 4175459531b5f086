"""Read and write whole files: only regular files, no more bytes than expected, and written completely or not at all."""

import lzma
import os
import shutil
import stat
import tempfile
import zlib
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from functools import lru_cache, wraps
from pathlib import Path
from typing import Any

MOST_BYTES = 4 << 30
"""Largest size of a file that is read whole, bytes."""
COMPRESSED = (".xz", ".gz")
"""Last extensions of files that `read_unpacked` unpacks."""
_UNPACKING_MEMORY = 256 << 20  # Bytes; files of `xz -9` need 65 MiB


def check_file(path: Path, most: int = MOST_BYTES) -> int:
    """Return the size of a file, bytes, without opening it, because a named pipe or a device would block.

    Raises FileNotFoundError, or ValueError if it is not a regular file, or larger than `most` bytes.
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


def _size(count: int) -> str:
    return f"{count / 1e6:.3g} MB" if count >= 100_000 else f"{count} bytes"


def cached_until_changed(most: int, path_of: Callable = Path) -> Callable:
    """Cache `most` results of a function until the file or folder of its first argument, by `path_of`, changes."""

    def decorate(function: Callable) -> Callable:
        cached = lru_cache(most)(lambda _, *given, **options: function(*given, **options))

        @wraps(function)
        def found(first, *given, **options):
            try:
                state = path_of(first).stat()
            except OSError:
                return function(first, *given, **options)
            return cached((state.st_mtime_ns, state.st_size, state.st_ino), first, *given, **options)

        found.__dict__["cache_clear"] = cached.cache_clear
        return found

    return decorate


def read_bytes(path: Path, most: int = MOST_BYTES) -> bytes:
    """Return the contents of a file; errors as in `check_file`."""
    size = check_file(path, most)
    # A file could be replaced by a pipe after the check. Opening it must not block either.
    flags = os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)
    with os.fdopen(os.open(path, flags), "rb") as file:
        data = file.read(size + 1)
    if len(data) > size:
        raise ValueError(f"{path}: the file grows while it is read")
    return data


def read_text(path: Path, most: int = 1 << 30) -> str:
    r"""Return a file's text in UTF-8, with line ends as `\n`; errors as in `check_file`, or ValueError if no text."""
    try:
        # Windows programs begin files with a byte order mark.
        text = read_bytes(path, most).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise ValueError(f"{path}: expected text in UTF-8, {error}") from None
    return text.replace("\r\n", "\n").replace("\r", "\n")


def without_compression(name: str) -> str:
    """Return the name of a file without the extension of its compression, if any."""
    return name[:-3] if name.lower().endswith(COMPRESSED) else name


def read_unpacked(path: Path, most: int) -> bytes:
    """Return the contents of a file, unpacked if named `.xz` or `.gz`, of up to `most` bytes, packed and unpacked.

    Errors are those of `check_file`, or ValueError if it is damaged or not compressed as its name says.
    """
    data = read_bytes(path, most)
    if without_compression(path.name) == path.name:
        return data
    xz = path.suffix.lower() == ".xz"
    parts, size = [], 0
    try:
        # Files may contain several streams in sequence; xz pads them with zeros.
        while data := data.lstrip(b"\0") if xz and parts else data:
            engine: Any = (
                lzma.LZMADecompressor(lzma.FORMAT_XZ, _UNPACKING_MEMORY)
                if xz
                else zlib.decompressobj(zlib.MAX_WBITS | 16)
            )
            while not engine.eof:
                part = engine.decompress(data, 1 << 20)
                data = b"" if xz else engine.unconsumed_tail
                parts.append(part)
                size += len(part)
                if size > most:
                    raise ValueError(f"{path}: expected at most {most} bytes, found more when unpacked")
                if not part and not engine.eof and (engine.needs_input if xz else not data):
                    raise EOFError("the file ends too early")
            data = engine.unused_data
    except (lzma.LZMAError, zlib.error, EOFError) as error:
        raise ValueError(f"{path}: expected a file compressed by {path.suffix[1:]}, {error}") from None
    return b"".join(parts)


def written(lines: Iterable[str]) -> Iterator[bytes]:
    """Yield lines of text as bytes of a file."""
    return (f"{line}\n".encode() for line in lines)


def write_atomic(path: Path, data: bytes | str | Iterable[bytes]) -> None:
    """Write a file and its folder completely or not at all: write to a temporary name, fsync, rename."""
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    data = data.encode() if isinstance(data, str) else data
    handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    try:
        with os.fdopen(handle, "wb") as file:
            file.writelines([data] if isinstance(data, bytes) else data)
            file.flush()
            os.fsync(file.fileno())
        Path(temporary).chmod(0o644)
        Path(temporary).replace(path)
    except BaseException as error:
        Path(temporary).unlink(missing_ok=True)
        if isinstance(error, OSError) and error.errno is not None and error.filename is None:
            # The error of a full disk names no file. An error without `errno` has its message only in its arguments.
            raise OSError(error.errno, error.strerror, str(path)) from None
        raise


def check_vacant(out: Path, contents: str) -> None:
    """Raise ValueError unless a folder is empty or does not exist; `contents` is to be in it ("the data set")."""
    out = Path(out)
    if out.is_file() or (out.is_dir() and any(out.iterdir())):
        there = "a file" if out.is_file() else f"a folder with {min(path.name for path in out.iterdir())}"
        raise ValueError(
            f"{out}: expected no such folder yet, or an empty one, for {contents}; found {there}; choose another out"
        )


@contextmanager
def whole_folder(out: Path) -> Iterator[Path]:
    """Yield a temporary folder, to become the vacant folder `out` if the block ends without an error, or be removed."""
    out = Path(out).resolve()
    partial = out.with_name(f".{out.name}.partial")
    shutil.rmtree(partial, ignore_errors=True)
    partial.mkdir(parents=True)
    try:
        yield partial
        if out.is_dir() and not any(out.iterdir()):
            # A current folder and a mounted disk cannot be replaced, so they are filled.
            for path in partial.iterdir():
                shutil.move(path, out / path.name)
        else:
            partial.rename(out)
    finally:
        shutil.rmtree(partial, ignore_errors=True)


@contextmanager
def written_whole(path: Path) -> Iterator[Path]:
    """Yield a temporary path next to `path`, to replace it when completely written, or to be removed on failure."""
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(f".{path.stem}.part{path.suffix}")
    try:
        yield part
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)
