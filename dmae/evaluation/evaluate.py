"""Score methods of completion over clips and subsets of cameras."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path

import numpy as np

from dmae.completion.methods.registry import completion_method, find_method
from dmae.data.clip import Clip, Poses3D, Source
from dmae.data.rng import Stream, generator
from dmae.data.skeleton import Skeleton, get_skeleton
from dmae.data.skeleton_conversion import convert
from dmae.data.skeletons.size import scale_of
from dmae.evaluation.predictions import predictions_of, read_prediction
from dmae.evaluation.reference import measured_by_all, scored_actors, truth_of
from dmae.evaluation.scored_data import scored_clip, scored_options
from dmae.evaluation.scores import score, summary
from dmae.evaluation.synthetic_gaps import GapConfig, cut_gaps, perturb
from dmae.formats.reading import DataConfig, load
from dmae.formats.recordings.selection import camera_subsets
from dmae.metrics.matching import GATE, match, take_matched
from dmae.numerics.filling import smooth
from dmae.parts import numbers_of
from dmae.progress import progress
from dmae.reconstruction.config import CaptureConfig
from dmae.reconstruction.pipeline import capture

HANDED_IN = "poses"
"""The method by which poses made elsewhere stand in the results."""


class Input(StrEnum):
    """The poses that methods complete."""

    captured_poses = "captured_poses"
    """Captured from the detections, with the gaps that the cameras left."""
    true_poses = "true_poses"
    """True poses with synthetic gaps."""
    perturbed_poses = "perturbed_poses"
    """True poses with synthetic gaps and errors like those of capture."""


class ReferencePoses(StrEnum):
    """The poses that results are compared with."""

    truth = "truth"
    """The true poses of the clip."""
    capture = "capture"
    """Joints that all cameras together measured in three views or more: real gaps, and no annotation needed."""


@dataclass(frozen=True)
class EvaluateConfig:
    """Score methods of completion over clips and subsets of cameras."""

    data: DataConfig = field(default_factory=DataConfig)
    capture: CaptureConfig = field(default_factory=CaptureConfig)
    methods: list[str] = field(
        default_factory=lambda: [name for name, method in completion_method.items() if not method.learned],
        metadata={"choices": completion_method},
    )
    """How joints that no camera measured are filled: completion methods, or module:function of your own."""
    poses: str | None = None
    """Poses made elsewhere, which are scored in place of `methods`: a file, or a folder with one for each clip."""
    weights: str | None = None
    """Folder that `dmae train` wrote, for learned methods; by default the weights that come with the package."""
    views: list[int] = field(default_factory=list)
    """Numbers of cameras: all subsets of each size are scored; by default all cameras only."""
    input: Input = Input.captured_poses
    """Poses that methods complete: captured, or true ones with synthetic gaps, exact or perturbed."""
    gaps: GapConfig = field(default_factory=GapConfig)
    """Synthetic gaps, unless the input is captured poses."""
    seed: int = 0
    """Seed of synthetic gaps and perturbation."""
    reference: ReferencePoses = ReferencePoses.truth
    """Poses that results are compared with: the truth, or what all cameras together measured."""
    skeleton: str | None = None
    """Skeleton that poses are compared on; by default that of the truth."""
    smooth: float = 0.1
    """s; smoothing after every method except `measured` and online ones, which smooth themselves. With it,
    `methods=[dmae_denoise]` scores what `dmae complete` makes."""
    baseline: str | None = None
    """`scores.json` of an earlier run, or its folder: exit status 2 if a figure is worse by more than its interval."""
    changed: list[str] = field(default_factory=list)
    """Options that differ from those of the baseline on purpose; figures are compared all the same."""
    first: int = 0
    """Number of the first clip of the data set, counted from 0."""
    clips: int | None = None
    """Number of clips, of all shards together; by default all from `first` on."""
    shard: str | None = None
    """Which piece of the clips: `shard=3/16` the third of sixteen, in a folder of its own; `dmae merge` joins them."""
    out: str = "runs/evaluate"
    """Folder for `scores.json`."""

    def numbers(self, total: int) -> range:
        """Return the numbers of the clips to score, of all clips of the data set."""
        return numbers_of(total, self.first, self.clips, self.shard)


@dataclass(frozen=True)
class Trial:
    """Poses with gaps, and the truth about them.

    Attributes:
        clip: The clip that they are of.
        cameras: Views used; none where the gaps are synthetic.
        given: Poses with gaps.
        truth: True poses, on a skeleton that `given` can be converted to.
        actors: True persons that PCP is averaged over; None for all.
        matches: (F, T) index of the given person that is each true one; None for the assignment at the least distance.
        filled: Poses made elsewhere that are scored; None where methods fill `given`.
    """

    clip: Clip
    cameras: list[int]
    given: Poses3D
    truth: Poses3D
    actors: tuple[int, ...] | None = None
    matches: np.ndarray | None = None
    filled: Poses3D | None = None


def evaluate(config: EvaluateConfig) -> dict:
    """Apply every method to every clip, captured with every subset of cameras or with synthetic gaps, and score it.

    Poses are compared on `skeleton`, or else on that of the truth; of a fused one (`body25+shelf14`) on its second
    part. With synthetic gaps (`input`) or `reference=capture` they are compared on the skeleton of the detections, if
    the truth has it. Scores are averaged over clips, then over subsets. Errors by length of gap are over the joints
    that all methods but `measured` filled, so that no method gains by leaving out difficult ones.

    Returns:
        JSON-able; None stands for a score of nothing. `recording`; `skeleton`; `poses`, the input in words; `results`,
        one entry for each method and number of views (0 with synthetic gaps): `method`, `views`, `mean` of the scores,
        `intervals` (95 %, over blocks of time, of `pcp`, %, of `mpjpe` and `hidden`, mm, and of `recall`, %, of the
        hidden joints),
        `worst` (`pcp` and `cameras` of the subset with the lowest PCP) and `runs`, the scores of each clip and subset,
        as `score` returns them. `options` and `clips` say what the scores are of, see `dmae.evaluation.scored_data`.

    Raises:
        ValueError: a clip has no truth, there are no clips or methods, no such method or number of views, options
            exclude each other, or poses made elsewhere do not fit their clip.
        FileNotFoundError: there are no such poses.
    """
    methods = {} if config.poses else load_methods(config)
    clips = load(config.data)
    if not clips:
        raise ValueError(f"{config.data.path}: no clip of this data set is ok, nothing to score")
    clips = clips.part(config.numbers(len(clips)))
    runs: dict[tuple[str, int], list[dict]] = {}
    scored: dict[str, dict] = {}
    for trial, filled in filled_trials(clips, config, methods):
        skeleton, fps = trial.truth.skeleton, trial.clip.fps
        if trial.clip.id not in scored:
            scored[trial.clip.id] = scored_clip(trial.clip)
        compared = _filled_by_all([poses for name, poses in filled.items() if name != "measured"], trial)
        for name, poses in filled.items():
            entry = {"clip": trial.clip.id, "cameras": trial.cameras}
            entry |= score(poses, trial.given, trial.truth, trial.actors, trial.matches, fps=fps, compared=compared)
            runs.setdefault((name, len(trial.cameras)), []).append(entry)
    results = [{"method": name, "views": views, **summary(entries)} for (name, views), entries in runs.items()]
    recording = trial.clip.id if clips.total == 1 else f"{len(clips)} clips of {Path(config.data.path).name}"
    poses = f"poses of {Path(config.poses).name}" if config.poses else Input(config.input).value.replace("_", " ")
    return {
        "recording": recording,
        "skeleton": skeleton.name,
        "poses": poses,
        "options": scored_options(config),
        "clips": scored,
        "results": results,
    }


def filled_trials(
    clips: Sequence[Clip],
    config: EvaluateConfig,
    methods: dict[str, Callable[[Poses3D, float], Poses3D]],
    to_skeleton: Callable[[Poses3D, Skeleton], Poses3D] = convert,
) -> Iterator[tuple[Trial, dict[str, Poses3D]]]:
    """Yield every trial, and what each method makes of it: smoothed, and on the skeleton of the truth.

    Args:
        clips: At least one.
        config: Of its fields `data`, `methods` and `weights` are not read.
        methods: Functions that fill poses, by name. What methods that smooth themselves return is not smoothed.
        to_skeleton: Brings filled poses to the skeleton of the truth.
    """
    captured = config.input == Input.captured_poses and not config.poses
    total = len(clips) * (len(camera_subsets(clips[0], config.views)) if captured else 1)
    for trial in progress(_trials(clips, config), "evaluating", total):
        filled = {}
        for name, fill in methods.items():
            poses = fill(trial.given, trial.clip.fps)
            if not (name in completion_method and find_method(name).smooths):
                poses = smooth(poses, trial.clip.fps, config.smooth)
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
    # A list of clips is of no larger data set.
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
    """Return poses made elsewhere; what they mark as completed was hidden."""
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
    """Raise ValueError unless all numbers of cameras are smaller than that of the clip."""
    if not config.views or max(config.views) >= len(clip.rig):
        raise ValueError(
            f"reference=capture compares fewer cameras with all {len(clip.rig)} of clip {clip.id!r}; "
            f"expected views=[{len(clip.rig) - 1}] or less, found {list(config.views)}"
        )


def _filled_by_all(filled: list[Poses3D], trial: Trial) -> np.ndarray:
    """(F, T, J) True for joints of true persons that all these poses have, where they all match the same person."""
    common = np.ones(trial.truth.source.shape, bool)
    given = trial.matches
    gate = scale_of(trial.truth) * GATE
    matches = [match(poses.xyz, trial.truth.xyz, gate) if given is None else given for poses in filled]
    for poses, found in zip(filled, matches, strict=True):
        common &= ~np.isnan(take_matched(poses.xyz, found)).any(-1) & (found == matches[0])[..., None]
    return common


def load_methods(config: EvaluateConfig) -> dict[str, Callable[[Poses3D, float], Poses3D]]:
    """Return the functions of the methods by name.

    Raises:
        ValueError: there are none, or one is unknown.
    """
    if not config.methods:
        raise ValueError(f"methods=[]: expected some of {[*completion_method]}")
    weights = Path(config.weights) if config.weights else None
    return {name: find_method(name).load(weights) for name in config.methods}
