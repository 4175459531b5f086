"""Score methods of completion over clips and subsets of cameras."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path

import numpy as np

from dmae.completion.methods.registry import completion_method, find_method
from dmae.data.clip import Clip, Poses3D
from dmae.data.rng import Stream, generator
from dmae.data.skeleton import get_skeleton
from dmae.data.skeleton_conversion import convert
from dmae.evaluation.scores import score, summary
from dmae.evaluation.synthetic_gaps import GapConfig, cut_gaps, perturb
from dmae.formats.reading import DataConfig, load
from dmae.formats.recordings.selection import camera_subsets
from dmae.metrics.matching import match, take_matched
from dmae.numerics.filling import smooth
from dmae.progress import progress
from dmae.reconstruction.config import CaptureConfig
from dmae.reconstruction.pipeline import capture

PUBLISHED_ACTORS = (0, 1, 2)
"""The three of Shelf's four actors that published averages are over."""

_REFERENCE_VIEWS = 3
"""A joint that all cameras measured in at least this many views counts as true with `reference=capture`."""


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
    """s; smoothing after every method except `measured`."""
    out: str = "runs/evaluate"
    """Folder for `scores.json`."""


@dataclass(frozen=True)
class Trial:
    """Poses with gaps, and the truth about them.

    Attributes:
        clip: Id.
        cameras: Views used; none where the gaps are synthetic.
        fps: Frames per second.
        given: Poses with gaps.
        truth: True poses, on a skeleton that `given` can be converted to.
        actors: True persons that PCP is averaged over; None for all.
        matches: (F, T) index of the given person that is each true one; None for the assignment at the least distance.
    """

    clip: str
    cameras: list[int]
    fps: float
    given: Poses3D
    truth: Poses3D
    actors: tuple[int, ...] | None = None
    matches: np.ndarray | None = None


def evaluate(config: EvaluateConfig) -> dict:
    """Apply every method to every clip, captured with every subset of cameras or with synthetic gaps, and score it.

    Poses are compared on `skeleton`, or else on that of the truth; of a fused one (`body25+shelf14`) on its second
    part. With synthetic gaps (`input`) or `reference=capture` they are compared on the skeleton of the detections, if
    the truth has it. Scores are averaged over clips, then over subsets. Errors by length of gap are over the joints
    that all methods but `measured` filled, so that no method gains by leaving out difficult ones.

    Returns:
        JSON-able; None stands for a score of nothing. `recording`; `skeleton`; `poses`, the input in words; `results`,
        one entry for each method and number of views (0 with synthetic gaps): `method`, `views`, `mean` of the scores,
        `intervals` (95 %, over blocks of time, of `pcp`, %, and of `mpjpe` and `hidden`, mm),
        `worst` (`pcp` and `cameras` of the subset with the lowest PCP) and `runs`, the scores of each clip and subset,
        as `score` returns them.

    Raises:
        ValueError: a clip has no truth, there are no clips or methods, no such method or number of views, or options
            exclude each other.
    """
    methods = _methods(config)
    clips = load(config.data)
    if not clips:
        raise ValueError(f"{config.data.path}: no clip of this data set is ok, nothing to score")
    synthetic = config.input != Input.captured_poses
    total = len(clips) * (1 if synthetic else len(camera_subsets(clips[0], config.views)))
    runs: dict[tuple[str, int], list[dict]] = {}
    for trial in progress(_trials(clips, config), "evaluating", total):
        skeleton = trial.truth.skeleton
        filled = {name: convert(method(trial.given, trial.fps), skeleton) for name, method in methods.items()}
        filled |= {
            name: smooth(poses, trial.fps, config.smooth) for name, poses in filled.items() if name != "measured"
        }
        compared = _filled_by_all([poses for name, poses in filled.items() if name != "measured"], trial)
        for name, poses in filled.items():
            entry = {"clip": trial.clip, "cameras": trial.cameras}
            entry |= score(
                poses, trial.given, trial.truth, trial.actors, trial.matches, fps=trial.fps, compared=compared
            )
            runs.setdefault((name, len(trial.cameras)), []).append(entry)
    results = [{"method": name, "views": views, **summary(entries)} for (name, views), entries in runs.items()]
    recording = trial.clip if len(clips) == 1 else f"{len(clips)} clips of {Path(config.data.path).name}"
    poses = Input(config.input).value.replace("_", " ")
    return {"recording": recording, "skeleton": skeleton.name, "poses": poses, "results": results}


def _trials(clips: Iterable[Clip], config: EvaluateConfig) -> Iterator[Trial]:
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
    for number, clip in enumerate(clips):
        if synthetic:
            yield _synthetic_trial(clip, number, config)
        else:
            yield from _captured_trials(clip, config)


def _synthetic_trial(clip: Clip, number: int, config: EvaluateConfig) -> Trial:
    truth, wanted = _truth(clip), clip.detections.skeleton
    truth = convert(truth, wanted if wanted.name in truth.skeleton.name.split("+") else truth.skeleton)
    rng = generator(config.seed, number, Stream.STRESS)
    given = cut_gaps(truth, clip.fps, config.gaps, rng=rng)
    if config.input == Input.perturbed_poses:
        given = perturb(given, clip.fps, rng=rng)
    matches = np.tile(np.arange(truth.xyz.shape[1]), (len(clip), 1))
    return Trial(clip.id, [], clip.fps, given, truth, matches=matches)


def _captured_trials(clip: Clip, config: EvaluateConfig) -> Iterator[Trial]:
    actors = None
    if config.reference == ReferencePoses.capture:
        truth = _measured_by_all(clip, config)
    else:
        truth = convert(_truth(clip), get_skeleton(config.skeleton or clip.truth.skeleton.parts[-1].name))
        if clip.provenance.get("format") == "shelf":
            actors = PUBLISHED_ACTORS
    for cameras in camera_subsets(clip, config.views):
        captured = capture(clip.select(views=cameras), config.capture)
        yield Trial(clip.id, cameras, clip.fps, captured, truth, actors)


def _measured_by_all(clip: Clip, config: EvaluateConfig) -> Poses3D:
    """Return the joints that all cameras of a clip measured in `_REFERENCE_VIEWS` or more."""
    if not config.views or max(config.views) >= len(clip.rig):
        raise ValueError(
            f"reference=capture compares fewer cameras with all {len(clip.rig)} of clip {clip.id!r}; "
            f"expected views=[{len(clip.rig) - 1}] or less, found {list(config.views)}"
        )
    whole = capture(clip, config.capture)
    known = whole.views >= _REFERENCE_VIEWS
    return Poses3D(whole.skeleton, np.where(known[..., None], whole.xyz, np.nan), cov=whole.cov)


def _truth(clip: Clip) -> Poses3D:
    if clip.truth is None:
        raise ValueError(f"clip {clip.id!r} has no truth to score against")
    if np.isinf(clip.truth.xyz).any():
        raise ValueError(f"clip {clip.id!r}: its truth has infinite coordinates; joints that are not known must be NaN")
    return clip.truth


def _filled_by_all(filled: list[Poses3D], trial: Trial) -> np.ndarray:
    """(F, T, J) True for joints of true persons that all these poses have, where they all match the same person."""
    common = np.ones(trial.truth.source.shape, bool)
    given = trial.matches
    matches = [match(poses.xyz, trial.truth.xyz) if given is None else given for poses in filled]
    for poses, found in zip(filled, matches, strict=True):
        common &= ~np.isnan(take_matched(poses.xyz, found)).any(-1) & (found == matches[0])[..., None]
    return common


def _methods(config: EvaluateConfig) -> dict[str, Callable[[Poses3D, float], Poses3D]]:
    """Return the methods by name."""
    if not config.methods:
        raise ValueError(f"methods=[]: expected some of {[*completion_method]}")
    weights = Path(config.weights) if config.weights else None
    return {name: find_method(name).load(weights) for name in config.methods}
