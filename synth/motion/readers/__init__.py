"""Readers of motion files. Each function with the decorator `reader` in a module of this package is a reader.

A reader takes a path and `ReadOptions`, and returns a `synth.motion.motion.Motion` on a level floor at z = 0. It raises
FileNotFoundError, or ValueError for a malformed file. The name of a reader is the file extension without the dot. The
choices of `motion=`, their help, and the tests of all readers come from this registry. Your own reader,
`motion.kind=package.module:function`, is a function with the same decorator.
"""

from dataclasses import dataclass, field
from pathlib import Path

from dmae.files.contents import without_compression
from dmae.registry import Entry, Registry


@dataclass(frozen=True)
class ReadOptions:
    """The user's corrections of missing or wrong statements of a file."""

    # Frame rate; replaces the stated rate and the known corrections for takes of the CMU database
    fps: float | None = None
    unit: float | None = None  # Metres per unit of length; replaces the unit that follows from the leg length
    # Axis of the file's world that points up, `x`, `y` or `z`; replaces the up axis of the format
    up: str | None = None
    # From names of joints or markers in the file to names of a known skeleton or marker set
    mapping: dict[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class MotionReader(Entry):
    """A format of motion files."""

    markers: bool = False  # Whether files contain markers, to which a skeleton must be fitted, rather than joints
    text: bool = False  # Whether files contain text and may be compressed: `.bvh.xz`, `.bvh.gz`


reader = Registry(
    "reader", MotionReader, __package__, kind="motion", option="motion.kind", plain=False, returns=("Motion",)
)


def reader_of(path: Path) -> MotionReader:
    """Return the reader of a file, by its extension. Raises ValueError if no reader has this extension."""
    name = format_of(path)
    if name is None:
        known = ", ".join(f".{each}" for each in reader)
        packed = ", ".join(f".{each}" for each in reader if reader[each].text)
        found = path.name.removeprefix(take_name(path)) or path.suffix
        raise ValueError(
            f"{path}: expected a motion file of one of the formats {known}, found {found!r}; of these "
            f"{packed} may be compressed, with .xz or .gz at the end"
        )
    return reader[name]


def format_of(path: Path) -> str | None:
    """Return the name of the reader of a file, by its extension; None if no reader has it."""
    plain = Path(without_compression(path.name))
    name = plain.suffix.lower().removeprefix(".")
    return name if name in reader and (reader[name].text or plain.name == path.name) else None


def take_name(path: Path) -> str:
    """Return the name of a take: its file name without the extensions of the format and the compression."""
    return Path(without_compression(path.name)).stem
