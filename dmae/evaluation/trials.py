"""Trials: poses with gaps, the same poses filled by methods, and their truth."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dmae.completion.blending import noisiness, smooth_by_noise
from dmae.completion.methods.registry import completion_method, find_method
from dmae.data.clip import Clip, Poses3D, Source
from dmae.data.conversion import convert, scale_of
from dmae.data.rng import Stream, generator
from dmae.data.skeleton import Skeleton, get_skeleton
from dmae.evaluation.config import EvaluateConfig, Input, ReferencePoses
from dmae.evaluation.predictions import predictions_of, read_prediction
from dmae.evaluation.reference import measured_by_all, scored_actors, truth_of
from dmae.evaluation.synthetic_gaps import cut_gaps, perturb
from dmae.formats.recordings.selection import camera_subsets
from dmae.metrics.matching import GATE, match, take_matched
from dmae.progress import progress
from dmae.reconstruction.pipeline import capture

HANDED_IN = "poses"
"""Method name of poses made elsewhere in the results."""


@dataclass(frozen=True)
class Trial:
    """Poses with gaps, and their truth.

    Attributes:
        clip: The clip of the poses.
        cameras: Indices of the views used; empty if the gaps are synthetic.
        given: Poses with gaps.
        truth: True poses, on a skeleton to which `given` can be converted.
        actors: True persons over which PCP is averaged; None for all.
        matches: (F, T) index of the given person that matches each true person; None to match by smallest distance.
        filled: Poses made elsewhere, to be scored; None if methods fill `given`.
    """

    clip: Clip
    cameras: list[int]
    given: Poses3D
    truth: Poses3D
    actors: tuple[int, ...] | None = None
    matches: np.ndarray | None = None
    filled: Poses3D | None = None


def filled_trials(
    clips: Sequence[Clip],
    config: EvaluateConfig,
    methods: dict[str, Callable[[Poses3D, float], Poses3D]],
    to_skeleton: Callable[[Poses3D, Skeleton], Poses3D] = convert,
    shown: bool = True,
) -> Iterator[tuple[Trial, dict[str, Poses3D]]]:
    """Yield every trial with the poses that each method fills, smoothed and on the skeleton of the truth.

    Args:
        clips: At least one clip.
        config: The options. Its fields `data`, `methods` and `weights` are not used.
        methods: Functions that fill poses, by name. Poses of methods that smooth by themselves are not smoothed again.
        to_skeleton: Function that converts filled poses to the skeleton of the truth.
        shown: Whether to show progress.
    """
    trials = _trials(clips, config)
    if shown:
        captured = config.input == Input.captured_poses and not config.poses
        total = len(clips) * (len(camera_subsets(clips[0], config.views)) if captured else 1)
        trials = progress(trials, "evaluating", total)
    for trial in trials:
        filled = {}
        for name, fill in methods.items():
            poses = fill(trial.given, trial.clip.fps)
            if not (name in completion_method and find_method(name).smooths):
                poses = smooth_by_noise(poses, noisiness(trial.given), trial.clip.fps, config.smooth)
            filled[name] = to_skeleton(poses, trial.truth.skeleton)
        yield trial, filled | ({} if trial.filled is None else {HANDED_IN: trial.filled})


def _trials(clips: Sequence[Clip], config: EvaluateConfig) -> Iterator[Trial]:
    synthetic = config.input != Input.captured_poses
    if config.skeleton and (synthetic or config.reference != ReferencePoses.truth):
        raise ValueError(
            f"skeleton={config.skeleton}: with input={Input.true_poses}, input={Input.perturbed_poses} or "
            "reference=capture poses are compared on the skeleton of the detections; leave it out"
        )
    if synthetic and (config.views or config.reference != ReferencePoses.truth):
        raise ValueError(
            f"input={config.input} has synthetic gaps in the truth, and nothing is captured; leave out views, reference"
        )
    if config.poses and (config.views or config.reference != ReferencePoses.truth):
        raise ValueError(
            f"poses={config.poses}: poses made elsewhere are compared with the truth, whatever cameras they are of; "
            "leave out views, reference"
        )
    # A plain list of clips is not part of a larger data set.
    total, numbers = getattr(clips, "total", len(clips)), getattr(clips, "numbers", range(len(clips)))
    ids = [folder.name for folder in clips.folders] if total > 1 else [clips[0].id]
    paths = predictions_of(Path(config.poses), clips.names if total > 1 else ids) if config.poses else {}
    for number, clip, name in zip(numbers, clips, ids, strict=True):
        path = paths.get(name)
        if synthetic:
            yield _synthetic_trial(clip, number, config, path)
        elif path:
            yield _predicted_trial(clip, config, path)
        else:
            yield from _captured_trials(clip, config)


def _synthetic_trial(clip: Clip, number: int, config: EvaluateConfig, path: Path | None) -> Trial:
    truth, wanted = truth_of(clip), clip.detections.skeleton
    truth = convert(truth, wanted if wanted in truth.skeleton.parts else truth.skeleton)
    rng = generator(config.seed, number, Stream.STRESS)
    given = cut_gaps(truth, clip.fps, config.gaps, rng=rng)
    if config.input == Input.perturbed_poses:
        given = perturb(given, clip.fps, rng=rng)
    matches = np.tile(np.arange(truth.xyz.shape[1]), (len(clip), 1))
    filled = read_prediction(path, clip, truth, tracks=True) if path else None
    return Trial(clip, [], given, truth, matches=matches, filled=filled)


def _predicted_trial(clip: Clip, config: EvaluateConfig, path: Path) -> Trial:
    """Return the trial of poses made elsewhere. Joints that they mark as completed count as hidden."""
    truth = _compared_truth(clip, config)
    filled = read_prediction(path, clip, truth)
    given = filled.without(filled.source == Source.COMPLETED)
    return Trial(clip, [*range(len(clip.rig))], given, truth, scored_actors(clip), filled=filled)


def _compared_truth(clip: Clip, config: EvaluateConfig) -> Poses3D:
    truth = truth_of(clip)
    return convert(truth, get_skeleton(config.skeleton) if config.skeleton else truth.skeleton.parts[-1])


def _captured_trials(clip: Clip, config: EvaluateConfig) -> Iterator[Trial]:
    actors = None
    if config.reference == ReferencePoses.capture:
        _check_fewer_views(clip, config)
        truth = measured_by_all(clip, config.capture)
    else:
        truth, actors = _compared_truth(clip, config), scored_actors(clip)
    for cameras in camera_subsets(clip, config.views):
        captured = capture(clip.select(views=cameras), config.capture)
        yield Trial(clip, cameras, captured, truth, actors)


def _check_fewer_views(clip: Clip, config: EvaluateConfig) -> None:
    """Raise ValueError unless all requested numbers of cameras are smaller than the number of cameras of the clip."""
    if not config.views or max(config.views) >= len(clip.rig):
        raise ValueError(
            f"reference=capture compares fewer cameras with all {len(clip.rig)} of clip {clip.id!r}; "
            f"expected views=[{len(clip.rig) - 1}] or less, found {list(config.views)}"
        )


def filled_by_all(filled: list[Poses3D], trial: Trial) -> np.ndarray:
    """Return (F, T, J) True for the joints of true persons that all poses contain.

    All poses must also match the true person with the same person.
    """
    common = np.ones(trial.truth.source.shape, bool)
    given = trial.matches
    gate = scale_of(trial.truth) * GATE
    matches = [match(poses.xyz, trial.truth.xyz, gate) if given is None else given for poses in filled]
    for poses, found in zip(filled, matches, strict=True):
        common &= ~np.isnan(take_matched(poses.xyz, found)).any(-1) & (found == matches[0])[..., None]
    return common
