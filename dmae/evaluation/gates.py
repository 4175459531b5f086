"""Gates: are scores worse than a baseline by more than the variation over time explains?

Two scores can be compared if the options that scores depend on and the clips are equal, which `scored_options` and
`scored_clip` write into `scores.json`. `compare_scores` then compares figure by figure over the same blocks of time.
"""

import hashlib
import json
from collections.abc import Collection
from dataclasses import asdict, dataclass
from functools import reduce
from operator import getitem
from typing import Any

import numpy as np

from dmae.data.clip import Clip
from dmae.data.json_values import flat
from dmae.evaluation.scores import FIGURES, figure_score, run_table
from dmae.metrics.registry import metrics
from dmae.reporting.tables import listed

_TOLERANCES = {
    "joints": (5e-3, 0), "mean": (0, 0.01), "detected": (5e-3, 0), "pixels": (0, 1), "score": (5e-3, 0),
    "offset_px": (0.02, 0),
}  # fmt: skip
"""Relative and absolute (m, px) tolerance of facts about simulated clips: rounding differs between processors."""
_NAMED = 3  # Greatest number of differing options that a message lists
_UNDER_TEST = (
    "data", "methods", "poses", "weights", "views", "angles", "baseline", "changed", "out", "first", "clips",
    "workers", "backend", "dry_run",
)  # fmt: skip
"""Options of `dmae evaluate` that may differ: the scored methods, and facts that clips and results contain anyway."""


def scored_options(config) -> dict:
    """Return the options of `dmae evaluate` on which scores depend, by dotted name. The values are JSON-able."""
    options = {name: value for name, value in asdict(config).items() if name not in _UNDER_TEST}
    return flat(json.loads(json.dumps(options)))


def scored_clip(clip: Clip) -> dict:
    """Return JSON-able facts that identify a clip: of a recording, a checksum.

    A simulation with the same seed differs in its last digits between machines, so its facts are counts and means: the
    number of `joints` of the truth and their `mean` position, m; the number of `detected` joints and the means of their
    `pixels`, `score` and `offset_px`.
    """
    found = clip.detections
    truth = np.empty((len(clip), 0, 0, 3)) if clip.truth is None else clip.truth.xyz.astype(np.float64)
    facts = {
        "frames": len(clip),
        "fps": clip.fps,
        "cameras": list(clip.rig.names),
        "persons": truth.shape[1],
        "joints": int(np.isfinite(truth).all(-1).sum()),
    }
    if clip.detection_labels is None:
        arrays = (truth, found.xy, found.score, clip.rig.projections, clip.rig.dist)
        digest = hashlib.sha256(b"".join(np.ascontiguousarray(array).tobytes() for array in arrays))
        return facts | {"sha256": digest.hexdigest()}
    facts |= {"mean": _means(truth), "detected": int(found.observed.sum())}
    facts |= {"pixels": _means(found.xy.astype(np.float64)), "score": _means(found.score[..., None])[0]}
    offsets = clip.detection_labels.offset_px
    return facts if offsets is None else facts | {"offset_px": _means(np.asarray(offsets, np.float64)[..., None])[0]}


def clip_differences(old: dict[str, dict], new: dict[str, dict]) -> list[str]:
    """Return one line for each difference between the clips of two scores; empty if they are equal up to rounding."""
    lines = [f"clip {name!r} is of the baseline alone" for name in old if name not in new]
    lines += [f"clip {name!r} is not of the baseline" for name in new if name not in old]
    for name in old:
        for fact in {**old[name], **new.get(name, {})} if name in new else ():
            pair = old[name].get(fact), new[name].get(fact)
            if not _same(fact, *pair):
                lines.append(f"clip {name!r}: {fact} {_text(pair[0])} in the baseline, {_text(pair[1])} here")
    return lines


def _same(fact: str, old, new) -> bool:
    if fact not in _TOLERANCES or None in (old, new):
        return old == new
    one, other, (relative, absolute) = np.array(old, float), np.array(new, float), _TOLERANCES[fact]
    return one.shape == other.shape and np.allclose(other, one, relative, absolute)


def _means(values: np.ndarray) -> list[float | None]:
    """Return the mean of each column along the last axis; None for a column without numbers."""
    rows = values.reshape(-1, values.shape[-1])
    rows = rows[np.isfinite(rows).all(-1)]
    return [round(float(mean), 5) for mean in rows.mean(0)] if len(rows) else [None] * values.shape[-1]


def _text(value) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)


_SMALLEST = 0.05  # % or mm. Smaller changes are not printed; another processor can cause them.


@dataclass(frozen=True)
class Change:
    """One figure of one method and number of views, in the baseline and in the new scores."""

    method: str  # Name of the method
    views: int  # Number of views; 0 with synthetic gaps
    figure: str  # One of `dmae.evaluation.scores.FIGURES`
    # old, new: The figure in the baseline and in the new scores, in its unit
    old: float
    new: float
    # low, high: 95 % interval of `new - old` over the same blocks of time
    low: float
    high: float

    @property
    def worse(self) -> bool:
        """Whether the figure is worse by more than its interval."""
        return self._gain < -_SMALLEST and (self.high < 0 or self.low > 0)

    @property
    def better(self) -> bool:
        """Whether the figure is better by more than its interval."""
        return self._gain > _SMALLEST and (self.high < 0 or self.low > 0)

    @property
    def _gain(self) -> float:
        return FIGURES[self.figure].sign * (self.new - self.old)

    def __str__(self) -> str:
        name, unit, *_ = FIGURES[self.figure]
        bounds = sorted(map(abs, (self.low, self.high)))
        where = _where(self.method, self.views)
        if not (self.worse or self.better):
            return f"{where}: {name} {self.old:.1f} -> {self.new:.1f} {unit}, within its interval"
        return (
            f"{where}: {name} is {'worse' if self.worse else 'better'} by {abs(self._gain):.1f} {unit} (95 % interval "
            f"{bounds[0]:.1f} to {bounds[1]:.1f}): {self.old:.1f} -> {self.new:.1f}"
        )


@dataclass(frozen=True)
class Gate:
    """The result of comparing scores with a baseline."""

    changes: tuple[Change, ...]  # Changes of all figures that could be compared
    refused: tuple[str, ...] = ()  # Figures that could not be compared, with reasons
    notes: tuple[str, ...] = ()  # New figures, and changed figures that have no interval and are therefore not judged

    @property
    def worse(self) -> tuple[Change, ...]:
        return tuple(change for change in self.changes if change.worse)

    @property
    def passed(self) -> bool:
        """Whether every figure of the baseline was compared and none is worse."""
        return not (self.worse or self.refused)

    def __str__(self) -> str:
        better = [change for change in self.changes if change.better]
        same = len(self.changes) - len(self.worse) - len(better)
        lines = [*map(str, self.worse), *map(str, better), *(f"not compared: {line}" for line in self.refused)]
        lines += [f"not judged: {line}" for line in self.notes]
        verdict = f"of {len(self.changes)} figures {len(self.worse)} are worse, {len(better)} better, {same} the same "
        verdict += "within their intervals" + (f"; {len(self.refused)} could not be compared" if self.refused else "")
        return "\n".join([*lines, f"{'passed' if self.passed else 'FAILED'}: {verdict}"])


def check_baseline(baseline: dict, options: dict, changed: Collection[str] = ()) -> None:
    """Raise ValueError if scores with `options`, save those `changed`, do not compare with a baseline."""
    _check_content(baseline, "baseline")
    refused = {}
    for name in sorted({*baseline["options"], *options}):
        old, new = (each.get(name, "not an option") for each in (baseline["options"], options))
        if old != new and not any(f"{name}.".startswith(f"{each}.") for each in changed):
            refused[name] = f"{name}={_text(old)} in the baseline, {_text(new)} here"
    if refused:
        groups = dict.fromkeys(name.partition(".")[0] for name in refused)
        short = refused if len(refused) <= _NAMED else groups
        raise ValueError(
            f"baseline: scores of other options are not compared: {listed([*refused.values()], _NAMED, '; ')}. "
            f"Use the same, or name the options or groups that you changed on purpose: changed=[{','.join(short)}]"
        )


def compare_scores(baseline: dict, scores: dict, changed: Collection[str] = ()) -> Gate:
    """Compare scores of `dmae evaluate` with a baseline, figure by figure, over the same blocks of time.

    A figure is worse, or better, if the 95 % interval of its difference excludes zero and the difference is large
    enough to be printed. `changed` names options, or groups of options, that differ on purpose. Raises ValueError if
    options, skeleton or clips differ, or either is not what `dmae evaluate` writes.
    """
    _check_content(scores, "scores")
    check_baseline(baseline, scores["options"], changed)
    differences = clip_differences(baseline["clips"], scores["clips"])
    if baseline["skeleton"] != scores["skeleton"]:
        differences.insert(0, f"skeleton {baseline['skeleton']} in the baseline, {scores['skeleton']} here")
    if differences:
        raise ValueError(f"baseline: scores of other data are not compared: {listed(differences, 5, '; ')}")
    before, after = ({(each["method"], each["views"]): each for each in part["results"]} for part in (baseline, scores))
    changes, refused = [], []
    notes = [f"{_where(*key)}: new, not in the baseline" for key in after if key not in before]
    for key, old in before.items():
        if key not in after:
            refused.append(f"{_where(*key)}: in the baseline, and not scored now")
            continue
        found, lacking = _changes(*key, old, after[key])
        changes += found
        refused += lacking
        notes += _without_interval(_where(*key), old, after[key])
    return Gate(tuple(changes), tuple(refused), tuple(notes))


def _check_content(scores: dict, what: str) -> None:
    """Raise ValueError if scores are not what `dmae evaluate` writes."""
    results: Any = scores.get("results") if isinstance(scores, dict) else None
    whole = isinstance(results, list) and {"options", "clips", "skeleton"} <= set(scores)
    for result in results if whole else ():
        whole = whole and isinstance(result, dict) and {"method", "views", "mean", "runs"} <= set(result)
        whole = whole and all("blocks" in run for run in result["runs"])
    if not whole:
        raise ValueError(
            f"{what}: expected the scores.json that dmae evaluate wrote, found other content, or scores of an "
            "earlier version; make them again: dmae evaluate ... out=FOLDER"
        )


def _changes(method: str, views: int, old: dict, new: dict) -> tuple[list[Change], list[str]]:
    where, changes, refused, short = _where(method, views), [], [], []
    pair = [sorted(each["runs"], key=_run) for each in (old, new)]
    if [*map(_run, pair[0])] != [*map(_run, pair[1])]:
        return [], [f"{where}: scored on other clips or subsets of cameras"]
    if [run["blocks"]["block"] for run in pair[0]] != [run["blocks"]["block"] for run in pair[1]]:
        return [], [f"{where}: the truth covers other times"]
    tables = [run_table(runs) for runs in pair]
    for figure, (name, unit, _, place) in FIGURES.items():
        counted = [table.loc[table["figure"] == figure, "count"].sum() > 0 for table in tables]
        if not all(counted):
            known = "here" if counted[1] else "in the baseline"
            refused += [f"{where}: {name}: measured {known} alone"] if any(counted) else []
            continue
        change = figure_score(tables[1], figure) - figure_score(tables[0], figure)
        before = reduce(getitem, place, old["mean"])
        low, high = change.interval
        if np.isnan(low):
            if abs(change.value) > _SMALLEST:
                short.append(f"{name} {before:.1f} -> {before + change.value:.1f} {unit}")
                continue
            low = high = 0.0
        changes.append(Change(method, views, figure, before, before + change.value, low, high))
    if short:
        refused.append(
            f"{where}: {', '.join(short)}: too little truth for intervals, which need 5 s in one clip, and 1 s "
            "more for each further clip"
        )
    return changes, refused


def _run(run: dict) -> tuple:
    return run["clip"], tuple(run["cameras"])


def _without_interval(where: str, old: dict, new: dict) -> list[str]:
    """Return the figures without an interval whose printed value changed, as text."""
    lines = []
    for metric in metrics():
        for column in metric.columns if metric.name not in FIGURES else ():
            values = (column.value(each["mean"][metric.name]) for each in (old, new) if metric.name in each["mean"])
            pair = [value for value in values if value is not None]
            if len(pair) == 2 and abs(pair[1] - pair[0]) > _SMALLEST:
                unit = f" {column.unit}" if column.unit else ""
                lines.append(f"{where}: {column.heading} {pair[0]:.1f} -> {pair[1]:.1f}{unit}, has no interval")
    return lines


def _where(method: str, views: int) -> str:
    return f"{method}, {views} views" if views else f"{method}, synthetic gaps"
