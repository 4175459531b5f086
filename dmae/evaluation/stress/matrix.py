"""The stress matrix: its plan, its computation, and the curves that come out.

The plan has axes, pairs of axes, the cells that they need, and the methods that contend. `prepare` plans the cells of
clips and looks for results that exist already, `compute` runs the others and returns the curves. Each result is stored
as soon as it is computed.
"""

import hashlib
import json
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cache
from importlib import metadata
from itertools import product
from pathlib import Path

import joblib
import numpy as np

from dmae.completion.config import SMOOTHING
from dmae.completion.methods import find_method
from dmae.data.clip import Clip, Poses3D
from dmae.data.conversion import convert
from dmae.data.json_values import rounded
from dmae.data.resources import read_preset
from dmae.evaluation.config import PAPER, STRESSED, StressConfig, StressSize
from dmae.evaluation.corruption.corrupt import corrupt, people_of
from dmae.evaluation.corruption.registry import corruptions, find_corruption
from dmae.evaluation.evaluate import filled_by
from dmae.evaluation.scores import (
    compared_truth,
    figure_score,
    json_numbers,
    measured_by_all,
    run_table,
    score,
    scored_actors,
)
from dmae.files.contents import write_atomic
from dmae.formats.config import clip_range
from dmae.metrics.angles import leg_angles
from dmae.metrics.table import Score
from dmae.nearest import choices
from dmae.numerics.statistics import mean_known
from dmae.parallel import in_parallel, one_thread, process_count, running_on
from dmae.progress import progress
from dmae.reconstruction.config import CaptureConfig, capture_method
from dmae.reconstruction.pipeline import capture
from dmae.registry import source_hash
from dmae.reporting.tables import counted

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
    used = dict.fromkeys(name for axis in (*axes, *pairs) for name in axis.names)
    if unused := sorted(config.levels.keys() - used.keys()):
        given = ", ".join(f"levels.{name}" for name in unused)
        raise ValueError(f"{given}: no such axis is used; {choices(unused[0], used)}")
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
        elif axis.asked and refused is not None:
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
            raise ValueError(f"levels.{name}: expected one or more above 0, found {given}")
    return Axis(names, tuple(product(*levels)), asked, any(name in config.levels for name in names))


@dataclass(frozen=True)
class Contender:
    """A capture, and the completion method that fills the joints that it did not measure."""

    name: str  # Name in the results
    about: str  # Description in words
    capture: CaptureConfig  # Configuration of the capture
    method: str  # Completion method, or `module:function`
    weights: str | None  # Folder of the weights of a learned method; None for those that come with the package


def _with_usual_methods(config: StressConfig, clip: Clip) -> tuple[StressConfig, list[str]]:
    """Return the configuration with the usual methods for the body in a clip, and a note on what is left out."""
    from dmae.completion.weights import methods_for  # it loads torch

    skeleton = clip.detections.skeleton
    methods = methods_for(STRESSED, skeleton, config.weights)
    left_out = [name for name in STRESSED if name not in methods]
    why = f"Left out {', '.join(left_out)}: their weights know people, and nothing of {skeleton.name}."
    return replace(config, methods=methods), [why] if left_out else []


def contenders(config: StressConfig) -> list[Contender]:
    """Return the contenders; ValueError if a method does not exist, FileNotFoundError if weights do not."""
    found = []
    for name in dict.fromkeys(config.methods or ()):
        weights: str | None
        if name == PAPER:
            from dmae.completion.weights import PAPER as PAPER_WEIGHTS  # it loads torch

            weights = config.paper_weights or PAPER_WEIGHTS
            about = f"Captured with the paper's thresholds, completed by its network, weights={weights}."
            found.append(Contender(PAPER, about, read_preset(CaptureConfig, "capture", "paper"), "dmae", weights))
        else:
            method = find_method(name)
            weights = config.weights if method.learned else None
            found.append(Contender(name, method.help, config.capture, name, weights))
    for name in dict.fromkeys(config.captures):
        about = f"{capture_method.find(name).help} As measured."
        found.append(Contender(name, about, CaptureConfig(method=name), "measured", None))
    for each in found:
        if each.weights and not _record(each.weights).is_file():
            raise FileNotFoundError(f"{each.weights}: expected a folder that `dmae train` wrote, holding model.json")
    return found


def _record(weights: str) -> Path:
    from dmae.completion.weights import weights_folder  # it loads torch

    return weights_folder(weights) / "model.json"


@cache
def _filling(method: str, weights: str | None) -> Callable[[Poses3D, float], Poses3D]:
    return find_method(method).load(Path(weights) if weights else None)


@cache
def settings_of(contender: Contender) -> dict:
    """Return all settings on which the results of a contender depend, JSON-able."""
    method = contender.method
    files = [source_hash(name) for name in (method, contender.capture.method)]
    settings: dict = {"capture": asdict(contender.capture), "method": method, "files": files}
    if find_method(method).learned:
        from dmae.completion.weights import weights_checksum  # it loads torch

        settings["weights"] = weights_checksum(contender.weights)
    return settings


# The matrix: corrupt clips, capture them, complete them with each contender, and score the results

KEPT = ("pcp", "pck", "mpjpe", "shares", "hidden", "idf1", "blocks")
"""Names of the scores that are stored."""


@dataclass(frozen=True)
class Subject:
    """A clip that is to be corrupted."""

    clip: Clip  # The clip. Its truth is the reference of the results, on the skeleton of the comparison.
    people: Poses3D  # The people of the clip, see `dmae.evaluation.corruption.corrupt`
    actors: tuple[int, ...] | None  # Persons of the truth over which PCP is averaged; None for all
    angles: np.ndarray | None = None  # Angles of the legs of the truth (`dmae.metrics.angles`); None to score none


def subject_of(clip: Clip, config: CaptureConfig, angles: bool = False) -> Subject:
    """Return a clip prepared to be corrupted and scored, in angles of the legs as well if these are asked for.

    The reference is its truth; of a fused skeleton, the second part. Without truth, the reference is the captured
    joints that three views or more measured, with all cameras; ValueError if there are none.
    """
    people, actors = people_of(clip, config), None
    clip = replace(clip, images=None, poses=None, occlusion=None, detection_labels=None)
    if clip.truth is not None:
        reference, actors = compared_truth(clip), scored_actors(clip)
    else:
        reference = measured_by_all(clip, config)
        if np.isnan(reference.xyz).all():
            raise ValueError(
                f"clip {clip.id!r} has no truth, and its {len(clip.rig)} cameras measure no joint in three views or "
                "more, which results would be compared with; expected truth, or more cameras"
            )
    return Subject(replace(clip, truth=reference), people, actors, leg_angles(reference)[0] if angles else None)


def run_cell(subject: Subject, cell: Cell, contenders: Sequence[Contender]) -> dict[str, dict]:
    """Return the scores of contenders in a cell, by name. Contenders with the same capture share its result.

    Raises ValueError if a method returned poses of another shape.
    """
    clip = corrupt(subject.clip, dict(cell.levels), seed=cell.seed, people=subject.people)
    captured: dict[CaptureConfig, Poses3D] = {}
    scores = {}
    for contender in contenders:
        if contender.capture not in captured:
            captured[contender.capture] = capture(clip, contender.capture)
        given = captured[contender.capture]
        with one_thread():
            fill = _filling(contender.method, contender.weights)
            filled = filled_by(contender.method, fill, given, clip.fps, SMOOTHING)
        assert clip.truth is not None
        filled = convert(filled, clip.truth.skeleton)
        found = score(filled, given, clip.truth, subject.actors, fps=clip.fps, angles=subject.angles)
        scores[contender.name] = {name: found[name] for name in KEPT}
    return scores


_PACKAGE = Path(__file__).parents[2]
_CODE = (
    "data", "numerics", "formats", "reconstruction", "metrics", "completion", "evaluation/corruption",
    "evaluation/evaluate.py", "evaluation/scores.py", "evaluation/stress/matrix.py",
)  # fmt: skip
"""Modules of the package on which the results depend."""
_VERSIONS = ("numpy", "scipy", "torch", "opencv-python-headless")


class Cache:
    """Scores of cells by key, in one file of JSON lines, appended as soon as there is a result, or in memory.

    A line that is damaged, as by a kill while it was written, is left out.
    """

    def __init__(self, file: Path | None):
        self.file, self.results = file, {}
        text = file.read_text(errors="replace") if file and file.is_file() else ""
        for line in text.splitlines():
            try:
                self.results |= json.loads(line)
            except (TypeError, ValueError):
                continue
        if file and text and not text.endswith("\n"):
            write_atomic(file, "".join(json.dumps({key: each}) + "\n" for key, each in self.results.items()))

    def put(self, key: str, scores: dict) -> None:
        """Store a result."""
        line = json.dumps({key: json_numbers(scores)}, allow_nan=False)
        # A result that was just computed and one that is read later are equal, bit by bit.
        self.results |= json.loads(line)
        if self.file:
            self.file.parent.mkdir(parents=True, exist_ok=True)
            with self.file.open("a") as file:
                file.write(line + "\n")


def hash_of_clip(clip: Clip) -> str:
    """Return a hash of a clip without images, poses and provenance, on which results do not depend.

    It includes the format of the clip's files: the scored persons depend on it
    (`dmae.evaluation.scores.scored_actors`).
    """
    parts = (clip.rig, clip.true_rig, clip.detections, clip.truth)
    arrays = [None if part is None else asdict(part) for part in parts]
    return joblib.hash([clip.provenance.get("format"), clip.id, clip.fps, *arrays])


@cache
def code_hash() -> str:
    """Return a hash of the code that results depend on, and of the versions of the libraries that it uses."""
    digest = hashlib.sha256(json.dumps({name: metadata.version(name) for name in _VERSIONS}).encode())
    for part in _CODE:
        path = _PACKAGE / part
        for file in sorted(path.rglob("*.py")) if path.is_dir() else [path]:
            digest.update(file.relative_to(_PACKAGE).as_posix().encode() + file.read_bytes())
    return digest.hexdigest()


CACHE = "cache.jsonl"
"""Name of the results file in the folder of a stress test."""
_TRIED = 3  # Number of cells that a forecast computes


@dataclass(frozen=True)
class Matrix:
    """A stress matrix that is to be computed."""

    clips: Sequence[Clip]  # The clips. Each is read when it is accessed.
    hashes: tuple[str, ...]  # Hashes of the clips
    ids: tuple[str, ...]  # Ids of the clips
    reference: str  # Reference of the results: "truth" or "capture"
    plan: Plan  # Axes that all clips allow
    contenders: tuple[Contender, ...]  # The contenders to compare
    config: StressConfig  # Options
    cache: Cache  # Results that exist already

    def key(self, clip: int, cell: Cell, contender: Contender) -> str:
        """Return the key of a contender's scores in a cell of a clip: a hash of everything that they depend on."""
        own = {name: source_hash(name) for name, _ in cell.levels}
        people = asdict(self.config.capture)  # It captures the people of a clip without truth.
        settings = [self.hashes[clip], people, asdict(cell), own, settings_of(contender), code_hash()]
        settings += ["angles"] if self.config.angles else []
        return hashlib.sha256(json.dumps(settings, sort_keys=True).encode()).hexdigest()

    def missing(self) -> dict[tuple[int, Cell], list[Contender]]:
        """Return the contenders without a result, by clip and cell, in the order of the clips."""
        cells = self.plan.cells()
        wanted = {
            (clip, cell): [each for each in self.contenders if self.key(clip, cell, each) not in self.cache.results]
            for clip in range(len(self.clips))
            for cell in cells
        }
        return {place: left for place, left in wanted.items() if left}

    @property
    def forecast(self) -> str:
        """Return the amount of computation left, in words."""
        cells, missing = len(self.plan.cells()) * len(self.clips), len(self.missing())
        kept = f"{cells - missing} of them kept from earlier runs, " if missing < cells else ""
        parts = (
            counted(len(self.clips), "clip"),
            f"corruptions: {len(self.plan.axes)} alone, {len(self.plan.pairs)} in pairs",
            counted(len(self.plan.seeds), "seed"),
        )
        return (
            f"{counted(cells, 'cell')} ({'; '.join(parts)}), {kept}{missing} to compute with "
            f"{counted(len(self.contenders), 'method')} each"
        )


def prepare(clips: Sequence[Clip], config: StressConfig, cache: Path | None = None) -> Matrix:
    """Return the matrix of clips: read each clip, plan the cells, and look for existing results in a file, if given.

    The fields `data` and `out` of the configuration are not used. Raises ValueError if there are no clips, two have the
    same id, only some have truth, or a requested axis is not possible.
    """
    if not len(clips):
        raise ValueError("no clip to stress: expected one or more")
    numbers = clip_range(len(clips), config.first, config.clips)
    clips = clips[numbers.start : numbers.stop]
    planned = plan(config)
    if config.methods is None:
        config, notes = _with_usual_methods(config, clips[0])
        planned = replace(planned, notes=(*planned.notes, *notes))
    compared = contenders(config)
    hashes, ids, known = [], [], []
    for clip in clips:
        if clip.id in ids:
            raise ValueError(f"two clips have the id {clip.id!r}; expected different ones")
        planned = allowed(planned, clip)
        hashes.append(hash_of_clip(clip))
        ids.append(clip.id)
        known.append(clip.truth is not None)
    if len(set(known)) > 1:
        without = ", ".join(name for name, one in zip(ids, known, strict=True) if not one)
        raise ValueError(f"clips {without} have no truth, others have; expected all to have truth, or none")
    reference = "truth" if known[0] else "capture"
    return Matrix(clips, tuple(hashes), tuple(ids), reference, planned, tuple(compared), config, Cache(cache))


def compute(matrix: Matrix) -> dict:
    """Compute the missing cells, and return the content of `stress.json` (`dmae.evaluation.stress.matrix`).

    Each cell is stored as soon as it is computed, so that a run can be interrupted at any time and continued.
    """
    missing = matrix.missing()
    with running_on(matrix.config.backend):
        done = in_parallel(_run, _tasks(matrix, missing), matrix.config.workers, ordered=False)
    for clip, cell, scores in progress(done, "stressing", len(missing)):
        for contender in missing[clip, cell]:
            matrix.cache.put(matrix.key(clip, cell, contender), scores[contender.name])
    runs = [
        {"method": each.name, "levels": cell.levels, "seed": cell.seed, "clip": name, "cameras": []}
        | matrix.cache.results[matrix.key(clip, cell, each)]
        for each in matrix.contenders
        for cell in matrix.plan.cells()
        for clip, name in enumerate(matrix.ids)
    ]
    return curves(matrix.plan, matrix.contenders, runs, matrix.ids, matrix.reference)


def time_of(matrix: Matrix) -> float:
    """Return an estimate of the time that `compute` takes, s. A few cells are run for it, and not stored on disk."""
    missing = matrix.missing()
    if not missing:
        return 0.0
    places = list(missing)
    # The first cell also loads the weights of methods.
    chosen = [places[0], *(places[number * len(places) // _TRIED] for number in range(_TRIED))]
    spent = []
    for clip, cell in progress(chosen, "estimating the time"):
        subject = subject_of(matrix.clips[clip], matrix.config.capture, matrix.config.angles)
        start = time.perf_counter()
        run_cell(subject, cell, missing[clip, cell])
        spent.append(time.perf_counter() - start)
    with running_on(matrix.config.backend):
        processes = min(process_count(matrix.config.workers), len(places))
    return sum(spent[1:]) / len(spent[1:]) * len(places) / processes


def _tasks(matrix: Matrix, missing: dict[tuple[int, Cell], list[Contender]]) -> Iterator[tuple]:
    """Yield the arguments of `_run`. Each clip is read, and its people are captured, only once."""
    number, subject = None, None
    for (clip, cell), left in missing.items():
        if clip != number:
            number = clip
            subject = subject_of(matrix.clips[clip], matrix.config.capture, matrix.config.angles)
        yield subject, clip, cell, left


def _run(subject, clip: int, cell: Cell, left: list[Contender]) -> tuple[int, Cell, dict[str, dict]]:
    return clip, cell, run_cell(subject, cell, left)


# Degradation curves with their intervals, breaking points, and differences between methods

PCP_DROP = 10.0
"""A method is broken if its PCP is this number of points below its PCP at level 0."""
HIDDEN_ERROR = 100.0
"""mm; a method is broken if its mean error of unmeasured joints is above this."""


def curves(plan: Plan, contenders: Sequence[Contender], runs: list[dict], clips: Sequence[str], reference: str) -> dict:
    """Return all curves of a matrix, JSON-able. None stands for values that were not measured.

    `runs` are the scores of each method in each cell of each clip, with `method`, `levels` and `seed` of the cell,
    `clip` and `cameras`; `reference` is "truth" or "capture".

    Returns:
        `clips`, their ids; `reference`; `seeds`; `methods`, their descriptions by name; `notes`.

        `axes`, each with `name`, `about`, `unit` and `methods`: name to `points` and `breaks`. A point has `level`,
        `pcp` % and `hidden` mm, each [value, low, high] with the 95 % interval over blocks of time, `recall` and
        `precision` of joints, `idf1` and `absent` %; and `angles`, degrees, as `pcp`, if they are scored. `breaks`
        contains, for `pcp` and for `hidden`, the level at which the method breaks, with its interval: [level, low,
        high]. An entry is None if it is beyond the range of levels; both ends of the interval are None if the clips
        are too short for an interval; the whole list is None if nothing was measured. `best` is the method of highest
        PCP at the greatest level. `level_with` are the other methods from which it differs by no more than noise;
        None if the clips are too short to decide.

        `pairs`, each with `names`, `units` and `points` of two `levels`, by method.
    """
    groups: dict[tuple, list[dict]] = {}
    for run in runs:
        groups.setdefault((run["method"], run["levels"]), []).append(run)
    points = {key: _point(group) for key, group in groups.items()}
    return {
        "clips": list(clips),
        "reference": reference,
        "seeds": list(plan.seeds),
        "methods": {each.name: each.about for each in contenders},
        "notes": list(plan.notes),
        "axes": [_along(axis, contenders, points) for axis in plan.axes],
        "pairs": [
            {
                "names": list(axis.names),
                "units": [find_corruption(name).unit for name in axis.names],
                "points": [
                    {
                        "levels": list(level),
                        "methods": {each.name: _json(points[each.name, axis.active(level)]) for each in contenders},
                    }
                    for level in axis.levels
                ],
            }
            for axis in plan.pairs
        ],
    }


def breaking_point(levels: np.ndarray, values: np.ndarray, broken: np.ndarray) -> np.ndarray:
    """Return the level (N,) at which each curve first breaks; infinite for a curve that does not break.

    Curves are straight lines between levels. Levels without a measurement are skipped.

    Args:
        levels: (L,) increasing levels, the first is 0.
        values: (N, L) distance of each curve above its bound, negative below it; NaN without a measurement.
        broken: (N, L) True where a curve is below its bound.
    """
    found = np.full(len(values), np.inf)
    for curve in np.flatnonzero(broken.any(1)):
        first = int(broken[curve].argmax())
        before = np.flatnonzero(~np.isnan(values[curve, :first]))
        if not len(before):
            found[curve] = levels[first]
            continue
        (start, end), (above, below) = levels[[before[-1], first]], values[curve, [before[-1], first]]
        found[curve] = start + (end - start) * above / (above - below)
    return found


def _point(runs: list[dict]) -> dict[str, Score | float]:
    """Return the scores of one method at one level, over all clips and seeds: see `curves`; some have no interval."""
    table = run_table(runs, "seed")
    figures = ("pcp", "hidden", *(["angles"] if (table["figure"] == "angles").any() else []))
    singles = {
        "recall": [run["pck"]["recall"] for run in runs],
        "precision": [run["pck"]["precision"] for run in runs],
        "idf1": [run["idf1"] for run in runs],
        "absent": [run["shares"]["absent"] for run in runs],
    }
    intervals = {figure: figure_score(table, figure, "seed") for figure in figures}
    return intervals | {name: mean_known(np.array(values, float)) for name, values in singles.items()}


def _json(point: dict[str, Score | float]) -> dict:
    return {
        name: [*each.json(1).values()] if isinstance(each, Score) else rounded(each, 1) for name, each in point.items()
    }


def _along(axis: Axis, contenders: Sequence[Contender], points: dict[tuple, dict]) -> dict:
    entry = find_corruption(axis.name)
    levels = [(0.0,), *axis.levels]
    found_of = {each.name: [points[each.name, axis.active(level)] for level in levels] for each in contenders}
    methods = {
        name: {
            "points": [{"level": level} | _json(point) for (level,), point in zip(levels, found, strict=True)],
            "breaks": _breaks(np.array(levels)[:, 0], found),
        }
        for name, found in found_of.items()
    }
    last = {name: found[-1]["pcp"] for name, found in found_of.items()}
    return {"name": axis.name, "about": entry.help, "unit": entry.unit, "methods": methods} | _best(last)


def _breaks(levels: np.ndarray, points: list[dict]) -> dict:
    """Return the levels at which a method breaks, by PCP and by the error of unmeasured joints, see `curves`."""
    # If the clips are too short for an interval of a score, values derived from it have no interval either.
    certain = np.isfinite(points[0]["pcp"].interval[0])
    # (1 + draws, L): first the scores at each level, then one row for each draw
    pcp, hidden = (
        np.stack([np.append(each[figure].value, each[figure].drawn) for each in points], 1)
        for figure in ("pcp", "hidden")
    )
    breaks: dict[str, list[float | None] | None] = {}
    for figure, margin in (("pcp", pcp - pcp[:, :1] + PCP_DROP), ("hidden", HIDDEN_ERROR - hidden)):
        if np.isnan(margin[0]).all():
            breaks[figure] = None
            continue
        found = breaking_point(levels, margin, margin < 0)
        low, high = np.quantile(found[1:], [0.025, 0.975], method="inverted_cdf") if certain else (np.nan, np.nan)
        breaks[figure] = [rounded(each, 2) for each in (found[0], low, high)]
    return breaks


def _best(scores: dict[str, Score]) -> dict:
    """Return the method of highest PCP, and the others that it exceeds by no more than noise; None if unknown."""
    known = {name: each for name, each in scores.items() if not np.isnan(each.value)}
    if not known:
        return {"best": None, "level_with": []}
    best = max(known, key=lambda name: known[name].value)
    differences = {name: known[best] - each for name, each in known.items() if name != best}
    if any(np.isnan(each.interval[0]) for each in differences.values()):
        return {"best": best, "level_with": None}
    return {"best": best, "level_with": [name for name, each in differences.items() if not each.excludes_zero]}
