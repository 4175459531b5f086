"""Degradation curves with their intervals, breaking points, and differences between methods."""

from collections.abc import Callable, Sequence

import numpy as np

from dmae.evaluation.corruption.registry import find_corruption
from dmae.evaluation.stress.plan import Axis, Cell, Contender, Plan
from dmae.metrics.intervals import Interval, block_sums, bootstrap_difference, bootstrap_ratio, bootstrap_scores
from dmae.numerics.statistics import mean_known

PCP_DROP = 10.0
"""A method is broken if its PCP is this number of points below its PCP at level 0."""
HIDDEN_ERROR = 100.0
"""mm; a method is broken if its mean error of hidden joints is above this."""

Runs = Callable[[Contender, Sequence[Cell]], list[dict]]
"""Function that returns the scores of a contender in cells, for each clip."""


def curves(plan: Plan, contenders: Sequence[Contender], runs: Runs, clips: Sequence[str], reference: str) -> dict:
    """Return all curves of a matrix, JSON-able. None stands for values that were not measured.

    Returns:
        `clips`, their ids; `reference`, "truth" or "capture"; `seeds`; `methods`, their descriptions by name; `notes`.

        `axes`, each with `name`, `about`, `unit` and `methods`: name to `points` and `breaks`. A point has `level`,
        `pcp` % and `hidden` mm, each [value, low, high] with the 95 % interval over blocks of time, `recall` and
        `precision` of joints, `idf1` and `absent` %. `breaks` contains, for `pcp` and for `hidden`, the level at which
        the method breaks, with its interval: [level, low, high]. An entry is None if it is beyond the range of levels;
        both ends of the interval are None if the clips are too short for an interval; the whole list is None if nothing
        was measured. `best` is the method of highest PCP at the greatest level. `level_with` are the other methods from
        which it differs by no more than noise; None if the clips are too short to decide.

        `pairs`, each with `names`, `units` and `points` of two `levels`, by method.
    """
    axes = [_axis(axis, plan.seeds, contenders, runs) for axis in plan.axes]
    pairs = [_pair(axis, plan.seeds, contenders, runs) for axis in plan.pairs]
    return {
        "clips": list(clips),
        "reference": reference,
        "seeds": list(plan.seeds),
        "methods": {each.name: each.about for each in contenders},
        "notes": list(plan.notes),
        "axes": axes,
        "pairs": pairs,
    }


def breaking_point(levels: np.ndarray, values: np.ndarray, broken: np.ndarray) -> np.ndarray:
    """Return the level at which each curve first breaks; infinite for a curve that does not break.

    Curves are straight lines between levels. Levels without a measurement are skipped.

    Args:
        levels: (L,) increasing levels, the first is 0.
        values: (N, L) distance of each curve above its bound, negative below it; NaN without a measurement.
        broken: (N, L) True where a curve is below its bound.

    Returns:
        (N,) levels.
    """
    found = np.full(len(values), np.inf)
    for curve in np.flatnonzero(broken.any(1)):
        first = int(broken[curve].argmax())
        before = np.flatnonzero(~np.isnan(values[curve, :first]))
        if not len(before):
            found[curve] = levels[first]
            continue
        (start, end), (above, below) = levels[[before[-1], first]], values[curve, [before[-1], first]]
        found[curve] = start + (end - start) * above / (above - below)
    return found


def _axis(axis: Axis, seeds: Sequence[int], contenders: Sequence[Contender], runs: Runs) -> dict:
    (entry,) = (find_corruption(name) for name in axis.names)
    levels = [(0.0,), *axis.levels]
    scores = {each.name: [runs(each, axis.cells(level, seeds)) for level in levels] for each in contenders}
    values = np.array([level for (level,) in levels])
    methods = {}
    for name, by_level in scores.items():
        points = [{"level": level, **_point(found)} for level, found in zip(values.tolist(), by_level, strict=True)]
        methods[name] = {"points": points, "breaks": _breaks(values, by_level)}
    about = {"name": axis.name, "about": entry.help, "unit": entry.unit}
    return about | {"methods": methods} | _best({name: by_level[-1] for name, by_level in scores.items()})


def _pair(axis: Axis, seeds: Sequence[int], contenders: Sequence[Contender], runs: Runs) -> dict:
    points = []
    for level in axis.levels:
        found = {each.name: _point(runs(each, axis.cells(level, seeds))) for each in contenders}
        points.append({"levels": list(level), "methods": found})
    return {"names": list(axis.names), "units": [find_corruption(name).unit for name in axis.names], "points": points}


def _point(runs: list[dict]) -> dict:
    """Return the scores of one method at one level."""
    singles = {
        "recall": [run["pck"]["recall"] for run in runs],
        "precision": [run["pck"]["precision"] for run in runs],
        "idf1": [run["idf1"] for run in runs],
        "absent": [run["shares"]["absent"] for run in runs],
    }
    return {
        "pcp": _rounded(bootstrap_ratio(block_sums(runs, "pcp"))),
        "hidden": _rounded(bootstrap_ratio(block_sums(runs, "hidden"))),
        **{name: _number(mean_known(np.array(values, float))) for name, values in singles.items()},
    }


def _breaks(levels: np.ndarray, by_level: list[list[dict]]) -> dict:
    """Return the levels at which a method breaks, by PCP and by the error of hidden joints, see `curves`."""
    # If the clips are too short for an interval of a score, values derived from it have no interval either.
    certain = np.isfinite(bootstrap_ratio(block_sums(by_level[0], "pcp")).low)
    curves = {}
    for figure in ("pcp", "hidden"):
        sums = [block_sums(runs, figure) for runs in by_level]
        value = np.array([[bootstrap_ratio(each).value for each in sums]])
        draws = np.stack([bootstrap_scores(each) for each in sums], 1)
        curves[figure] = np.concatenate([value, draws])
    margins = {
        "pcp": curves["pcp"] - curves["pcp"][:, :1] + PCP_DROP,
        "hidden": HIDDEN_ERROR - curves["hidden"],
    }
    breaks = {}
    for figure, margin in margins.items():
        if np.isnan(margin[0]).all():
            breaks[figure] = None
            continue
        found = breaking_point(levels, margin, margin < 0)
        low, high = np.quantile(found[1:], [0.025, 0.975], method="inverted_cdf") if certain else (np.nan, np.nan)
        breaks[figure] = [_number(each, 2) for each in (found[0], low, high)]
    return breaks


def _best(runs: dict[str, list[dict]]) -> dict:
    """Return the method of highest PCP, and the others that it exceeds by no more than noise; None if unknown."""
    sums = {name: block_sums(found, "pcp") for name, found in runs.items()}
    values = {name: bootstrap_ratio(each).value for name, each in sums.items()}
    known = {name: value for name, value in values.items() if not np.isnan(value)}
    if not known:
        return {"best": None, "level_with": []}
    best = max(known, key=known.get)
    differences = {name: bootstrap_difference(sums[best], sums[name]) for name in known if name != best}
    if any(np.isnan(each.low) for each in differences.values()):
        return {"best": best, "level_with": None}
    return {"best": best, "level_with": [name for name, each in differences.items() if not each.excludes_zero]}


def _rounded(interval: Interval) -> list[float | None]:
    return [_number(value) for value in (interval.value, interval.low, interval.high)]


def _number(value: float, digits: int = 1) -> float | None:
    """Return a rounded number; None for one that is not finite."""
    return round(float(value), digits) if np.isfinite(value) else None
