"""Score methods of completion over clips and subsets of cameras."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from dmae.completion.methods.registry import completion_method, find_method
from dmae.data.clip import Clip, Poses3D
from dmae.evaluation.config import EvaluateConfig, Input
from dmae.evaluation.scored_data import scored_clip, scored_options
from dmae.evaluation.scores import score, summary
from dmae.evaluation.trials import filled_by_all, filled_trials
from dmae.formats.reading import Clips, load
from dmae.parallel import Backend, in_parallel, process_count, running_on
from dmae.progress import duration, progress
from dmae.reporting.words import counted

Methods = dict[str, Callable[[Poses3D, float], Poses3D]]
"""Functions that fill poses, by name."""
_TRIED = 50
"""Number of frames of a clip that a forecast scores."""


def evaluate(config: EvaluateConfig) -> dict:
    """Score every method on every clip, captured with every subset of cameras or with synthetic gaps.

    Poses are compared on `skeleton`, or by default on the skeleton of the truth. If that is a fused one
    (`body25+shelf14`), they are compared on its second part. With synthetic gaps (`input`) or `reference=capture` they
    are compared on the skeleton of the detections, if the truth has it. Scores are averaged over clips, then over
    subsets. Errors by length of gap count only the joints that all methods except `measured` filled, so that no method
    gains by leaving out difficult joints.

    Returns:
        JSON-able. None stands for a score without data. The entries are `recording`; `skeleton`; `poses`, the input in
        words; `options` and `clips`, which identify the scored data, see `dmae.evaluation.scored_data`; and `results`,
        with one entry for each method and number of views (0 with synthetic gaps): `method`; `views`; `mean` of the
        scores; `intervals` (95 %, over blocks of time) of `pcp`, %, of `mpjpe` and `hidden`, mm, and of `recall` of the
        hidden joints, %; `worst` (`pcp` and `cameras` of the subset with the lowest PCP); and `runs`, the scores of
        each clip and subset as `score` returns them.

    Raises:
        ValueError: a clip has no truth, there are no clips or methods, a method or number of views does not exist,
            options exclude each other, or poses made elsewhere do not fit their clip.
        FileNotFoundError: the poses made elsewhere do not exist.
    """
    methods, clips = _methods(config), _clips(config)
    alone = config.workers == 1 and config.backend == Backend.loky
    tasks = ((config, clips.part(range(n, n + 1)), methods if alone else None, len(clips) == 1) for n in clips.numbers)
    runs: dict[tuple[str, int], list[dict]] = {}
    scored: dict[str, dict] = {}
    with running_on(config.backend):
        done = in_parallel(_score_clip, tasks, config.workers)
        for found in done if len(clips) == 1 else progress(done, "evaluating", len(clips)):
            scored[found.id] = found.facts
            for group, entry in found.entries:
                runs.setdefault(group, []).append(entry)
    results = [{"method": name, "views": views, **summary(entries)} for (name, views), entries in runs.items()]
    recording = found.id if clips.total == 1 else f"{len(clips)} clips of {Path(config.data.path).name}"
    poses = f"poses of {Path(config.poses).name}" if config.poses else Input(config.input).value.replace("_", " ")
    return {
        "recording": recording,
        "skeleton": found.skeleton,
        "poses": poses,
        "options": scored_options(config),
        "clips": scored,
        "results": results,
    }


@dataclass(frozen=True)
class _Scored:
    """The scores of a clip by method and number of views, facts about it, and the skeleton of the comparison."""

    id: str
    facts: dict
    skeleton: str
    entries: list[tuple[tuple[str, int], dict]]


def _score_clip(config: EvaluateConfig, clips: Sequence[Clip], methods: Methods | None, shown: bool) -> _Scored:
    """Return the scores of the single clip in `clips`. If `methods` is None, load them once per process."""
    entries, facts = [], None
    for trial, filled in filled_trials(clips, config, _loaded(config) if methods is None else methods, shown=shown):
        facts = facts or scored_clip(trial.clip)
        compared = filled_by_all([poses for name, poses in filled.items() if name != "measured"], trial)
        for name, poses in filled.items():
            entry = {"clip": trial.clip.id, "cameras": trial.cameras}
            entry |= score(
                poses, trial.given, trial.truth, trial.actors, trial.matches, fps=trial.clip.fps, compared=compared
            )
            entries.append(((name, len(trial.cameras)), entry))
    return _Scored(trial.clip.id, facts, trial.truth.skeleton.name, entries)


def forecast(config: EvaluateConfig) -> str:
    """Return an estimate of the time that `evaluate` takes, from short pieces of some clips. Raises as `evaluate`."""
    methods, clips = _methods(config), _clips(config)
    chosen = sorted({0, len(clips) // 2, len(clips) - 1})
    seconds, frames, lengths = 0.0, 0, []
    for index in chosen:
        clip = clips[index]
        # Poses made elsewhere cover whole clips.
        piece = clip if config.poses else clip.select(frames=range(min(_TRIED, len(clip))))
        one = clips.part(range(clips.numbers[index], clips.numbers[index] + 1)) if config.poses else [piece]
        start = time.perf_counter()
        _score_clip(config, one, methods, False)
        seconds += time.perf_counter() - start
        frames += len(piece)
        lengths.append(len(clip))
    total = len(clips) * sum(lengths) / len(lengths)
    with running_on(config.backend):
        took = seconds / frames * total / min(process_count(config.workers), len(clips))
    return f"{counted(len(clips), 'clip')}, {total:.0f} frames: about {duration(took)}"


def _clips(config: EvaluateConfig) -> Clips:
    clips = load(config.data)
    if not clips:
        raise ValueError(f"{config.data.path}: no clip of this data set is ok, nothing to score")
    return clips.part(config.numbers(len(clips)))


def _methods(config: EvaluateConfig) -> Methods:
    return {} if config.poses else load_methods(config)


_in_this_process: dict[tuple, Methods] = {}
"""The methods that this process has loaded."""


def _loaded(config: EvaluateConfig) -> Methods:
    key = (*config.methods, config.weights, config.poses)
    if key not in _in_this_process:
        _in_this_process.clear()
        _in_this_process[key] = _methods(config)
    return _in_this_process[key]


def load_methods(config: EvaluateConfig) -> Methods:
    """Return the functions of the methods, by name.

    Raises:
        ValueError: the configuration has no methods, or a method is unknown.
    """
    if not config.methods:
        raise ValueError(f"methods=[]: expected some of {[*completion_method]}")
    weights = Path(config.weights) if config.weights else None
    return {name: find_method(name).load(weights) for name in config.methods}
