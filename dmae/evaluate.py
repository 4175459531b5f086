"""Clips x camera subsets x methods -> scores."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path

import numpy as np

from dmae import metrics
from dmae.baselines import METHODS, smooth
from dmae.capture import CaptureConfig, capture
from dmae.clip import Clip, Poses3D
from dmae.data import DataConfig, Format, load, subsets
from dmae.hiding import HidingConfig
from dmae.mapping import convert
from dmae.progress import progress
from dmae.punch import disturb, punch
from dmae.rng import Stream, generator
from dmae.scores import score, summary
from dmae.skeleton import get_skeleton
from dmae.stream import replayed

PUBLISHED_ACTORS = (0, 1, 2)
"""Of Shelf's four actors the three that published averages are over."""

_SURE_VIEWS = 3
"""A joint that all cameras measured from so many views is taken for true where there is no truth."""

LEARNED = ("dmae", "dmae_reject", "dmae_denoise", "dmae_online")
"""Methods that take weights: `dmae complete` as it is by default, with `reject=true`, with `denoise=true` besides, and
with `online=true`."""


class Hide(StrEnum):
    """What is hidden of what methods are given."""

    none = "none"
    """What the cameras did not see: detections are captured."""
    clean = "clean"
    """Bursts of body parts, of the truth."""
    noisy = "noisy"
    """Those, and what is left is disturbed as capture would have (`dmae.punch.disturb`)."""


class Reference(StrEnum):
    """What is taken for true."""

    truth = "truth"
    capture = "capture"
    """Joints that all cameras measured from three views or more: real holes, and no annotation needed."""


@dataclass(frozen=True)
class EvaluateConfig:
    """What is scored, and how."""

    data: DataConfig = field(default_factory=DataConfig)
    capture: CaptureConfig = field(default_factory=CaptureConfig)
    methods: list[str] = field(default_factory=lambda: [*METHODS])
    """What is done about joints that no camera measured: names of `dmae.baselines.METHODS` and `LEARNED`."""
    weights: str | None = None
    """For `LEARNED` methods: what `dmae train` wrote; by default the weights that come with the package."""
    views: list[int] = field(default_factory=list)
    """With how many cameras: all subsets of each size; by default all cameras only."""
    hide: Hide = Hide.none
    hiding: HidingConfig = field(default_factory=HidingConfig)
    """Where `hide` is not none: `bursts`, `longest` and `absence`."""
    seed: int = 0
    """Of what is hidden and disturbed."""
    reference: Reference = Reference.truth
    skeleton: str | None = None
    """On which poses are compared; by default that of the truth."""
    smooth: float = 0.1
    """s of smoothing, see `dmae.baselines.smooth`, after every method but `measured`."""
    out: str = "runs/evaluate"


@dataclass(frozen=True)
class Trial:
    """What methods are tried on.

    Attributes:
        clip: Id, `cameras`: views used, none where the truth was punched; `fps`.
        given: Poses with holes.
        truth: What is true, on a skeleton that `given` can be converted to.
        actors: True persons that PCP averages over; None: all.
        matches: (F, T) which given person is which true one; None: whichever is nearest.
    """

    clip: str
    cameras: list[int]
    fps: float
    given: Poses3D
    truth: Poses3D
    actors: tuple[int, ...] | None = None
    matches: np.ndarray | None = None


def evaluate(config: EvaluateConfig) -> dict:
    """Apply every method to every clip, captured with every subset of cameras or punched, and score the results.

    Poses are compared on `skeleton`, or else that of the truth; of a fused one (`body25+shelf14`) its second part.
    Where the truth is punched (`hide`) or captured (`reference`), that is on the skeleton of the detections, if the
    truth has it. Scores are averaged over clips, then over subsets; errors by length of gap are over the joints that
    all methods filled, but for `measured`, so that none is the better for leaving out what is hard.

    Returns:
        JSON-able; None stands for a score of nothing. `recording`; `skeleton`; `results`, one entry for each method and
        number of views (0 where the truth was punched): `method`, `views`, `mean` of the scores, `worst` (`pcp` and
        `cameras` of the subset with the lowest PCP) and `runs`, the scores of each clip and subset, as of `score`.

    Raises:
        ValueError: a clip has no truth, there are no clips or methods, no such number of views, or options exclude
            each other.
        KeyError: no such method.
    """
    methods = _methods(config)
    clips = load(config.data)
    if not clips:
        raise ValueError(f"{config.data.path}: no clip of this data set is ok, nothing to score")
    total = len(clips) * (1 if config.hide != Hide.none else len(subsets(clips[0], config.views)))
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
    return {"recording": recording, "skeleton": skeleton.name, "results": results}


def _trials(clips: Iterable[Clip], config: EvaluateConfig) -> Iterator[Trial]:
    if config.skeleton and (config.hide != Hide.none or config.reference != Reference.truth):
        raise ValueError(
            f"skeleton={config.skeleton}: with hide or reference=capture poses are compared as they were detected; "
            "leave it out"
        )
    if config.hide != Hide.none:
        if config.views or config.reference != Reference.truth:
            raise ValueError(
                f"hide={config.hide} hides some of the truth and captures nothing; leave out views, reference"
            )
        yield from (_punched(clip, number, config) for number, clip in enumerate(clips))
        return
    for clip in clips:
        if config.reference == Reference.capture:
            if not config.views or max(config.views) >= len(clip.rig):
                raise ValueError(
                    f"reference=capture compares fewer cameras with all {len(clip.rig)} of clip {clip.id!r}; "
                    f"expected views=[{len(clip.rig) - 1}] or less, found {list(config.views)}"
                )
            whole = capture(clip, config.capture)
            sure = whole.views >= _SURE_VIEWS
            truth = Poses3D(whole.skeleton, np.where(sure[..., None], whole.xyz, np.nan), cov=whole.cov)
        else:
            truth = convert(_truth(clip), get_skeleton(config.skeleton or clip.truth.skeleton.parts[-1].name))
        shelf = config.reference == Reference.truth and clip.provenance.get("format") == Format.shelf
        for cameras in subsets(clip, config.views):
            captured = capture(clip.select(views=cameras), config.capture)
            yield Trial(clip.id, cameras, clip.fps, captured, truth, PUBLISHED_ACTORS if shelf else None)


def _punched(clip: Clip, number: int, config: EvaluateConfig) -> Trial:
    truth, wanted = _truth(clip), clip.detections.skeleton
    truth = convert(truth, wanted if wanted.name in truth.skeleton.name.split("+") else truth.skeleton)
    rng = generator(config.seed, number, Stream.STRESS)
    given = punch(truth, clip.fps, config.hiding, rng=rng)
    if config.hide == Hide.noisy:
        given = disturb(given, clip.fps, rng=rng)
    matches = np.tile(np.arange(truth.xyz.shape[1]), (len(clip), 1))
    return Trial(clip.id, [], clip.fps, given, truth, matches=matches)


def _truth(clip: Clip) -> Poses3D:
    if clip.truth is None:
        raise ValueError(f"clip {clip.id!r} has no truth to score against")
    if np.isinf(clip.truth.xyz).any():
        raise ValueError(f"clip {clip.id!r}: its truth has infinite coordinates; what is not known must be NaN")
    return clip.truth


def _filled_by_all(filled: list[Poses3D], trial: Trial) -> np.ndarray:
    """(F, T, J) True for joints of true persons that all these poses have, where they all match the same person."""
    there = np.ones(trial.truth.source.shape, bool)
    given = trial.matches
    matches = [metrics.match(poses.xyz, trial.truth.xyz) if given is None else given for poses in filled]
    for poses, match in zip(filled, matches, strict=True):
        there &= ~np.isnan(metrics.take_matched(poses.xyz, match)).any(-1) & (match == matches[0])[..., None]
    return there


def _methods(config: EvaluateConfig) -> dict[str, Callable[[Poses3D, float], Poses3D]]:
    """The methods asked for."""
    if not config.methods:
        raise ValueError(f"methods=[]: expected some of {[*METHODS, *LEARNED]}")
    methods = {}
    for name in config.methods:
        if name in LEARNED:
            methods[name] = _learned(name, Path(config.weights) if config.weights else None)
        elif name in METHODS:
            methods[name] = METHODS[name]
        else:
            raise KeyError(f"no method {name!r}; there are {[*METHODS, *LEARNED]}")
    return methods


def _learned(name: str, weights: Path | None) -> Callable[[Poses3D, float], Poses3D]:
    from dmae.complete import completers

    completer_for = completers(weights, reject=name in ("dmae_reject", "dmae_denoise"), denoise=name == "dmae_denoise")
    if name == "dmae_online":
        return lambda poses, fps: replayed(completer_for(poses.skeleton), poses, fps)
    return lambda poses, fps: completer_for(poses.skeleton)(poses, fps)
