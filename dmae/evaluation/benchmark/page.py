"""Scores of a benchmark as tables, and as a page."""

import json
from itertools import product
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from dmae.evaluation.benchmark.clips import FrozenMatch
from dmae.evaluation.benchmark.holes import AXES
from dmae.files.contents import write_atomic
from dmae.reporting.figures import PERSONS
from dmae.reporting.page import CaptionedFigure, Section, write_report
from dmae.reporting.tables import Table, number_text

NOT_MEASURED = "not measured"
CHECKED = {
    FrozenMatch.equal: "The clips are byte for byte those of the published checksums.",
    FrozenMatch.near: "The clips are those that were frozen, up to how this processor rounds: scores differ in their "
    "last digits from those made elsewhere.",
    FrozenMatch.unchecked: "There are no published checksums: scores from other machines may be for other clips.",
}
"""Meaning of the values of `checksums` in scores."""
_MARKERS = "osD^vP*X<>h"


def benchmark_tables(scores: dict) -> dict[str, Table]:
    """Return the tables of a benchmark by name: `difficulty`, `levels`, `cause`, `frames`, `part`, `cells` and more."""
    completion = {name: entry["summary"] for name, entry in scores["completion"].items()}
    tables = {"difficulty": _difficulty(scores)}
    if completion:
        tables["levels"] = _levels(scores, completion)
        tables |= {axis: _by_axis(scores, completion, axis) for axis in AXES}
        tables["cells"] = _cells(scores, completion)
        if any(each["held"] is not None for each in completion.values()):
            tables["regions"] = _regions(completion)
    if scores["capture"]:
        tables["captures"] = _captures(scores)
    if scores.get("differences"):
        tables["differences"] = _differences(scores["differences"])
    return tables


def write_scores(scores: dict, folder: Path) -> None:
    """Write `scores.json` and `benchmark.html`: the tables, and figures of the error by level and length of holes."""
    write_atomic(folder / "scores.json", json.dumps(scores))
    completion = {name: entry["summary"] for name, entry in scores["completion"].items() if entry["summary"]["mm"]}
    best = min(completion, key=lambda name: completion[name]["mm"]["value"], default=None)
    clips = sum(level["clips"] for level in scores["levels"])
    text = (
        f"{clips} clips, made from a definition and its seed. Holes are the joints of captured persons that capture "
        "did not measure; every method fills the same ones. Errors are means over levels."
    )
    if best:
        mm = completion[best]["mm"]["value"]
        text += f" Of {len(completion)} methods {best} has the smallest error of holes, {mm:.1f} mm."
    text += f" {CHECKED[scores['checksums']]}"
    figures = []
    if completion:
        levels = [level["name"] for level in scores["levels"]]
        figures = [
            CaptionedFigure(
                "Mean error of holes by level.", _figure(completion, levels, lambda each: each["levels"], "level")
            ),
            CaptionedFigure(
                "Mean error of holes by their length.",
                _figure(completion, AXES["frames"], lambda each: list(each["frames"].values()), "frames at 25/s"),
            ),
        ]
    heading = f"{scores['benchmark']}, {scores['size']}"
    sections = [Section(heading, text, tables=[*benchmark_tables(scores).values()], figures=figures)]
    write_report(folder / "benchmark.html", f"Benchmark {scores['benchmark']}", sections)


def _difficulty(scores: dict) -> Table:
    rows = []
    for number, level in enumerate(scores["levels"], 1):
        main = max(level["causes"], key=lambda name: level["causes"][name] or 0)
        rows.append((
            f"{number} {level['name']}", str(level["clips"]), str(level["persons"]),
            *map(number_text, (level["hidden"], level["linear"])), f"{main} {number_text(level['causes'][main])}",
            number_text(level["uncaptured"]),
        ))  # fmt: skip
    header = ("level", "clips", "people", "unmeasured %", "linear mm", "main cause %", "missed people %")
    return Table("Difficulty: true joints that capture did not measure, and linear filling of them", header, rows)


def _levels(scores: dict, completion: dict) -> Table:
    header = ("method", "mm", "95 % interval", *(level["name"] for level in scores["levels"]), "filled %", "seen mm")
    rows = []
    for name, each in completion.items():
        if each["mm"] is None:
            rows.append((name, NOT_MEASURED, *[""] * (len(header) - 3), number_text(each["seen"])))
            continue
        low, high = each["mm"]["low"], each["mm"]["high"]
        interval = "-" if low is None else f"{low:.1f} to {high:.1f}"
        rows.append((
            name, number_text(each["mm"]["value"]), interval,
            *map(number_text, (*each["levels"], each["filled"], each["seen"])),
        ))  # fmt: skip
    return Table("Mean error of holes, mm: mean over levels, and by level", header, rows)


def _by_axis(scores: dict, completion: dict, axis: str) -> Table:
    titles = {"cause": "by what made them", "frames": "by their length in frames at 25/s", "part": "by body part"}
    rows = [
        (name, *(number_text(each[axis][column]) for column in AXES[axis])) if each[axis] else (name, NOT_MEASURED)
        for name, each in completion.items()
    ]
    counts = _holes(scores).sum(tuple(number for number, other in enumerate(AXES) if other != axis))
    rows.append(("holes", *map(str, counts)))
    return _padded(Table(f"Mean error of holes, mm, {titles[axis]}", ("method", *AXES[axis]), rows))


def _cells(scores: dict, completion: dict) -> Table:
    """A row for each cause, length and body part that has holes."""
    holes = _holes(scores).ravel()
    rows = []
    for number, (cause, frames, part) in enumerate(product(*AXES.values())):
        if holes[number]:
            found = [number_text(each["cells"][number]) if each["cells"] else "-" for each in completion.values()]
            rows.append((f"{cause} {frames} {part}", str(holes[number]), *found))
    header = ("cause, frames, part", "holes", *completion)
    return Table("Mean error of holes, mm, by cause, length and body part", header, rows)


def _regions(completion: dict) -> Table:
    rows = [
        (name, *map(number_text, (each["held"], *each["held_frames"].values(), *each["held_cause"].values())))
        for name, each in completion.items()
        if each["held"] is not None
    ]
    header = ("method", "all", *AXES["frames"], *AXES["cause"])
    return Table("Filled holes within the 90 % regions that methods state, %", header, rows)


def _captures(scores: dict) -> Table:
    keys = {
        "pcp": "PCP %", "seen_near": "seen %", "seen_mm": "seen mm", "near": "unseen %", "mm": "unseen mm",
        "found": "given %", "extra": "extra people %",
    }  # fmt: skip
    rows = []
    for name, entry in scores["capture"].items():
        each = entry["summary"]
        measured = each["pcp"] is not None
        rows.append((name, *(map(number_text, (each[key] for key in keys)) if measured else (NOT_MEASURED,))))
    caption = (
        "From detections to poses: strict PCP; joints within 0.1 m, and mean error of those given, that two cameras or "
        "more saw (seen) and that fewer saw (unseen); the share of the unseen that were given a place"
    )
    return _padded(Table(caption, ("capture", *keys.values()), rows))


def _differences(found: list[dict]) -> Table:
    rows = []
    for each in found:
        value, low, high = each["mm"].values()
        verdict = "-" if low is None else "no difference shown"
        if each["shown"]:
            verdict = "worse" if value > 0 else "better"
        interval = "-" if low is None else f"{low:+.1f} to {high:+.1f}"
        rows.append((each["method"], each["against"], f"{value:+.1f}", interval, verdict))
    header = ("method", "earlier", "mm", "95 % interval", "")
    return Table("Against earlier scores: difference of the mean error of holes, mm, on the same clips", header, rows)


def _figure(completion: dict, classes: list[str], values, label: str) -> Figure:
    figure = Figure(figsize=(8.2, 3.6), layout="constrained")
    axes = figure.subplots()
    for number, (name, each) in enumerate(completion.items()):
        found = [np.nan if value is None else value for value in values(each)]
        style = {"color": PERSONS[number % len(PERSONS)], "marker": _MARKERS[number % len(_MARKERS)]}
        axes.plot(range(len(classes)), found, label=name, markersize=5, **style)
    axes.set_xticks(range(len(classes)), classes)
    axes.set(xlabel=label, ylabel="mean error [mm]")
    axes.set_ylim(bottom=0)
    axes.grid(color="#dddddd", linewidth=0.5)
    figure.legend(loc="outside right upper", frameon=False)
    return figure


def _holes(scores: dict) -> np.ndarray:
    """Return the number of holes of each cell, over all clips."""
    return np.reshape(scores["holes"], [len(classes) for classes in AXES.values()])


def _padded(table: Table) -> Table:
    rows = [(*row, *[""] * (len(table.header) - len(row))) for row in table.rows]
    return Table(table.caption, table.header, rows)
