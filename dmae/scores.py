"""All scores of predicted against true poses, and their averages over runs."""

import numpy as np

from dmae import metrics
from dmae.clip import Poses3D, Source
from dmae.mapping import convert


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
    """All scores of one prediction.

    Args:
        poses: What is scored, on any skeleton that `convert` can bring to that of the truth.
        captured: The same persons before anything was filled; says which joints were hidden.
        actors: True persons that PCP averages over; by default all that are annotated.
        matches: (F, T) which predicted person is which true one, -1 for none; by default by `dmae.metrics.match`.
        fps: Frames per second: gaps are told apart by their length in time.
        compared: (F, T, J) True where joints count in `gaps`; by default all.

    Returns:
        pcp: strict PCP, mean of the actors, %; `pcp_persons` of each true person, NaN where never
            annotated; `pcp_limbs` {limb: mean of the actors}; `pcp_published` by other protocols.
        pck: {recall, precision} within 0.2 m, %. Where not everybody is annotated precision is too low.
        mpjpe: mm, {all, measured, denoised, completed}.
        shares: of the true joints, % {absent, measured, denoised, completed}.
        hidden: {recall, mpjpe} of the true joints that capture did not measure.
        gaps: see `dmae.metrics.error_by_gap`; where the truth has covariances, they count as well.
        identity_switches: number; `idf1`, %.
    """
    skeleton = truth.skeleton
    pred, captured = convert(poses, skeleton), convert(captured, skeleton)
    if captured.source.shape != pred.source.shape:
        raise ValueError(f"captured {captured.source.shape} and filled poses {pred.source.shape} differ in shape")
    true_joints = ~np.isnan(truth.xyz).any(-1)
    if actors is None:
        actors = tuple(np.flatnonzero(true_joints.any((0, 2))))
    if matches is None:
        matches = metrics.match(pred.xyz, truth.xyz)
    matched = metrics.take_matched(pred.xyz, matches)
    source = metrics.take_matched(pred.source, matches, Source.ABSENT)
    observed = captured.measured
    hidden = ~metrics.take_matched(observed, matches, False)
    lengths = np.ceil(metrics.gap_lengths(observed) * (25 / fps) - 1e-6)
    lengths = metrics.take_matched(lengths, matches, 0)
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
        "gaps": metrics.error_by_gap(
            matched if compared is None else np.where(compared[..., None], matched, np.nan),
            truth.xyz,
            lengths,
            # Of a difference from what was itself measured.
            metrics.take_matched(pred.cov, matches) + np.nan_to_num(truth.cov),
        ),
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

    def mean(entries: tuple[dict, ...], value: str, count: str) -> float:
        total = sum(entry[count] for entry in entries)
        return sum(entry[count] * entry[value] for entry in entries if entry[count]) / total if total else float("nan")

    counts = ("hidden", "filled", "stated")
    return [
        {
            "frames": entries[0]["frames"],
            **{count: sum(entry[count] for entry in entries) for count in counts},
            "mpjpe": mean(entries, "mpjpe", "filled"),
            "held": mean(entries, "held", "stated"),
        }
        for entries in zip(*runs, strict=True)
    ]


def _jsonable(scores):
    if isinstance(scores, dict):
        return {key: _jsonable(value) for key, value in scores.items()}
    if isinstance(scores, list):
        return [_jsonable(value) for value in scores]
    return None if isinstance(scores, float) and np.isnan(scores) else scores
