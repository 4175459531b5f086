"""The plan of a stress matrix: axes, pairs of axes, and the cells that they need."""

import hashlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cache
from importlib.util import find_spec
from itertools import product
from pathlib import Path

import yaml

from dmae.completion.methods import find_method
from dmae.data.clip import Clip, Poses3D
from dmae.data.json_values import decode
from dmae.data.resources import resource_folder
from dmae.evaluation.config import PAPER, StressConfig, StressSize
from dmae.evaluation.corruption.corrupt import check
from dmae.evaluation.corruption.registry import corruptions, find_corruption
from dmae.reconstruction.config import CaptureConfig

_PAIRS = {
    StressSize.small: ("cameras+objects",),
    StressSize.full: ("cameras+objects", "calibration+cameras", "crowd+misses", "jitter+bursts"),
}
_SEEDS = {StressSize.small: 1, StressSize.full: 3}


@dataclass(frozen=True)
class Cell:
    """One corruption of a clip, to be captured once.

    Attributes:
        levels: Name and level of each corruption with a level above 0.
        seed: Seed of the random numbers.
    """

    levels: tuple[tuple[str, float], ...]
    seed: int


@dataclass(frozen=True)
class Axis:
    """One corruption, or two at the same time.

    Attributes:
        names: Names of the corruptions.
        levels: Tuples with a level above 0 for each corruption. The levels of a single corruption increase.
        asked: Whether the user named the axis. If clips do not allow it, that is then an error; otherwise the axis is
            left out.
        given: Whether the user gave the levels. A level that clips do not allow is then an error.
    """

    names: tuple[str, ...]
    levels: tuple[tuple[float, ...], ...]
    asked: bool = False
    given: bool = False

    @property
    def name(self) -> str:
        return "+".join(self.names)

    def cells(self, level: tuple[float, ...], seeds: Sequence[int]) -> list[Cell]:
        """Return the cells of a level, one for each seed. If all its values are 0, return the uncorrupted cell."""
        active = tuple((name, value) for name, value in zip(self.names, level, strict=True) if value)
        return [Cell(active, seed) for seed in seeds] if active else [Cell((), 0)]


@dataclass(frozen=True)
class Plan:
    """Axes, pairs and seeds of a matrix, and notes on what was left out."""

    axes: tuple[Axis, ...]
    pairs: tuple[Axis, ...]
    seeds: tuple[int, ...]
    notes: tuple[str, ...] = ()

    def cells(self) -> Iterator[Cell]:
        """Yield every cell once. The first one is the cell of the uncorrupted clip."""
        all_cells = [Cell((), 0)]
        for axis in (*self.axes, *self.pairs):
            all_cells += [cell for level in axis.levels for cell in axis.cells(level, self.seeds)]
        yield from dict.fromkeys(all_cells)


def plan(config: StressConfig) -> Plan:
    """Return the plan of a configuration for clips that allow all axes.

    Raises:
        ValueError: an axis or level does not exist, a pair is not two different axes, or levels are given for an axis
            that is not used.
    """
    names = config.axes or [entry.name for entry in corruptions()]
    axes = [_axis((name,), config, bool(config.axes)) for name in dict.fromkeys(names)]
    pairs = []
    for pair in _PAIRS[StressSize(config.size)] if config.pairs is None else config.pairs:
        first, plus, second = pair.partition("+")
        if not (plus and first and second) or first == second:
            raise ValueError(f"pairs={pair}: expected two different axes, as in pairs=[cameras+objects]")
        if config.pairs is not None or {first, second} <= set(names):
            pairs.append(_axis((first, second), config, config.pairs is not None))
    used = {name for axis in (*axes, *pairs) for name in axis.names}
    if unused := set(config.levels) - used:
        raise ValueError(f"levels of {', '.join(sorted(unused))}: no such axis is used; there are {', '.join(used)}")
    seeds = tuple(range(config.seed, config.seed + _SEEDS[StressSize(config.size)]))
    return Plan(tuple(axes), tuple(pairs), seeds)


def allowed(plan: Plan, clip: Clip) -> Plan:
    """Return the plan without the axes and levels that a clip does not allow. A note is added for each.

    Raises:
        ValueError: the user requested an axis or level that the clip does not allow.
    """
    notes = list(plan.notes)

    def keep(axis: Axis) -> Iterator[Axis]:
        fits, refused = [], None
        for level in axis.levels:
            try:
                for name, value in zip(axis.names, level, strict=True):
                    check(find_corruption(name), value, clip)
                fits.append(level)
            except ValueError as reason:
                if axis.given:
                    raise
                refused = refused or reason
                notes.append(f"Left out {reason}.")
        if fits:
            yield replace(axis, levels=tuple(fits))
        elif axis.asked:
            raise refused

    axes, pairs = (tuple(kept for axis in part for kept in keep(axis)) for part in (plan.axes, plan.pairs))
    return Plan(axes, pairs, plan.seeds, tuple(dict.fromkeys(notes)))


def _axis(names: tuple[str, ...], config: StressConfig, asked: bool) -> Axis:
    levels = []
    for name in names:
        entry = find_corruption(name)
        given = config.levels.get(name)
        chosen = given or (entry.small if len(names) > 1 or config.size == StressSize.small else entry.levels)
        for level in chosen:
            entry.check(level)
        levels.append(sorted({float(level) for level in chosen if level}))
        if not levels[-1]:
            raise ValueError(f"levels of {name}: expected one or more above 0, found {given}")
    return Axis(names, tuple(product(*levels)), asked, any(name in config.levels for name in names))


# Contenders of a stress test: each is a capture and a completion method, from detections to completed poses.

_SHIPPED = Path(__file__).parents[2] / "models"


@dataclass(frozen=True)
class Contender:
    """A capture, and the completion method that fills the joints that it did not measure.

    Attributes:
        name: Name in the results.
        about: Description in words.
        capture: Configuration of the capture.
        method: Completion method, or `module:function`.
        weights: Folder of the weights of a learned method; None for those that come with the package.
    """

    name: str
    about: str
    capture: CaptureConfig
    method: str
    weights: str | None

    @property
    def fill(self) -> Callable[[Poses3D, float], Poses3D]:
        """The function that fills poses. Its arguments are the poses and the frames per second."""
        return _filling(self.method, self.weights)

    @property
    def settings(self) -> dict:
        """All settings on which its results depend, JSON-able."""
        return _settings(self)


def contenders(config: StressConfig) -> list[Contender]:
    """Return the contenders of a configuration.

    Raises:
        ValueError: a method does not exist.
        FileNotFoundError: the weights do not exist.
    """
    found = []
    for name in dict.fromkeys(config.methods):
        if name == PAPER:
            found.append(_paper(config))
            continue
        method = find_method(name)
        weights = config.weights if method.learned else None
        found.append(Contender(name, method.help, config.capture, name, weights))
    for each in found:
        if each.weights and not (Path(each.weights) / "model.json").is_file():
            raise FileNotFoundError(f"{each.weights}: expected a folder that `dmae train` wrote, holding model.json")
    return found


def source_hash(name: str) -> str | None:
    """Return a hash of the module of `module:function`; None for the project's own methods."""
    module, colon, _ = name.partition(":")
    spec = find_spec(module) if colon else None
    return hashlib.sha256(Path(spec.origin).read_bytes()).hexdigest() if spec and spec.origin else None


def _paper(config: StressConfig) -> Contender:
    options = yaml.safe_load((resource_folder("dmae", "configs") / "capture/paper.yaml").read_text())
    if config.paper_weights:
        about, method = f"Captured with the paper's thresholds, completed by {config.paper_weights}.", "dmae"
    else:
        about, method = (
            "Captured with the paper's thresholds, filled linearly: no weights of its network given.",
            "linear",
        )
    return Contender(PAPER, about, decode(CaptureConfig, options), method, config.paper_weights)


@cache
def _filling(method: str, weights: str | None) -> Callable[[Poses3D, float], Poses3D]:
    return find_method(method).load(Path(weights) if weights else None)


@cache
def _settings(contender: Contender) -> dict:
    method = contender.method
    settings = {"capture": asdict(contender.capture), "method": method, "file": source_hash(method)}
    if find_method(method).learned:
        settings["weights"] = _hash_of_weights(contender.weights)
    return settings


def _hash_of_weights(folder: str | None) -> str:
    """Return a hash of the descriptions of the weights, which contain the checksums of the weights."""
    files = [Path(folder) / "model.json"] if folder else sorted(_SHIPPED.glob("*/model.json"))
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()
