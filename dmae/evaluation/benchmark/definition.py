"""Definitions of benchmarks: which clips there are, made with which options and seeds."""

import re
import shlex
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path

from dmae.data.from_json import decode
from dmae.data.resources import resource_folder
from dmae.files.structured import read_yaml
from dmae.registry import unknown

_GROUPS = ("scene", "props", "motion", "interaction", "rig", "detector", "occlusion", "retries")
"""Options of `synth generate` that a definition can hold; the others say where and how many."""
_NAME = re.compile(r"[a-z][a-z0-9_]*")


_MOST_CLIPS = 1_000_000
"""Of a set."""


class BenchmarkSize(StrEnum):
    """How many clips of each set."""

    small = "small"
    full = "full"


@dataclass(frozen=True)
class ClipSet:
    """Clips of one level that are made with the same options.

    Attributes:
        folder: `<number>_<level>/<set>`.
        level: Index of the level.
        options: Of `synth generate`.
        seed: Of the data set.
        clips: How many.
    """

    folder: str
    level: int
    options: tuple[str, ...]
    seed: int
    clips: int

    @property
    def ids(self) -> list[str]:
        """The ids of the clips: their folders in the benchmark's."""
        return [f"{self.folder}/{number:06d}" for number in range(self.clips)]


@dataclass(frozen=True)
class Level:
    """A level of difficulty.

    Attributes:
        name: The main cause of its holes.
        about: One sentence.
        sets: Options of `synth generate` of each set, as on a command line, by its name.
        options: Those of all its sets. They come before those of the set, which override them.
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
        about: One sentence.
        seed: Of the whole benchmark.
        small, full: Number of clips of each set, by size. Small takes the first ones of full.
        levels: In the order of difficulty.
        options: Options of `synth generate` of all clips; those of a level, then those of a set come after them.
        file: Where it is written.
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
        """Return the sets of clips, with a seed of its own each."""
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
    """Return the options of a command line.

    Raises:
        ValueError: one of them is not an option of `synth generate` that says what the clips are.
    """
    found = shlex.split(options)
    for option in found:
        if "=" not in option or re.split(r"[.=]", option)[0] not in _GROUPS:
            raise ValueError(f"option {option!r}: expected key=value of one of {', '.join(_GROUPS)}")
    return found


def find_definition(name: str) -> Definition:
    """Return the benchmark of a name, or of a YAML file of your own.

    Raises:
        ValueError: there is none; or it is malformed, and the message names file and field.
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
