"""Degradation curves with their intervals, breaking points, and differences between methods."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dmae.evaluation.corruption.registry import find_corruption
from dmae.evaluation.scores import figure_score, run_table
from dmae.evaluation.stress.plan import Axis, Contender, Plan
from dmae.metrics.table import Score
from dmae.numerics.statistics import mean_known

PCP_DROP = 10.0
"""A method is broken if its PCP is this number of points below its PCP at level 0."""
HIDDEN_ERROR = 100.0
"""mm; a method is broken if its mean error of hidden joints is above this."""


@dataclass(frozen=True)
class Point:
    """Scores of one method at one level of a corruption, over all clips and seeds."""

    pcp: Score  # Strict PCP, %
    hidden: Score  # Error of hidden joints, mm
    angles: Score | None  # Error of the angles of the legs, degrees; None if they are not scored
    means: dict[str, float]  # Scores without an interval by name, %

    @property
    def json(self) -> dict:
        intervals = {"pcp": self.pcp, "hidden": self.hidden} | ({"angles": self.angles} if self.angles else {})
        rounded = {name: [_number(value) for value in (each.value, *each.interval)] for name, each in intervals.items()}
        return rounded | {name: _number(value) for name, value in self.means.items()}


def curves(plan: Plan, contenders: Sequence[Contender], runs: list[dict], clips: Sequence[str], reference: str) -> dict:
    """Return all curves of a matrix, JSON-able. None stands for values that were not measured.

    `runs` are the scores of each method in each cell of each clip, with `method`, `levels` and `seed` of the cell,
    `clip` and `cameras`; `reference` is "truth" or "capture".

    Returns:
        `clips`, their ids; `reference`; `seeds`; `methods`, their descriptions by name; `notes`.

        `axes`, each with `name`, `about`, `unit` and `methods`: name to `points` and `breaks`. A point has `level`,
        `pcp` % and `hidden` mm, each [value, low, high] with the 95 % interval over blocks of time, `recall` and
        `precision` of joints, `idf1` and `absent` %; and `angles`, degrees, as `pcp`, if they are scored. `breaks`
        contains, for `pcp` and for `hidden`, the level at which the method breaks, with its interval: [level, low,
        high]. An entry is None if it is beyond the range of levels; both ends of the interval are None if the clips
        are too short for an interval; the whole list is None if nothing was measured. `best` is the method of highest
        PCP at the greatest level. `level_with` are the other methods from which it differs by no more than noise;
        None if the clips are too short to decide.

        `pairs`, each with `names`, `units` and `points` of two `levels`, by method.
    """
    groups: dict[tuple, list[dict]] = {}
    for run in runs:
        groups.setdefault((run["method"], run["levels"]), []).append(run)
    points = {key: _point(group) for key, group in groups.items()}
    return {
        "clips": list(clips),
        "reference": reference,
        "seeds": list(plan.seeds),
        "methods": {each.name: each.about for each in contenders},
        "notes": list(plan.notes),
        "axes": [_axis(axis, contenders, points) for axis in plan.axes],
        "pairs": [
            {
                "names": list(axis.names),
                "units": [find_corruption(name).unit for name in axis.names],
                "points": [
                    {
                        "levels": list(level),
                        "methods": {each.name: points[each.name, axis.active(level)].json for each in contenders},
                    }
                    for level in axis.levels
                ],
            }
            for axis in plan.pairs
        ],
    }


def breaking_point(levels: np.ndarray, values: np.ndarray, broken: np.ndarray) -> np.ndarray:
    """Return the level (N,) at which each curve first breaks; infinite for a curve that does not break.

    Curves are straight lines between levels. Levels without a measurement are skipped.

    Args:
        levels: (L,) increasing levels, the first is 0.
        values: (N, L) distance of each curve above its bound, negative below it; NaN without a measurement.
        broken: (N, L) True where a curve is below its bound.
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


def _point(runs: list[dict]) -> Point:
    table = run_table(runs, "seed")
    singles = {
        "recall": [run["pck"]["recall"] for run in runs],
        "precision": [run["pck"]["precision"] for run in runs],
        "idf1": [run["idf1"] for run in runs],
        "absent": [run["shares"]["absent"] for run in runs],
    }
    return Point(
        figure_score(table, "pcp", "seed"),
        figure_score(table, "hidden", "seed"),
        figure_score(table, "angles", "seed") if (table["figure"] == "angles").any() else None,
        {name: mean_known(np.array(values, float)) for name, values in singles.items()},
    )


def _axis(axis: Axis, contenders: Sequence[Contender], points: dict[tuple, Point]) -> dict:
    entry = find_corruption(axis.name)
    levels = [(0.0,), *axis.levels]
    along = {each.name: [points[each.name, axis.active(level)] for level in levels] for each in contenders}
    methods = {
        name: {
            "points": [{"level": level} | point.json for (level,), point in zip(levels, found, strict=True)],
            "breaks": _breaks(np.array(levels)[:, 0], found),
        }
        for name, found in along.items()
    }
    last = {name: found[-1].pcp for name, found in along.items()}
    return {"name": axis.name, "about": entry.help, "unit": entry.unit, "methods": methods} | _best(last)


def _breaks(levels: np.ndarray, points: list[Point]) -> dict:
    """Return the levels at which a method breaks, by PCP and by the error of hidden joints, see `curves`."""
    # If the clips are too short for an interval of a score, values derived from it have no interval either.
    certain = np.isfinite(points[0].pcp.interval[0])

    def curves_of(scores: list[Score]) -> np.ndarray:
        """Return (1 + draws, L): the scores at each level, then those of each draw."""
        return np.stack([np.append(each.value, each.drawn) for each in scores], 1)

    pcp, hidden = curves_of([each.pcp for each in points]), curves_of([each.hidden for each in points])
    breaks = {}
    for figure, margin in (("pcp", pcp - pcp[:, :1] + PCP_DROP), ("hidden", HIDDEN_ERROR - hidden)):
        if np.isnan(margin[0]).all():
            breaks[figure] = None
            continue
        found = breaking_point(levels, margin, margin < 0)
        low, high = np.quantile(found[1:], [0.025, 0.975], method="inverted_cdf") if certain else (np.nan, np.nan)
        breaks[figure] = [_number(each, 2) for each in (found[0], low, high)]
    return breaks


def _best(scores: dict[str, Score]) -> dict:
    """Return the method of highest PCP, and the others that it exceeds by no more than noise; None if unknown."""
    known = {name: each for name, each in scores.items() if not np.isnan(each.value)}
    if not known:
        return {"best": None, "level_with": []}
    best = max(known, key=lambda name: known[name].value)
    differences = {name: known[best] - each for name, each in known.items() if name != best}
    if any(np.isnan(each.interval[0]) for each in differences.values()):
        return {"best": best, "level_with": None}
    return {"best": best, "level_with": [name for name, each in differences.items() if not each.excludes_zero]}


def _number(value: float, digits: int = 1) -> float | None:
    """Return a rounded number; None for one that is not finite."""
    return round(float(value), digits) if np.isfinite(value) else None
