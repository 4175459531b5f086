"""Clips x camera subsets x methods -> scores."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from itertools import combinations
from pathlib import Path

import numpy as np

from dmae import metrics
from dmae.baselines import METHODS, smooth
from dmae.capture import CaptureConfig, capture
from dmae.clip import Clip, Poses3D, Source
from dmae.data import DataConfig, Format, load
from dmae.mapping import convert
from dmae.progress import progress
from dmae.skeleton import get_skeleton

PUBLISHED_ACTORS = (0, 1, 2)
"""Of Shelf's four actors the three that published averages are over."""


@dataclass(frozen=True)
class EvaluateConfig:
    """What is scored, and how."""

    data: DataConfig = field(default_factory=DataConfig)
    capture: CaptureConfig = field(default_factory=CaptureConfig)
    methods: list[str] = field(default_factory=lambda: ["measured", "linear", "bodyframe"])
    """What is done about joints that no camera measured: names of `dmae.baselines.METHODS`, or `dmae`."""
    weights: str | None = None
    """For the method `dmae`: what `dmae train` wrote."""
    views: list[int] = field(default_factory=list)
    """With how many cameras: all subsets of each size; by default all cameras only."""
    smooth: float = 0.1
    """s of smoothing, see `dmae.baselines.smooth`, after every method but `measured`."""
    out: str = "runs/evaluate"


def evaluate(config: EvaluateConfig) -> dict:
    """Capture every clip with every subset of cameras, apply every method, score against the truth.

    Poses are compared on the skeleton of the truth; of a fused truth (`body25+shelf14`) on its second part.
    Scores are averaged over clips, then over subsets.

    Returns:
        JSON-able; None stands for a score of nothing. `recording`; `skeleton`; `results`, one entry for each method and
        number of views: `method`, `views`, `mean` of the scores, `worst` (`pcp` and `cameras` of the subset
        with the lowest PCP) and `runs`, the scores of each clip and subset, as of `score`.

    Raises:
        ValueError: a clip has no truth, there are no clips or methods, or no such number of views.
        KeyError: no such method.
    """
    methods = _methods(config)
    clips = load(config.data)
    if not clips:
        raise ValueError(f"{config.data.path}: no clip of this data set is ok, nothing to score")
    total = len(clips) * len(_subsets(clips[0], config.views))
    runs: dict[tuple[str, int], list[dict]] = {}
    for clip, cameras in progress(_jobs(clips, config.views), "evaluating", total):
        truth = convert(clip.truth, get_skeleton(clip.truth.skeleton.name.split("+")[-1]))
        captured = capture(clip.select(views=cameras), config.capture)
        for name, method in methods.items():
            entry = {"clip": clip.id, "cameras": cameras}
            actors = PUBLISHED_ACTORS if clip.provenance.get("format") == Format.shelf else None
            poses = convert(method(captured, clip.fps), truth.skeleton)
            if name != "measured":
                poses = smooth(poses, clip.fps, config.smooth)
            entry |= score(poses, captured, truth, actors)
            runs.setdefault((name, len(cameras)), []).append(entry)
    results = [{"method": name, "views": views, **summary(entries)} for (name, views), entries in runs.items()]
    recording = clip.id if len(clips) == 1 else f"{len(clips)} clips of {Path(config.data.path).name}"
    return {"recording": recording, "skeleton": truth.skeleton.name, "results": results}


def _jobs(clips: Iterable[Clip], sizes: list[int]) -> Iterator[tuple[Clip, list[int]]]:
    for clip in clips:
        if clip.truth is None:
            raise ValueError(f"clip {clip.id!r} has no truth to score against")
        for cameras in _subsets(clip, sizes):
            yield clip, cameras


def _subsets(clip: Clip, sizes: list[int]) -> list[list[int]]:
    views = len(clip.rig)
    sizes = list(dict.fromkeys(sizes)) or [views]
    if not all(2 <= size <= views for size in sizes):
        raise ValueError(f"views={sizes}: expected numbers from 2 to {views}, the cameras of clip {clip.id!r}")
    return [list(cameras) for size in sizes for cameras in combinations(range(views), size)]


def _methods(config: EvaluateConfig) -> dict[str, Callable[[Poses3D, float], Poses3D]]:
    """The methods asked for."""
    if not config.methods:
        raise ValueError(f"methods=[]: expected some of {[*METHODS, 'dmae']}")
    methods = {}
    for name in config.methods:
        if name == "dmae":
            if config.weights is None:
                raise ValueError("method 'dmae' needs weights: weights=<folder that dmae train wrote>")
            from dmae.complete import load_completer

            methods[name] = load_completer(Path(config.weights))
        elif name not in METHODS:
            raise KeyError(f"no method {name!r}; there are {[*METHODS, 'dmae']}")
        else:
            methods[name] = METHODS[name]
    return methods


def score(poses: Poses3D, captured: Poses3D, truth: Poses3D, actors: tuple[int, ...] | None = None) -> dict:
    """All scores of one prediction.

    Args:
        poses: What is scored, on any skeleton that `convert` can bring to that of the truth.
        captured: The same persons before anything was filled; says which joints were hidden.
        actors: True persons that PCP averages over; by default all that are annotated.

    Returns:
        pcp: strict PCP, mean of the actors, %; `pcp_persons` of each true person, NaN where never
            annotated; `pcp_limbs` {limb: mean of the actors}; `pcp_published` by other protocols.
        pck: {recall, precision} within 0.2 m, %. Where not everybody is annotated precision is too low.
        mpjpe: mm, {all, measured, denoised, completed}.
        shares: of the true joints, % {absent, measured, denoised, completed}.
        hidden: {recall, mpjpe} of the true joints that capture did not measure.
        gaps: see `dmae.metrics.error_by_gap`.
        identity_switches: number; `idf1`, %.
    """
    skeleton = truth.skeleton
    pred, captured = convert(poses, skeleton), convert(captured, skeleton)
    if captured.source.shape != pred.source.shape:
        raise ValueError(f"captured {captured.source.shape} and filled poses {pred.source.shape} differ in shape")
    true_joints = ~np.isnan(truth.xyz).any(-1)
    if actors is None:
        actors = tuple(np.flatnonzero(true_joints.any((0, 2))))
    matches = metrics.match(pred.xyz, truth.xyz)
    matched = metrics.take_matched(pred.xyz, matches)
    source = metrics.take_matched(pred.source, matches, Source.ABSENT)
    observed = captured.measured
    hidden = ~metrics.take_matched(observed, matches, False)
    lengths = metrics.take_matched(metrics.gap_lengths(observed), matches, 0)
    correct, known = metrics.correct_limbs(matched, truth.xyz, skeleton)
    persons = metrics.percent(correct, known, (0, 2))
    limbs = metrics.mean_known(metrics.percent(correct, known, 0)[list(actors)])
    kinds = {kind.name.lower(): source == kind for kind in Source if kind != Source.ABSENT}
    return {
        "pcp": float(metrics.mean_known(persons[list(actors)])),
        "pcp_persons": persons.tolist(),
        "pcp_limbs": dict(zip(metrics.limb_names(skeleton), limbs.tolist(), strict=True)),
        "pcp_published": metrics.published_pcp(pred.xyz, truth.xyz, skeleton, actors),
        "pck": metrics.pck(pred.xyz, truth.xyz, matches),
        "mpjpe": {"all": metrics.mpjpe(matched, truth.xyz)}
        | {name: metrics.mpjpe(matched, truth.xyz, counted) for name, counted in kinds.items()},
        "shares": metrics.shares(source, true_joints),
        "hidden": {
            "recall": float(metrics.percent(metrics.right_joints(matched, truth.xyz), true_joints & hidden)),
            "mpjpe": metrics.mpjpe(matched, truth.xyz, hidden),
        },
        "gaps": metrics.error_by_gap(matched, truth.xyz, lengths),
        "identity_switches": metrics.identity_switches(matches),
        "idf1": metrics.idf1(pred.xyz, truth.xyz),
    }


def summary(runs: list[dict]) -> dict:
    """Scores of one method and number of views, over clips and subsets of cameras.

    Args:
        runs: What `score` returned, and beside it `clip` and `cameras`.

    Returns:
        JSON-able `mean`, `worst` and `runs`, see `evaluate`.
    """
    by_subset: dict[tuple[int, ...], list[dict]] = {}
    for run in runs:
        by_subset.setdefault(tuple(run["cameras"]), []).append(run)
    apart = {"clip", "cameras", "gaps"}
    if len({run["clip"] for run in runs}) > 1:
        # Person 0 of one clip is nobody in the next.
        apart.add("pcp_persons")
    means = {
        cameras: _average([{key: run[key] for key in run if key not in apart} for run in group])
        for cameras, group in by_subset.items()
    }
    worst = min(means, key=lambda cameras: np.nan_to_num(means[cameras]["pcp"], nan=np.inf))
    return _jsonable(
        {
            "mean": _average(list(means.values())) | {"gaps": _pool_gaps([run["gaps"] for run in runs])},
            "worst": {"pcp": means[worst]["pcp"], "cameras": list(worst)},
            "runs": runs,
        }
    )


def _average(scores: list):
    """Mean of equally nested dictionaries and lists of numbers, leaf by leaf, NaN left out."""
    if isinstance(scores[0], dict):
        return {key: _average([part[key] for part in scores]) for key in scores[0]}
    if isinstance(scores[0], list):
        return [_average(list(parts)) for parts in zip(*scores, strict=True)]
    return float(metrics.mean_known(np.array(scores, float)))


def _pool_gaps(runs: list[list[dict]]) -> list[dict]:
    """Counts added up; errors averaged over joints, not over runs."""
    pooled = []
    for entries in zip(*runs, strict=True):
        filled = sum(entry["filled"] for entry in entries)
        total = sum(entry["filled"] * entry["mpjpe"] for entry in entries if entry["filled"])
        pooled.append({
            "frames": entries[0]["frames"],
            "hidden": sum(entry["hidden"] for entry in entries),
            "filled": filled,
            "mpjpe": total / filled if filled else float("nan"),
        })  # fmt: skip
    return pooled


def _jsonable(scores):
    if isinstance(scores, dict):
        return {key: _jsonable(value) for key, value in scores.items()}
    if isinstance(scores, list):
        return [_jsonable(value) for value in scores]
    return None if isinstance(scores, float) and np.isnan(scores) else scores
