"""Reference poses of an evaluation: the truth of a clip, or the joints that all its cameras together measured."""

from pathlib import Path

import numpy as np

from dmae.data.clip import Clip, Poses3D
from dmae.data.conversion import convert
from dmae.files.structured import read_json
from dmae.metrics.comparison import Comparison
from dmae.metrics.intervals import FIGURES, block_sums, bootstrap_ratio, time_blocks
from dmae.metrics.registry import metrics
from dmae.numerics.statistics import mean_known
from dmae.reconstruction.config import CaptureConfig
from dmae.reconstruction.pipeline import capture

PUBLISHED_ACTORS = (0, 1, 2)
"""The three of Shelf's four actors that published averages include."""

_VIEWS = 3
"""Without truth, a joint counts as true if capture with all cameras measured it in at least this number of views."""


def truth_of(clip: Clip) -> Poses3D:
    """Return the truth of a clip.

    Raises:
        ValueError: the clip has no truth, or the truth has infinite coordinates.
    """
    if clip.truth is None:
        raise ValueError(f"clip {clip.id!r} has no truth to score against")
    if np.isinf(clip.truth.xyz).any():
        raise ValueError(f"clip {clip.id!r}: its truth has infinite coordinates; joints that are not known must be NaN")
    return clip.truth


def measured_by_all(clip: Clip, config: CaptureConfig) -> Poses3D:
    """Return the captured poses of a clip with only the joints that three views or more measured."""
    whole = capture(clip, config)
    known = whole.views >= _VIEWS
    return Poses3D(whole.skeleton, np.where(known[..., None], whole.xyz, np.nan), cov=whole.cov)


def scored_actors(clip: Clip) -> tuple[int, ...] | None:
    """Return the persons of the truth that averages include; None for all."""
    return PUBLISHED_ACTORS if clip.provenance.get("format") == "shelf" else None


# Scores of a prediction, and their averages over runs.


def score(
    poses: Poses3D,
    captured: Poses3D,
    truth: Poses3D,
    actors: tuple[int, ...] | None = None,
    matches: np.ndarray | None = None,
    *,
    fps: float = 25.0,
    compared: np.ndarray | None = None,
) -> dict:
    """Return all scores of one prediction.

    Args:
        poses: The prediction, on any skeleton that `convert` can convert to the skeleton of the truth.
        captured: The same persons before completion. It defines which joints were hidden.
        truth: True poses. If they have covariances, the confidence regions of predictions allow for them.
        actors: True persons over which PCP is averaged; by default all annotated persons.
        matches: (F, T) index of the predicted person that matches each true person, -1 for none; by default the result
            of `dmae.metrics.comparison.match`.
        fps: Frames per second. Gaps are classified by their length in time.
        compared: (F, T, J) True for joints that count in `gaps`; by default all joints.

    Returns:
        The score of each metric by its name, see `dmae.metrics.registry.metrics`; NaN for a score without data. The
        entry `blocks` contains the sums from which intervals are computed, see `dmae.metrics.intervals.time_blocks`.

    Raises:
        ValueError: `poses` and `captured` differ in their persons.
    """
    if actors is None:
        actors = tuple(np.flatnonzero((~np.isnan(truth.xyz).any(-1)).any((0, 2))))
    skeleton = truth.skeleton
    comparison = Comparison(
        convert(poses, skeleton), convert(captured, skeleton), truth, actors, matches, fps, compared
    )
    return {metric.name: metric.function(comparison) for metric in metrics()} | {"blocks": time_blocks(comparison)}


def read_scores(path: Path) -> dict:
    """Return the content of the `scores.json` that `dmae evaluate` wrote. The path is the file or its folder.

    Raises:
        FileNotFoundError: the file does not exist.
        ValueError: the file is not JSON.
    """
    path = Path(path)
    return read_json(path / "scores.json" if path.is_dir() else path)


def summary(runs: list[dict]) -> dict:
    """Return the scores of one method and number of views, over clips and subsets of cameras.

    Args:
        runs: Results of `score`, each with the entries `clip` and `cameras` added.

    Returns:
        JSON-able `mean`, `intervals`, `worst` and `runs`, see `evaluate`.
    """
    by_subset: dict[tuple[int, ...], list[dict]] = {}
    for run in runs:
        by_subset.setdefault(tuple(run["cameras"]), []).append(run)
    pooled = {metric.name: metric.pool([run[metric.name] for run in runs]) for metric in metrics() if metric.pool}
    several = len({run["clip"] for run in runs}) > 1
    averaged = [metric.name for metric in metrics() if not metric.pool and not (several and metric.one_clip)]
    means = {
        cameras: _average([{name: run[name] for name in averaged} for run in group])
        for cameras, group in by_subset.items()
    }
    worst = min(means, key=lambda cameras: np.nan_to_num(means[cameras]["pcp"], nan=np.inf))
    return _jsonable(
        {
            "mean": _average(list(means.values())) | pooled,
            "intervals": {figure: _interval(runs, figure) for figure in FIGURES},
            "worst": {"pcp": means[worst]["pcp"], "cameras": list(worst)},
            "runs": runs,
        }
    )


def _interval(runs: list[dict], figure: str) -> list[float]:
    interval = bootstrap_ratio(block_sums(runs, figure))
    return [interval.low, interval.high]


def _average(scores: list):
    """Return the mean of each number over equally nested dictionaries and lists, ignoring NaN."""
    if isinstance(scores[0], dict):
        return {key: _average([part[key] for part in scores]) for key in scores[0]}
    if isinstance(scores[0], list):
        return [_average(list(parts)) for parts in zip(*scores, strict=True)]
    return float(mean_known(np.array(scores, float)))


def _jsonable(scores):
    if isinstance(scores, dict):
        return {key: _jsonable(value) for key, value in scores.items()}
    if isinstance(scores, list):
        return [_jsonable(value) for value in scores]
    return None if isinstance(scores, float) and np.isnan(scores) else scores
