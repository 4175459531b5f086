"""File names from the names of cameras, clips and presets in untrusted files: none leads out of its folder."""

import re
import unicodedata
from pathlib import Path

PICTURES = (".png", ".jpg", ".jpeg", ".bmp", ".webp", ".tif", ".tiff")
VIDEOS = (".mp4", ".mov", ".m4v", ".avi", ".mkv", ".webm", ".mpg", ".mpeg", ".mts", ".wmv")
"""Suffixes of picture and of video files."""

_SIGNS = frozenset('/\\<>:"|?*')
_RESERVED = re.compile(r"(con|prn|aux|nul|com[0-9¹²³]|lpt[0-9¹²³])(\..*)?", re.IGNORECASE)
"""Names of devices on Windows."""
_LONGEST = 230
"""Bytes; file systems accept 255, and temporary names need some of them."""


def child(folder: Path, name: str, what: str) -> Path:
    """Return the path of a file or folder with this name directly in a folder.

    Args:
        folder: The folder that will contain it.
        name: The name, as it was read.
        what: The kind of thing named, for messages, such as "camera".

    Raises:
        ValueError: the name leads elsewhere, or not every file system accepts it; the message gives the reason.
    """
    reason = _wrong(name)
    if reason:
        raise ValueError(f"{what} {name!r:.80}: cannot be the name of a file in {folder}, {reason}; rename it")
    return Path(folder) / name


def _wrong(name: str) -> str | None:
    if not isinstance(name, str):
        return f"it is no text but a {type(name).__name__}"
    if not name.strip(". "):
        return "it is empty or consists of dots"
    if signs := sorted(_SIGNS.intersection(name)):
        return f"it contains {' '.join(signs)}"
    if any(unicodedata.category(sign).startswith("C") for sign in name):
        return "it contains characters that cannot be shown"
    if name != name.strip() or name.endswith("."):
        return "it begins or ends with a space, or ends with a dot"
    if _RESERVED.fullmatch(name):
        return "Windows keeps that name for a device"
    if len(name.encode()) > _LONGEST:
        return f"it is longer than {_LONGEST} bytes"
    return None
