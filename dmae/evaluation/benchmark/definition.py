"""Definitions of benchmarks: their clips, and the options and seeds that generate them."""

import re
import shlex
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path

from dmae.data.json_values import decode
from dmae.data.resources import resource_folder
from dmae.files.structured import read_yaml
from dmae.registry import unknown

_GROUPS = ("scene", "props", "motion", "interaction", "rig", "detector", "occlusion", "retries")
"""Options of `synth generate` that a definition can contain. The others set the output and the number of clips."""
_NAME = re.compile(r"[a-z][a-z0-9_]*")


_MOST_CLIPS = 1_000_000
"""Of a set."""


class BenchmarkSize(StrEnum):
    """Number of clips of each set."""

    small = "small"
    full = "full"


@dataclass(frozen=True)
class ClipSet:
    """Clips of one level that are made with the same options.

    Attributes:
        folder: `<number>_<level>/<set>`.
        level: Index of the level.
        options: Options of `synth generate`.
        seed: Seed of the data set.
        clips: Number of clips.
    """

    folder: str
    level: int
    options: tuple[str, ...]
    seed: int
    clips: int

    @property
    def ids(self) -> list[str]:
        """The ids of the clips: their paths in the benchmark's folder of clips."""
        return [f"{self.folder}/{number:06d}" for number in range(self.clips)]


@dataclass(frozen=True)
class Level:
    """A level of difficulty.

    Attributes:
        name: The main cause of its holes.
        about: One sentence about the level.
        sets: Options of `synth generate` for each set, as on a command line, by the name of the set.
        options: Options for all its sets. The options of a set override them.
    """

    name: str
    about: str
    sets: dict[str, str]
    options: str = ""

    def __post_init__(self):
        for name in (self.name, *self.sets):
            if not _NAME.fullmatch(name):
                raise ValueError(f"level {self.name!r}: expected names of small letters, digits and _, found {name!r}")
        if not self.sets:
            raise ValueError(f"level {self.name!r} has no sets")
        for options in (self.options, *self.sets.values()):
            split_options(options)


@dataclass(frozen=True)
class Definition:
    """A benchmark.

    Attributes:
        about: One sentence about the benchmark.
        seed: Seed of the whole benchmark.
        small, full: Number of clips of each set, by size. The small size uses the first clips of the full size.
        levels: Levels in the order of difficulty.
        options: Options of `synth generate` for all clips. The options of a level override them, and those of a set
            override both.
        file: File of the definition.
    """

    about: str
    seed: int
    small: int
    full: int
    levels: list[Level]
    options: str = ""
    file: str = ""

    def __post_init__(self):
        if self.seed < 0 or not 1 <= self.small <= self.full <= _MOST_CLIPS:
            raise ValueError(
                f"expected seed >= 0, 1 <= small <= full <= {_MOST_CLIPS} clips a set, found seed {self.seed}, small "
                f"{self.small}, full {self.full}"
            )
        names = [level.name for level in self.levels]
        if not names or len(set(names)) < len(names):
            raise ValueError(f"expected levels, each with a name of its own, found {names}")
        split_options(self.options)

    @property
    def name(self) -> str:
        return Path(self.file).stem

    @property
    def checksums(self) -> Path:
        """The file of the published checksums, in the folder of the definition."""
        return Path(self.file).with_suffix(".checksums.json")

    def sets(self, size: BenchmarkSize) -> list[ClipSet]:
        """Return the sets of clips. Each has its own seed."""
        found = []
        for number, level in enumerate(self.levels):
            for name, options in level.sets.items():
                chosen = tuple(
                    option for part in (self.options, level.options, options) for option in split_options(part)
                )
                seed = self.seed * 1000 + len(found)
                clips = self.small if size == BenchmarkSize.small else self.full
                found.append(ClipSet(f"{number + 1}_{level.name}/{name}", number, chosen, seed, clips))
        return found


def split_options(options: str) -> list[str]:
    """Return the options of a command line as a list.

    Raises:
        ValueError: one of them is not an option of `synth generate` that a definition can contain.
    """
    found = shlex.split(options)
    for option in found:
        if "=" not in option or re.split(r"[.=]", option)[0] not in _GROUPS:
            raise ValueError(f"option {option!r}: expected key=value of one of {', '.join(_GROUPS)}")
    return found


def find_definition(name: str) -> Definition:
    """Return the benchmark of this name, or the benchmark that a YAML file defines.

    Raises:
        ValueError: the benchmark does not exist, or its file is malformed; the message names the file and the field.
    """
    file = Path(name)
    if file.suffix != ".yaml":
        shipped = {path.stem: path for path in (resource_folder("dmae", "configs") / "benchmark").glob("*.yaml")}
        if name not in shipped:
            raise ValueError(f"name={name}: {unknown('benchmark', name, sorted(shipped))}, or a .yaml file of your own")
        file = shipped[name]
    if not file.is_file():
        raise FileNotFoundError(f"name={name}: no such file")
    try:
        return replace(decode(Definition, read_yaml(file), file.name), file=str(file))
    except (TypeError, ValueError) as error:
        raise ValueError(f"{file}: expected a benchmark, as configs/benchmark/occlusion-v2.yaml: {error}") from None
