"""Checks of what files state: names that lead out of their folder, and numbers that no lens, room or clock exceeds."""

import re
import unicodedata
from pathlib import Path

import numpy as np

from dmae.files.mapped import frame_blocks

IMAGES = (".png", ".jpg", ".jpeg", ".bmp", ".webp", ".tif", ".tiff")
VIDEOS = (".mp4", ".mov", ".m4v", ".avi", ".mkv", ".webm", ".mpg", ".mpeg", ".mts", ".wmv", ".h264", ".264", ".h265",
          ".265", ".hevc")  # fmt: skip
"""Suffixes of image and of video files."""

_SIGNS = frozenset('/\\<>:"|?*')
_RESERVED = re.compile(r"(con|prn|aux|nul|com[0-9¹²³]|lpt[0-9¹²³])(\..*)?", re.IGNORECASE)
"""Names of devices on Windows."""
_LONGEST = 230  # Bytes; file systems accept 255, and temporary names need some of them


def child(folder: Path, name: str, what: str) -> Path:
    """Return the path of a file or folder with this name, of a `what` such as "camera", directly in a folder.

    Raises ValueError, with the reason, if the name leads elsewhere, or not every file system accepts it.
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


MOST_PIXELS, MOST_METRES, MOST_SCORE, MOST_VARIANCE = 1e7, 1e7, 1e6, 1e30
"""Largest coordinate, px and m, largest confidence, and largest covariance, m^2."""
LEAST_FOCAL, MOST_FOCAL, MOST_DISTORTION, MOST_SIZE = 0.1, 1e6, 1e4, 100_000
"""Largest focal length and principal point, px, and largest coefficient of distortion."""
LEAST_RATE, MOST_RATE = 1e-4, 100_000.0
"""Smallest and largest number of frames per second."""


def check_numbers(what: str, values, most: float | np.ndarray, least: float | None = None) -> None:
    """Raise ValueError, which names `what`, unless all numbers except NaN are from `least` (or -`most`) to `most`."""
    array = np.asarray(values)
    lowest = -most if least is None else least
    for part in frame_blocks(array) if array.ndim > np.ndim(most) else [...]:
        here = array[part]
        with np.errstate(invalid="ignore"):
            wrong = (here > most) | (here < lowest)
        if wrong.any():
            most = np.broadcast_to(most, here.shape)[wrong].flat[0]
            raise ValueError(f"{what}: expected numbers from {lowest:g} to {most:g}, found {here[wrong].flat[0]:g}")


def numbers_of(found) -> np.ndarray:
    """Return what a file states as an array of numbers; if it states none, an array (0, 0), which no reader expects."""
    try:
        return np.array(found, np.float64)
    except (TypeError, ValueError, OverflowError):
        return np.empty((0, 0))


def check_rate(what: str, fps) -> float:
    """Return frames per second as a float; raise ValueError, which names `what`, if the number is impossible."""
    if isinstance(fps, bool) or not isinstance(fps, int | float | np.number) or not LEAST_RATE <= fps <= MOST_RATE:
        raise ValueError(f"{what}: expected frames per second from {LEAST_RATE:g} to {MOST_RATE:g}, found {fps!r:.40}")
    return float(fps)
