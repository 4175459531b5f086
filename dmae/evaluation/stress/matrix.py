"""The stress matrix: corrupt clips, capture them, complete them with each contender, and score the results.

`prepare` plans the cells of clips and looks for results that exist already, `compute` runs the others and returns the
curves. Each result is stored as soon as it is computed.
"""

import hashlib
import json
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, fields, is_dataclass, replace
from functools import cache
from importlib import metadata
from pathlib import Path

import numpy as np

from dmae.completion.features import noisiness, smooth_by_noise
from dmae.completion.methods import completion_method, find_method
from dmae.data.clip import Clip, Poses3D
from dmae.data.conversion import convert
from dmae.evaluation.config import StressConfig
from dmae.evaluation.corruption.corrupt import corrupt, people_of
from dmae.evaluation.scores import json_numbers, measured_by_all, score, scored_actors, truth_of
from dmae.evaluation.stress.curves import curves
from dmae.evaluation.stress.plan import Cell, Contender, Plan, allowed, contenders, plan, settings_of, source_hash
from dmae.files.contents import write_atomic
from dmae.formats.config import clip_range
from dmae.formats.reading import Clips
from dmae.metrics.angles import leg_angles
from dmae.parallel import in_parallel, one_thread, process_count, running_on
from dmae.progress import progress
from dmae.reconstruction.config import CaptureConfig
from dmae.reconstruction.pipeline import capture
from dmae.reporting.tables import counted

SMOOTHING = 0.1
"""s; smoothing after every method, except methods that smooth by themselves, as in `dmae evaluate`."""
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
        reference = truth_of(clip)
        reference, actors = convert(reference, reference.skeleton.parts[-1]), scored_actors(clip)
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
            filled = contender.fill(given, clip.fps)
        if filled.xyz.shape[:2] != given.xyz.shape[:2]:
            raise ValueError(
                f"method {contender.name}: expected poses of {given.xyz.shape[1]} persons in {len(given.xyz)} frames "
                f"back, found {filled.xyz.shape[1]} in {len(filled.xyz)}"
            )
        if not (contender.method in completion_method and find_method(contender.method).smooths):
            filled = smooth_by_noise(filled, noisiness(given), clip.fps, SMOOTHING)
        filled = convert(filled, clip.truth.skeleton)
        found = score(filled, given, clip.truth, subject.actors, fps=clip.fps, angles=subject.angles)
        scores[contender.name] = {name: found[name] for name in KEPT}
    return scores


_PACKAGE = Path(__file__).parents[2]
_CODE = (
    "data", "numerics", "formats", "reconstruction", "metrics", "completion", "evaluation/corruption",
    "evaluation/scores.py", "evaluation/stress/matrix.py",
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
        if text and not text.endswith("\n"):
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
    digest = hashlib.sha256(str(clip.provenance.get("format")).encode())
    for name in ("id", "fps", "rig", "true_rig", "detections", "truth"):
        _update(digest, getattr(clip, name))
    return digest.hexdigest()


def _update(digest, value) -> None:
    """Add a value of a clip to a hash. Arrays are added with their type and shape."""
    if is_dataclass(value):
        for field in fields(value):
            _update(digest, getattr(value, field.name))
    elif isinstance(value, np.ndarray):
        digest.update(f"{value.dtype}{value.shape}".encode())
        digest.update(np.ascontiguousarray(value).tobytes())
    else:
        digest.update(f"{value!r};".encode())


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
"""Name of the file of results inside the folder of a stress test."""
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
    clips = clips.part(numbers) if isinstance(clips, Clips) else [clips[number] for number in numbers]
    planned, compared = plan(config), contenders(config)
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
    """Compute the missing cells, and return the content of `stress.json` (`dmae.evaluation.stress.curves`).

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
    for clip, cell in chosen:
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
