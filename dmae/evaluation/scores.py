"""Scores of a prediction: the reference that it is compared with, every metric, sums by time, and means over runs.

`score` scores one run: a method on a clip seen by a subset of its cameras. `run_table` makes the score table of runs
from their sums by time, and `summary` averages them.
"""

from collections.abc import Mapping
from numbers import Real
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from dmae.data.array_fields import UNSET
from dmae.data.clip import Clip, Poses3D
from dmae.data.conversion import convert
from dmae.data.skeleton import Skeleton, get_skeleton
from dmae.files.structured import read_json
from dmae.metrics.angles import angle_errors
from dmae.metrics.comparison import Comparison
from dmae.metrics.pcp import correct_limbs
from dmae.metrics.position import joints_within_threshold
from dmae.metrics.registry import metrics
from dmae.metrics.table import BLOCK, Score, block_of, score_of, tally
from dmae.numerics.statistics import mean_known
from dmae.reconstruction.config import CaptureConfig
from dmae.reconstruction.pipeline import capture


class Figure(NamedTuple):
    """A score that is summed over blocks of time, so that it has an interval."""

    heading: str
    unit: str
    sign: int  # 1 if larger is better, -1 if smaller is
    place: tuple[str, ...]  # Keys of its mean in the scores

    @property
    def scale(self) -> float:
        """Factor from the ratio of its sums to its unit."""
        return 100.0 if self.unit == "%" else 1.0


FIGURES = {
    "pcp": Figure("strict PCP", "%", 1, ("pcp",)),
    "mpjpe": Figure("MPJPE", "mm", -1, ("mpjpe", "all")),
    "hidden": Figure("MPJPE of unmeasured joints", "mm", -1, ("hidden", "mpjpe")),
    "recall": Figure("recall of unmeasured joints", "%", 1, ("hidden", "recall")),
    "angles": Figure("error of angles", "°", -1, ("angles", "mae")),
}
"""The figures by name, which `time_blocks` sums."""
PUBLISHED_ACTORS = (0, 1, 2)
"""The three of Shelf's four actors that published averages include."""

_VIEWS = 3
"""Without truth, a joint counts as true if capture with all cameras measured it in at least this number of views."""


def truth_of(clip: Clip) -> Poses3D:
    """Return the truth of a clip; ValueError if it has none, none in its frames, or infinite coordinates."""
    if clip.truth is None:
        raise ValueError(
            f"clip {clip.id!r} has no truth to score against; data.truth=... names a file of it, and dmae evaluate "
            "reference=capture views=[...] compares what fewer cameras show with what all of them measured"
        )
    if np.isinf(clip.truth.xyz).any():
        raise ValueError(f"clip {clip.id!r}: its truth has infinite coordinates; joints that are not known must be NaN")
    if clip.truth.xyz.size and np.isnan(clip.truth.xyz).all():
        raise ValueError(
            f"clip {clip.id!r}: no true joint in its {len(clip)} frames, so nothing can be scored; choose frames with "
            "annotations: data.frames=[first,end], or frames=[first, end] of dmae.read"
        )
    return clip.truth


def compared_truth(clip: Clip, skeleton: str | Path | Skeleton | None = None) -> Poses3D:
    """Return the truth that poses are compared with: on a skeleton, by default its own, or the second of two fused. A
    truth of points without bones, as from a table, is compared on the skeleton of the detections if that has them.

    Raises as `truth_of`, and KeyError if there is no such skeleton.
    """
    truth = truth_of(clip)
    wanted = get_skeleton(skeleton) if skeleton else truth.skeleton.parts[-1]
    detected = clip.detections.skeleton
    if not skeleton and not wanted.bones and set(wanted.joints) <= set(detected.joints):
        wanted = detected
    if not wanted.bones:
        joints = ", ".join(wanted.joints[:5])
        raise ValueError(
            f"clip {clip.id!r}: joints of the truth have no bones, which scores count ({joints}, ...): name them as "
            "a skeleton of this package does, l_knee or left_knee, or give a skeleton= that has them"
        )
    return convert(truth, wanted)


def measured_by_all(clip: Clip, config: CaptureConfig) -> Poses3D:
    """Return the captured poses of a clip with only the joints that three views or more measured."""
    whole = capture(clip, config)
    known = whole.views >= _VIEWS
    return Poses3D(whole.skeleton, np.where(known[..., None], whole.xyz, np.nan), cov=whole.cov)


def scored_actors(clip: Clip) -> tuple[int, ...] | None:
    """Return the persons of the truth that averages include; None for all."""
    return PUBLISHED_ACTORS if clip.provenance.get("format") == "shelf" else None


def annotated_persons(truth: Poses3D) -> tuple[int, ...]:
    """Return the indices of the persons of whom the truth (F, T, J) has a joint in any frame."""
    return tuple(np.flatnonzero((~np.isnan(truth.xyz).any(-1)).any((0, 2))).tolist())


def score(
    poses: Poses3D,
    captured: Poses3D,
    truth: Poses3D,
    actors: tuple[int, ...] | None = None,
    matches: np.ndarray | None = None,
    *,
    fps: float = 25.0,
    compared: np.ndarray | None = None,
    angles: np.ndarray | None = None,
) -> dict:
    """Return all scores of one prediction, each by the name of its metric, NaN without data.

    Args:
        poses: The prediction, on any skeleton that `convert` can convert to the skeleton of the truth.
        captured: The same persons before completion. It defines which joints were hidden.
        truth: True poses. If they have covariances, the regions of predictions allow for them.
        actors: True persons over which PCP is averaged; by default all annotated persons.
        matches: (F, T) index of the predicted person that matches each true person, -1 for none; by default the result
            of `dmae.metrics.comparison.match`.
        fps: Frames per second. Gaps are classified by their length in time.
        compared: (F, T, J) True for joints that count in `gaps`; by default all joints.
        angles: True angles of the legs from `dmae.metrics.angles.leg_angles`; by default angles are not scored.

    The entry `blocks` contains the sums from which intervals are computed, see `time_blocks`.
    """
    if actors is None:
        actors = annotated_persons(truth)
    skeleton = truth.skeleton
    matches = UNSET if matches is None else matches
    comparison = Comparison(
        convert(poses, skeleton), convert(captured, skeleton), truth, actors, matches, fps, compared, angles
    )
    found = {}
    for each in metrics():
        found[each.name] = score = each.function(comparison)
        if not each.home.startswith("dmae.") and not _is_score(score):
            kind = f"an array {score.shape}" if isinstance(score, np.ndarray) else type(score).__name__
            raise ValueError(
                f"metric {each.name!r}, {each.home}: expected it to return a number, a list or dictionary of numbers, "
                f"or None; found {kind}"
            )
    return {name: value for name, value in found.items() if value is not None} | {"blocks": time_blocks(comparison)}


def _is_score(value: Any) -> bool:
    """Return whether a value can be the score of a metric."""
    if isinstance(value, Mapping):
        return all(map(_is_score, value.values()))
    if isinstance(value, list | tuple):
        return all(map(_is_score, value))
    return value is None or isinstance(value, Real | str)


def time_blocks(comparison: Comparison) -> dict:
    """Return JSON-able sums over the blocks of time that contain a true joint.

    `seconds` is the length of a block and `block` the B indices of the blocks. `pcp` (correct limbs of each actor),
    `mpjpe` (mm, all joints), `hidden` (mm, joints that capture did not measure) and `recall` (unmeasured joints within
    0.2 m) each have `sum` and `count`, (G, B) numbers. G is the number of actors for `pcp`, otherwise 1.
    `angles` (degrees, of the legs) is there if they are scored.
    """
    frames, actors = np.flatnonzero(comparison.known.any((1, 2))), list(comparison.actors)
    matched, truth = comparison.matched, comparison.truth.xyz
    correct, limbs = correct_limbs(matched[:, actors], truth[:, actors], comparison.skeleton)
    error = comparison.error
    block = block_of(frames, comparison.fps)
    blocks = np.unique(block)

    def sums(value: np.ndarray, counted: np.ndarray, persons: np.ndarray) -> dict:
        keys = {"person": persons[:, None], "block": block[:, None, None]}
        table = tally(value[frames], counted[frames], among=True, **keys)
        shape = len(np.unique(persons)), len(blocks)
        return {
            "sum": table["value"].to_numpy().reshape(shape).round(3).tolist(),
            "count": table["count"].to_numpy().reshape(shape).tolist(),
        }

    each, together = np.arange(len(actors)), np.zeros(truth.shape[1], int)
    angles = {}
    if comparison.angles is not None:
        turned = np.abs(angle_errors(comparison)[0]).reshape(*truth.shape[:2], -1)
        angles = {"angles": sums(turned, ~np.isnan(turned), together)}
    return {
        "seconds": BLOCK,
        "block": blocks.tolist(),
        "pcp": sums(correct, limbs, each),
        "mpjpe": sums(error, ~np.isnan(error), together),
        "hidden": sums(error, ~np.isnan(error) & comparison.hidden, together),
        "recall": sums(joints_within_threshold(comparison), comparison.known & comparison.hidden, together),
        **angles,
    }


def run_table(runs: list[dict], *labels: str) -> pd.DataFrame:
    """Return the score table of runs: results of `score`, each with the entries `clip` and `cameras` added.

    It has a row for each `cameras`, `clip`, `figure` (of `FIGURES`), `person` and `block`, and for each of the labels,
    which are other entries of the runs. Raises ValueError if a clip has true joints at other times in some run.
    """
    columns = ["cameras", "clip", *labels, "figure", "person", "block", "value", "count"]
    blocks, rows = {}, []
    for run in runs:
        times = run["blocks"]["block"]
        if blocks.setdefault(run["clip"], times) != times:
            raise ValueError(f"clip {run['clip']!r} has other annotated frames in one run than in another")
        keys = ",".join(map(str, run["cameras"])), run["clip"], *(run[name] for name in labels)
        for figure in filter(run["blocks"].__contains__, FIGURES):
            pairs = zip(run["blocks"][figure]["sum"], run["blocks"][figure]["count"], strict=True)
            for person, (sums, counts) in enumerate(pairs):
                rows += [(*keys, figure, person, *each) for each in zip(times, sums, counts, strict=True)]
    return pd.DataFrame(rows, columns=columns)


def mean_score(table: pd.DataFrame, *labels: str, scale: float = 100.0) -> Score:
    """Return the score of a table, by default in %, with its interval.

    It is the mean over persons, then over runs that differ in `labels`, then over clips, then over subsets of cameras.
    """
    return score_of(table, "cameras", "clip", *labels, "person", scale=scale)


def figure_score(table: pd.DataFrame, figure: str, *labels: str) -> Score:
    """Return the `mean_score` of one of `FIGURES`. `table` comes from `run_table`; its persons are the actors."""
    return mean_score(table[table["figure"] == figure], *labels, scale=FIGURES[figure].scale)


def read_scores(path: Path) -> dict:
    """Return what `dmae evaluate` wrote to `scores.json`, by file or folder; FileNotFoundError, or ValueError."""
    path = Path(path)
    return read_json(path / "scores.json" if path.is_dir() else path)


def summary(runs: list[dict]) -> dict:
    """Return the scores of one method and number of views: JSON-able `mean`, `intervals`, `worst` and `runs`, see
    `evaluate`. Runs are results of `score`, each with the entries `clip` and `cameras` added."""
    table = run_table(runs)
    by_subset: dict[tuple[int, ...], list[dict]] = {}
    for run in runs:
        by_subset.setdefault(tuple(run["cameras"]), []).append(run)
    pooled = {metric.name: metric.pool([run[metric.name] for run in runs]) for metric in metrics() if metric.pool}
    several = len({run["clip"] for run in runs}) > 1
    averaged = [metric.name for metric in metrics() if not metric.pool and not (several and metric.one_clip)]
    averaged = [name for name in averaged if all(name in run for run in runs)]
    means = {
        cameras: _average([{name: run[name] for name in averaged} for run in group])
        for cameras, group in by_subset.items()
    }
    worst = min(means, key=lambda cameras: np.nan_to_num(means[cameras]["pcp"], nan=np.inf))
    return json_numbers(
        {
            "mean": _average(list(means.values())) | pooled,
            "intervals": {
                figure: list(figure_score(table, figure).interval) for figure in FIGURES if figure in runs[0]["blocks"]
            },
            "worst": {"pcp": means[worst]["pcp"], "cameras": list(worst)},
            "runs": runs,
        }
    )


def _average(scores: list):
    """Return the mean of each number over equally nested dictionaries and lists, ignoring NaN."""
    if isinstance(scores[0], dict):
        return {key: _average([part[key] for part in scores]) for key in scores[0]}
    if isinstance(scores[0], list):
        return [_average(list(parts)) for parts in zip(*scores, strict=True)]
    return float(mean_known(np.array(scores, float)))


def json_numbers(scores):
    """Return nested scores with None in place of NaN, which is no JSON."""
    if isinstance(scores, dict):
        return {key: json_numbers(value) for key, value in scores.items()}
    if isinstance(scores, list):
        return [json_numbers(value) for value in scores]
    return None if isinstance(scores, float) and np.isnan(scores) else scores
