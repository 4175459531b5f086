"""The stress matrix: compute every cell of every clip, or read it from the cache, and return the result."""

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from dmae.data.clip import Clip
from dmae.evaluation.stress.cache import Cache, hash_of_clip, key_of
from dmae.evaluation.stress.cells import run_cell, subject_of
from dmae.evaluation.stress.config import StressConfig
from dmae.evaluation.stress.contenders import Contender, contenders
from dmae.evaluation.stress.curves import Runs, curves
from dmae.evaluation.stress.plan import Cell, Plan, allowed, plan
from dmae.formats.reading import Clips
from dmae.parallel import in_parallel, process_count, running_on
from dmae.progress import progress
from dmae.reporting.words import counted

CACHE = "cache"
"""Name of the folder of results inside the folder of a stress test."""
_TRIED = 3
"""Number of cells that a forecast computes."""


@dataclass(frozen=True)
class Matrix:
    """A stress matrix that is to be computed.

    Attributes:
        clips: The clips. Each is read when it is accessed.
        hashes: Hashes of the clips.
        ids: Ids of the clips.
        reference: Reference of the results: "truth" or "capture".
        plan: Axes that all clips allow.
        contenders: The contenders to compare.
        config: Options.
        cache: Results that exist already.
    """

    clips: Sequence[Clip]
    hashes: tuple[str, ...]
    ids: tuple[str, ...]
    reference: str
    plan: Plan
    contenders: tuple[Contender, ...]
    config: StressConfig
    cache: Cache

    def key(self, clip: int, cell: Cell, contender: Contender) -> str:
        return key_of(self.hashes[clip], self.config.capture, cell, contender)

    def missing(self) -> dict[tuple[int, Cell], list[Contender]]:
        """Return the contenders without a result, by clip and cell, in the order of the clips."""
        cells = list(self.plan.cells())
        wanted = {
            (clip, cell): [each for each in self.contenders if self.cache.get(self.key(clip, cell, each)) is None]
            for clip in range(len(self.clips))
            for cell in cells
        }
        return {place: left for place, left in wanted.items() if left}

    @property
    def forecast(self) -> str:
        """Return the amount of computation left, in words."""
        cells, missing = len(list(self.plan.cells())) * len(self.clips), len(self.missing())
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
    """Return the matrix of clips: read each clip, plan the cells, and look for existing results.

    Args:
        clips: Simulated or real clips. Either all have truth or none has.
        config: Options. The fields `data` and `out` are not used.
        cache: Folder of results; None to keep them in memory.

    Raises:
        ValueError: there are no clips, two have the same id, only some have truth, or a requested axis is not possible.
    """
    if not len(clips):
        raise ValueError("no clip to stress: expected one or more")
    numbers = config.numbers(len(clips))
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
    return curves(matrix.plan, matrix.contenders, _runs(matrix), matrix.ids, matrix.reference)


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
        subject = subject_of(matrix.clips[clip], matrix.config.capture)
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
            number, subject = clip, subject_of(matrix.clips[clip], matrix.config.capture)
        yield subject, clip, cell, left


def _run(subject, clip: int, cell: Cell, left: list[Contender]) -> tuple[int, Cell, dict[str, dict]]:
    return clip, cell, run_cell(subject, cell, left)


def _runs(matrix: Matrix) -> Runs:
    """Return a function that looks up the scores of a contender in cells, one for each clip and cell."""

    def runs(contender: Contender, cells: Sequence[Cell]) -> list[dict]:
        return [
            {"clip": name, "cameras": [], **matrix.cache.get(matrix.key(clip, cell, contender))}
            for cell in cells
            for clip, name in enumerate(matrix.ids)
        ]

    return runs
