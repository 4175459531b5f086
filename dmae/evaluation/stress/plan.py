"""The plan of a stress matrix: axes, pairs of axes, the cells that they need, and the methods that contend."""

import hashlib
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, replace
from functools import cache
from importlib.util import find_spec
from itertools import product
from pathlib import Path

import yaml

from dmae.completion.methods import find_method
from dmae.completion.weights import PAPER as PAPER_WEIGHTS
from dmae.completion.weights import weights_folder
from dmae.data.clip import Clip, Poses3D
from dmae.data.json_values import decode
from dmae.data.resources import resource_folder
from dmae.evaluation.config import PAPER, StressConfig, StressSize
from dmae.evaluation.corruption.registry import corruptions, find_corruption
from dmae.reconstruction.config import CaptureConfig, capture_method

_PAIRS = {
    StressSize.small: ("cameras+objects",),
    StressSize.full: ("cameras+objects", "calibration+cameras", "crowd+misses", "jitter+bursts"),
}
_SEEDS = {StressSize.small: 1, StressSize.full: 3}


@dataclass(frozen=True)
class Cell:
    """One corruption of a clip, to be captured once."""

    levels: tuple[tuple[str, float], ...]  # Name and level of each corruption with a level above 0
    seed: int  # Seed of the random numbers


@dataclass(frozen=True)
class Axis:
    """One corruption, or two at the same time."""

    names: tuple[str, ...]  # Names of the corruptions
    # Tuples with a level above 0 for each corruption. The levels of a single corruption increase.
    levels: tuple[tuple[float, ...], ...]
    # Whether the user named the axis. If clips do not allow it, that is then an error; otherwise the axis is left out.
    asked: bool = False
    given: bool = False  # Whether the user gave the levels. A level that clips do not allow is then an error.

    @property
    def name(self) -> str:
        return "+".join(self.names)

    def active(self, level: tuple[float, ...]) -> tuple[tuple[str, float], ...]:
        """Return name and value of the corruptions that are above 0 at a level."""
        return tuple((name, value) for name, value in zip(self.names, level, strict=True) if value)


@dataclass(frozen=True)
class Plan:
    """Axes, pairs and seeds of a matrix, and notes on what was left out."""

    axes: tuple[Axis, ...]
    pairs: tuple[Axis, ...]
    seeds: tuple[int, ...]
    notes: tuple[str, ...] = ()

    def cells(self) -> list[Cell]:
        """Return every cell once. The first one is the cell of the uncorrupted clip."""
        levels = [axis.active(level) for axis in (*self.axes, *self.pairs) for level in axis.levels]
        return [*dict.fromkeys([Cell((), 0), *(Cell(level, seed) for level in levels for seed in self.seeds)])]


def plan(config: StressConfig) -> Plan:
    """Return the plan of a configuration for clips that allow all axes.

    Raises ValueError if an axis or level does not exist, a pair is not two different axes, or an axis with levels is
    unused.
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
    """Return the plan without axes and levels that a clip forbids, each with a note; ValueError if requested."""
    notes = list(plan.notes)

    def keep(axis: Axis) -> Iterator[Axis]:
        fits, refused = [], None
        for level in axis.levels:
            try:
                for name, value in zip(axis.names, level, strict=True):
                    find_corruption(name).check(value, clip)
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


_SHIPPED = Path(__file__).parents[2] / "models"


@dataclass(frozen=True)
class Contender:
    """A capture, and the completion method that fills the joints that it did not measure."""

    name: str  # Name in the results
    about: str  # Description in words
    capture: CaptureConfig  # Configuration of the capture
    method: str  # Completion method, or `module:function`
    weights: str | None  # Folder of the weights of a learned method; None for those that come with the package

    @property
    def fill(self) -> Callable[[Poses3D, float], Poses3D]:
        """The function that fills poses. Its arguments are the poses and the frames per second."""
        return _filling(self.method, self.weights)


def contenders(config: StressConfig) -> list[Contender]:
    """Return the contenders; ValueError if a method does not exist, FileNotFoundError if weights do not."""
    found = []
    for name in dict.fromkeys(config.methods):
        if name == PAPER:
            options = yaml.safe_load((resource_folder("dmae", "configs") / "capture/paper.yaml").read_text())
            weights = config.paper_weights or PAPER_WEIGHTS
            about = f"Captured with the paper's thresholds, completed by its network, weights={weights}."
            found.append(Contender(PAPER, about, decode(CaptureConfig, options), "dmae", weights))
        elif name in capture_method:
            own = CaptureConfig(method=name)
            found.append(Contender(name, f"{capture_method[name].help} As measured.", own, "measured", None))
        else:
            method = find_method(name)
            weights = config.weights if method.learned else None
            found.append(Contender(name, method.help, config.capture, name, weights))
    for each in found:
        if each.weights and not (weights_folder(each.weights) / "model.json").is_file():
            raise FileNotFoundError(f"{each.weights}: expected a folder that `dmae train` wrote, holding model.json")
    return found


def source_hash(name: str) -> str | None:
    """Return a hash of the module of `module:function`; None for the project's own methods."""
    module, colon, _ = name.partition(":")
    spec = find_spec(module) if colon else None
    return hashlib.sha256(Path(spec.origin).read_bytes()).hexdigest() if spec and spec.origin else None


@cache
def _filling(method: str, weights: str | None) -> Callable[[Poses3D, float], Poses3D]:
    return find_method(method).load(Path(weights) if weights else None)


@cache
def settings_of(contender: Contender) -> dict:
    """Return all settings on which the results of a contender depend, JSON-able."""
    method = contender.method
    files = [source_hash(name) for name in (method, contender.capture.method)]
    settings = {"capture": asdict(contender.capture), "method": method, "files": files}
    if find_method(method).learned:
        # The descriptions of weights contain their checksums.
        folder = contender.weights
        files = [weights_folder(folder) / "model.json"] if folder else sorted(_SHIPPED.glob("*/model.json"))
        settings["weights"] = hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()
    return settings
