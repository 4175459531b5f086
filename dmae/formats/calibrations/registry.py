"""The registry of calibration formats: each is a function under the decorator `calibration_format`.

It takes a path and an image size for cameras without one, and returns a `CameraRig` as the file writes it. The first
line of its docstring says what the file looks like, and the programs that write it; errors list it. To list formats
imports them, as their settings hold functions.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from dmae.data.cameras import CameraRig
from dmae.formats.calibrations.conventions import OURS, Convention
from dmae.registry import Entry, Registry


@dataclass(frozen=True, kw_only=True)
class CalibrationFormat(Entry):
    """A calibration format.

    Attributes:
        syntax: "json", "toml" or "yaml".
        matches: Takes the content of a JSON or TOML file, and returns whether it is of this format.
        write: Takes cameras as the file is to write them, and a path.
        convention: How the format writes lengths, world and extrinsics.
        files: Patterns of its files in the folder of a recording.
        files_above: Patterns of its files in the two folders above.
    """

    syntax: str
    matches: Callable[[object], bool] = lambda content: True
    write: Callable[[CameraRig, Path], None]
    convention: Convention = OURS
    files: tuple[str, ...]
    files_above: tuple[str, ...] = ()


calibration_format = Registry("calibration_format", CalibrationFormat, __package__)
