"""Score methods of completion over clips and subsets of cameras.

A trial is poses with gaps and their truth: captured with some of the cameras, or true poses with synthetic gaps.
`filled_trials` has each method fill them, and `evaluate` scores what comes out.
"""

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain, pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np

from dmae.completion.features import noisiness, smooth_by_noise
from dmae.completion.methods import completion_method, find_method
from dmae.data.clip import Clip, Poses3D, Source
from dmae.data.conversion import convert, scale_of
from dmae.data.rng import Stream, generator
from dmae.data.skeleton import Skeleton
from dmae.evaluation.config import INSTEAD, SCORED, EvaluateConfig, Input, ReferencePoses
from dmae.evaluation.gates import scored_clip, scored_options
from dmae.evaluation.predictions import predictions_of, read_prediction
from dmae.evaluation.scores import compared_truth, measured_by_all, score, scored_actors, summary, truth_of
from dmae.evaluation.synthetic_gaps import cut_gaps, perturb
from dmae.formats.config import clip_range
from dmae.formats.reading import Clips, camera_subsets
from dmae.metrics.angles import leg_angles
from dmae.metrics.comparison import GATE, match, take_matched
from dmae.parallel import in_parallel, process_count, running_on
from dmae.progress import duration, progress
from dmae.reconstruction.pipeline import capture
from dmae.reporting.tables import counted

Methods = dict[str, Callable[[Poses3D, float], Poses3D]]
"""Functions that fill poses, by name."""
HANDED_IN = "poses"
"""Method name of poses made elsewhere in the results."""


@dataclass(frozen=True)
class Trial:
    """Poses with gaps, and their truth."""

    clip: Clip  # The clip of the poses
    cameras: list[int]  # Indices of the views used; empty if the gaps are synthetic
    given: Poses3D  # Poses with gaps
    truth: Poses3D  # True poses, on a skeleton to which `given` can be converted
    actors: tuple[int, ...] | None = None  # True persons over which PCP is averaged; None for all
    # (F, T) index of the given person that matches each true person; None to match by smallest distance
    matches: np.ndarray | None = None
    filled: Poses3D | None = None  # Poses made elsewhere, to be scored; None if methods fill `given`


def filled_trials(
    clips: Sequence[Clip],
    config: EvaluateConfig,
    methods: Methods,
    to_skeleton: Callable[[Poses3D, Skeleton], Poses3D] = convert,
    shown: bool = True,
    first: int = 0,
    handed_in: Path | None = None,
) -> Iterator[tuple[Trial, dict[str, Poses3D]]]:
    """Yield every trial with the poses that each method fills (`filled_by`), on the skeleton of the truth.

    `to_skeleton` converts filled poses. `first`: number of the first clip in its data set, from which synthetic gaps
    are drawn. `handed_in`: path of poses that were made elsewhere. The fields `data`, `methods`, `poses` and `weights`
    of the configuration are not used.
    """
    trials: Iterator[Trial] = chain.from_iterable(
        _trials(clip, n, config, handed_in) for n, clip in enumerate(clips, first)
    )
    if shown:
        captured = config.input == Input.captured_poses and not handed_in
        total = len(clips) * (len(camera_subsets(clips[0], config.views)) if captured else 1)
        trials = progress(trials, "evaluating", total)
    for trial in trials:
        filled = {}
        for name, fill in methods.items():
            poses = filled_by(name, fill, trial.given, trial.clip.fps, config.smooth)
            filled[name] = to_skeleton(poses, trial.truth.skeleton)
        yield trial, filled | ({} if trial.filled is None else {HANDED_IN: trial.filled})


def filled_by(
    name: str, fill: Callable[[Poses3D, float], Poses3D], given: Poses3D, fps: float, smooth: float
) -> Poses3D:
    """Return poses that a method filled, smoothed over `smooth` s unless the method smooths by itself.

    Raises ValueError if it returned poses of another shape.
    """
    filled = fill(given, fps)
    if filled.xyz.shape[:2] != given.xyz.shape[:2]:
        raise ValueError(
            f"method {name}: expected poses of {given.xyz.shape[1]} persons in {len(given.xyz)} frames back, found "
            f"{filled.xyz.shape[1]} in {len(filled.xyz)}"
        )
    if name in completion_method and find_method(name).smooths:
        return filled
    return smooth_by_noise(filled, noisiness(given, fps), fps, smooth)


def _trials(clip: Clip, number: int, config: EvaluateConfig, path: Path | None) -> Iterator[Trial]:
    if config.input != Input.captured_poses:
        yield _synthetic_trial(clip, number, config, path)
    elif path:
        truth = compared_truth(clip, config.skeleton)
        filled = read_prediction(path, clip, truth)
        # Joints that the poses mark as completed count as hidden.
        given = filled.without(filled.source == Source.COMPLETED)
        yield Trial(clip, [*range(len(clip.rig))], given, truth, scored_actors(clip), filled=filled)
    else:
        yield from _captured_trials(clip, config)


def _synthetic_trial(clip: Clip, number: int, config: EvaluateConfig, path: Path | None) -> Trial:
    truth, wanted = truth_of(clip), clip.detections.skeleton
    truth = convert(truth, wanted if wanted in truth.skeleton.parts else truth.skeleton)
    rng = generator(config.seed, number, Stream.STRESS)
    given = cut_gaps(truth, clip.fps, rng=rng)
    if config.input == Input.perturbed_poses:
        given = perturb(given, clip.fps, rng=rng)
    matches = np.tile(np.arange(truth.xyz.shape[1]), (len(clip), 1))
    filled = read_prediction(path, clip, truth, tracks=True) if path else None
    return Trial(clip, [], given, truth, matches=matches, filled=filled)


def _captured_trials(clip: Clip, config: EvaluateConfig) -> Iterator[Trial]:
    actors = None
    if config.reference == ReferencePoses.capture:
        if not config.views or max(config.views) >= len(clip.rig):
            raise ValueError(
                f"reference=capture compares fewer cameras with all {len(clip.rig)} of clip {clip.id!r}; "
                f"expected views=[{len(clip.rig) - 1}] or less, found {list(config.views)}"
            )
        truth = measured_by_all(clip, config.capture)
    else:
        truth, actors = compared_truth(clip, config.skeleton), scored_actors(clip)
    for cameras in camera_subsets(clip, config.views):
        captured = capture(clip.select(views=cameras), config.capture)
        yield Trial(clip, cameras, captured, truth, actors)


_TRIED = 50  # Number of frames of a clip that a forecast scores


def evaluate(config: EvaluateConfig, clips: Sequence[Clip] | None = None) -> dict:
    """Score every method on every clip, captured with every subset of cameras or with synthetic gaps.

    By default clips are those that the fields `data`, `first` and `clips` choose.

    Poses are compared on `skeleton`, or by default on the skeleton of the truth. If that is a fused one
    (`body25+shelf14`), they are compared on its second part. With synthetic gaps (`input`) or `reference=capture` they
    are compared on the skeleton of the detections, if the truth has it. Scores are averaged over clips, then over
    subsets. Errors by length of gap count only the joints that all methods except `measured` filled, so that no method
    gains by leaving out difficult joints.

    Returns:
        JSON-able. None stands for a score without data. The entries are `recording`; `skeleton`; `poses`, the input in
        words; `options` and `clips`, which identify the scored data, see `dmae.evaluation.gates`; and `results`,
        with one entry for each method and number of views (0 with synthetic gaps): `method`; `views`; `mean` of the
        scores; `intervals` (95 %, over blocks of time) of `pcp`, %, of `mpjpe` and `hidden`, mm, of `recall` of the
        unmeasured joints, %, and of `angles`, degrees, if they are scored; `worst` (`pcp` and `cameras` of the subset
        with the lowest PCP); and `runs`, the scores of each clip and subset as `score` returns them.

    Raises:
        ValueError: a clip has no truth, there are no clips or methods, a method or number of views does not exist,
            two clips have the same id, options exclude each other, or poses made elsewhere do not fit their clip.
        FileNotFoundError: the poses made elsewhere do not exist.
    """
    _check_methods(config)
    if clips is None:
        clips = _clips(config)
    data_set = clips if isinstance(clips, Clips) else None
    numbers = data_set.numbers if data_set else range(len(clips))
    ids = sorted([folder.name for folder in data_set.folders] if data_set else [clip.id for clip in clips])
    if not ids or (twice := [id for id, next_id in pairwise(ids) if id == next_id]):
        found = f"two with the id {twice[0]!r}" if ids else "none"
        raise ValueError(f"expected one clip or more, each with an id of its own; found {found}")
    tasks = ((config, clips[n : n + 1], number, len(clips) == 1) for n, number in enumerate(numbers))
    with running_on(config.backend):
        done = in_parallel(_read_and_score, tasks, config.workers)
        scored = list(done if len(clips) == 1 else progress(done, "evaluating", len(clips)))
    runs: dict[tuple[str, int], list[dict]] = {}
    first = scored[0].facts["cameras"]
    for clip in scored:
        names = clip.facts["cameras"]
        for method, run in clip.runs:
            if {*names} == {*first}:
                # Sessions may list the same cameras in another order: a subset has the numbers of the first clip.
                run["cameras"] = sorted(first.index(names[view]) for view in run["cameras"])
            runs.setdefault((method, len(run["cameras"])), []).append(run)
    results = [{"method": method, "views": views, **summary(each)} for (method, views), each in runs.items()]
    recording = counted(len(clips), "clip") + (f" of {Path(data_set.config.path).name}" if data_set else "")
    if (data_set.total if data_set else len(clips)) == 1:
        recording = scored[-1].id
    poses = f"poses of {Path(config.poses).name}" if config.poses else Input(config.input).value.replace("_", " ")
    return {
        "recording": recording,
        "skeleton": scored[-1].skeleton,
        "poses": poses,
        "options": scored_options(config),
        "clips": {clip.id: clip.facts for clip in scored},
        "results": results,
    }


class _ScoredClip(NamedTuple):
    """The scores of a clip."""

    id: str  # Of the clip
    facts: dict  # Which identify it, see `dmae.evaluation.gates`
    skeleton: str  # Name of the skeleton of the comparison
    runs: list[tuple[str, dict]]  # Method and scores of each run


def _read_and_score(config: EvaluateConfig, clips: Sequence[Clip], number: int, shown: bool) -> _ScoredClip:
    """Score the methods on the one clip, which has this number in its data set."""
    return _score_clip(config, clips, clips[0], number, shown)


def _score_clip(config: EvaluateConfig, clips: Sequence[Clip], clip: Clip, number: int, shown: bool) -> _ScoredClip:
    """Score the methods on the one clip of `clips`, or on a piece of it, with each subset of cameras."""
    handed_in, methods = None, {}
    if not config.poses:
        methods = load_methods(scored_methods(config, clip), config.weights)
    elif isinstance(clips, Clips) and clips.total > 1:
        handed_in = predictions_of(Path(config.poses), clips.names)[clips.folders[0].name]
    else:
        handed_in = predictions_of(Path(config.poses), [clip.id])[clip.id]
    runs = []
    truth = angles = None
    for trial, filled in filled_trials([clip], config, methods, shown=shown, first=number, handed_in=handed_in):
        if config.angles and trial.truth is not truth:
            truth, angles = trial.truth, leg_angles(trial.truth)[0]
        runs += runs_of(trial, filled, angles).items()
    return _ScoredClip(clip.id, scored_clip(clip), trial.truth.skeleton.name, runs)


def runs_of(trial: Trial, filled: dict[str, Poses3D], angles: np.ndarray | None = None) -> dict[str, dict]:
    """Return the scores of each method's poses of a trial, as runs of `dmae.evaluation.scores.run_table`.

    `angles`: true angles from `dmae.metrics.angles.leg_angles`; None to score none.
    """
    compared = _filled_by_all(trial, filled)
    found = {}
    for name, poses in filled.items():
        scores = score(
            poses, trial.given, trial.truth, trial.actors, trial.matches,
            fps=trial.clip.fps, compared=compared, angles=angles,
        )  # fmt: skip
        found[name] = {"clip": trial.clip.id, "cameras": trial.cameras} | scores
    return found


def _filled_by_all(trial: Trial, filled: dict[str, Poses3D]) -> np.ndarray:
    """Return (F, T, J) True for the joints that all methods filled, in the same matched person."""
    compared, first = np.ones(trial.truth.source.shape, bool), None
    for name, poses in filled.items():
        if name != "measured":
            gate = scale_of(trial.truth) * GATE
            found = match(poses.xyz, trial.truth.xyz, gate) if trial.matches is None else trial.matches
            first = found if first is None else first
            compared &= ~np.isnan(take_matched(poses.xyz, found)).any(-1) & (found == first)[..., None]
    return compared


def forecast(config: EvaluateConfig) -> str:
    """Return an estimate of the time that `evaluate` takes, from short pieces of some clips. Raises as `evaluate`."""
    _check_methods(config)
    clips = _clips(config)
    chosen = sorted({0, len(clips) // 2, len(clips) - 1})
    seconds, frames, lengths = 0.0, 0, []
    for index in chosen:
        clip = clips[index]
        # Poses made elsewhere cover whole clips.
        piece = clip if config.poses else clip.select(frames=range(min(_TRIED, len(clip))))
        start = time.perf_counter()
        _score_clip(config, clips[index : index + 1], piece, clips.numbers[index], False)
        seconds += time.perf_counter() - start
        frames += len(piece)
        lengths.append(len(clip))
    total = len(clips) * sum(lengths) / len(lengths)
    with running_on(config.backend):
        took = seconds / max(frames, 1) * total / min(process_count(config.workers), len(clips))
    return f"{counted(len(clips), 'clip')}, {total:.0f} frames: about {duration(took)}"


def _clips(config: EvaluateConfig) -> Clips:
    clips = Clips(config.data)
    numbers = clip_range(len(clips), config.first, config.clips)
    return clips[numbers.start : numbers.stop]


def scored_methods(config: EvaluateConfig, clip: Clip) -> list[str]:
    """Return the methods of a configuration, or the usual ones for the body in the detections of a clip."""
    if config.methods is not None:
        return config.methods
    from dmae.completion.weights import methods_for  # it loads torch, which other methods do not need

    return methods_for(SCORED, clip.detections.skeleton, config.weights)


def _check_methods(config: EvaluateConfig) -> None:
    """Refuse unknown methods, and weights that do not exist, before anything is read."""
    if not config.poses:
        load_methods(SCORED if config.methods is None else config.methods, config.weights)


def load_methods(names: Sequence[str], weights: str | None = None) -> Methods:
    """Return methods by name, or trained weights by their folder's; ValueError if there are none, or one is unknown."""
    if not names:
        raise ValueError(f"methods=[]: expected some of {[*completion_method]}")
    found: Methods = {}
    for name in names:
        if name not in completion_method and (Path(name) / "model.json").is_file():
            short = Path(name).name
            found[name if short in found or short in names else short] = find_method("dmae").load(Path(name))
        elif name in INSTEAD:
            raise ValueError(f"methods: {INSTEAD[name]}")
        else:
            found[name] = find_method(name).load(Path(weights) if weights else None)
    return found
