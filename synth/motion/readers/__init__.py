"""Readers of motion files: a function under the decorator `reader` in a module of this package is one.

It takes a path and `ReadOptions`, and returns a `synth.motion.motion.Motion` on a level floor at z = 0. It raises
FileNotFoundError, or ValueError for a malformed file. Its name is the extension of its files without the dot. The
choices of `motion=`, its help, and the tests over all readers follow. A reader of your own,
`motion.kind=package.module:function`, is a function under the same decorator.
"""

from dataclasses import dataclass, field
from pathlib import Path

from dmae.files.compressed import without_compression
from dmae.registry import Entry, Registry


@dataclass(frozen=True)
class ReadOptions:
    """What a file does not state, or states wrongly.

    Attributes:
        fps: Frame rate, in place of the stated one and of what is known about takes of the CMU database.
        unit: Metres per unit of length, in place of what the length of the legs shows.
        up: Axis of the file's world that points up, `x`, `y` or `z`, in place of that of the format.
        mapping: Names of joints or markers in the file, each to the name of a known skeleton or marker set.
    """

    fps: float | None = None
    unit: float | None = None
    up: str | None = None
    mapping: dict[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class MotionReader(Entry):
    """A format of motion files.

    Attributes:
        markers: Whether files hold markers, to which a skeleton is yet to be fitted, rather than joints.
        text: Whether files hold text, and may be compressed: `.bvh.xz`, `.bvh.gz`.
    """

    markers: bool = False
    text: bool = False


reader = Registry("reader", MotionReader, __package__, kind="motion", option="motion.kind", plain=False)


def reader_of(path: Path) -> MotionReader:
    """Return the reader of a file, by its extension.

    Raises:
        ValueError: no reader has this extension.
    """
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
    """Return the name of the reader of a file, by its extension; None if none has it."""
    plain = Path(without_compression(path.name))
    name = plain.suffix.lower().removeprefix(".")
    return name if name in reader and (reader[name].text or plain.name == path.name) else None


def take_name(path: Path) -> str:
    """Return the name of a take: that of its file without the extensions of format and compression."""
    return Path(without_compression(path.name)).stem
