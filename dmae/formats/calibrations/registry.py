"""The registry of calibration formats. A format is a function with the decorator `calibration_format`.

The function takes a path, and an image size for cameras without one. It returns a `CameraRig` in the convention of the
file. The first line of its docstring describes the file and names the programs that write it; error messages show this
line. Listing the formats imports their modules, because the settings of a format contain functions.
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
        matches: Function that takes the content of a JSON or TOML file and returns whether it has this format.
        write: Function that takes cameras in the convention of the file, and a path to write.
        convention: Convention of the format for lengths, world axes and extrinsics.
        files: Patterns of its files, relative to the folder of a recording.
        files_above: Patterns of its files, relative to each of the two folders above the recording.
    """

    syntax: str
    matches: Callable[[object], bool] = lambda content: True
    write: Callable[[CameraRig, Path], None]
    convention: Convention = OURS
    files: tuple[str, ...]
    files_above: tuple[str, ...] = ()


calibration_format = Registry("calibration_format", CalibrationFormat, __package__)
