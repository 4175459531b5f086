"""Scores of a benchmark as tables, and as a page."""

import json
from collections.abc import Collection
from itertools import product
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from dmae.evaluation.benchmark.clips import FrozenMatch
from dmae.evaluation.benchmark.holes import ANGLE_AXES, AXES, SHAPE
from dmae.files.contents import write_atomic
from dmae.reporting.figures import PERSONS, plain
from dmae.reporting.page import CaptionedFigure, Section, write_report
from dmae.reporting.tables import Table, number_text

NOT_MEASURED = "not measured"
CHECKED = {
    FrozenMatch.equal: "The clips have the published checksums.",
    FrozenMatch.near: "The clips are those that were frozen, up to how this processor rounds: scores differ in their "
    "last digits from those made elsewhere.",
    FrozenMatch.unchecked: "There are no published checksums: scores from other machines may be for other clips.",
}
"""Meaning of the values of `checksums` in scores."""
_TITLES = {
    "cause": "by what made them, in the clips of all levels",
    "frames": "by their length in frames at 25/s",
    "part": "by body part",
}
_MARKERS = "osD^vP*X<>h"


def benchmark_tables(scores: dict) -> dict[str, Table]:
    """Return the tables of a benchmark by name: `difficulty`, `levels`, `cause`, `frames`, `part`, `cells` and more."""
    tables = {"difficulty": _difficulty(scores)}
    if scores["completion"]:
        tables |= _completion_tables(scores) | _angle_tables(scores)
    if scores["capture"]:
        tables["captures"] = _captures(scores)
    if scores.get("differences"):
        tables["differences"] = _differences(scores["differences"])
    return tables


def write_scores(scores: dict, folder: Path) -> None:
    """Write `scores.json` and `benchmark.html`: the tables, and figures of the error by level and length of gaps."""
    write_atomic(folder / "scores.json", json.dumps(scores))
    completion = {name: entry["summary"] for name, entry in scores["completion"].items() if entry["summary"]["mm"]}
    best = min(completion, key=lambda name: completion[name]["mm"]["value"], default=None)
    clips = sum(level["clips"] for level in scores["levels"])
    text = (
        f"{clips} clips, made from a definition and its seed. A gap is a run of frames in which capture did not "
        "measure a joint of a captured person; every method fills the same ones. Errors are means over levels."
    )
    if best:
        mm = completion[best]["mm"]["value"]
        text += f" Of {len(completion)} methods {best} has the smallest error in gaps, {mm:.1f} mm."
    text += f" {CHECKED[scores['checksums']]}"
    figures = []
    if completion:
        levels = [level["name"] for level in scores["levels"]]
        figures = [
            CaptionedFigure(
                "Mean error in gaps by level.", _figure(completion, levels, lambda each: each["levels"], "level")
            ),
            CaptionedFigure(
                "Mean error in gaps by their length.",
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


def _completion_tables(scores: dict) -> dict[str, Table]:
    completion = {name: entry["summary"] for name, entry in scores["completion"].items()}
    names = [level["name"] for level in scores["levels"]]
    header = ("method", "mm", "95 % interval", *names, "filled %", "measured mm")
    rows = []
    for name, each in completion.items():
        if each["mm"] is None:
            rows.append((name, NOT_MEASURED, *[""] * (len(header) - 3), number_text(each["seen"])))
            continue
        figures = map(number_text, (*each["levels"], each["filled"], each["seen"]))
        rows.append((name, number_text(each["mm"]["value"]), _interval(each["mm"]), *figures))
    tables = {
        "levels": Table(
            "Mean error in gaps, mm: mean over levels, and of all gaps in the clips of each level", header, rows
        )
    }
    holes = np.reshape(scores["holes"], SHAPE)
    for number, (axis, title) in enumerate(_TITLES.items()):
        classes = _causes(scores) if axis == "cause" else AXES[axis]
        rows = [
            (name, *([number_text(each[axis][one]) for one in classes] if each[axis] else _unmeasured(classes)))
            for name, each in completion.items()
        ]
        joints = dict(zip(AXES[axis], holes.sum(tuple({0, 1, 2} - {number})), strict=True))
        rows.append(("joints", *(str(joints[one]) for one in classes)))
        tables[axis] = Table(f"Mean error in gaps, mm, {title}", ("method", *classes), rows)
    rows = []
    for number, cell in enumerate(product(*AXES.values())):
        if holes.flat[number]:
            found = (number_text(each["cells"][number]) if each["cells"] else "-" for each in completion.values())
            rows.append((" ".join(cell), str(holes.flat[number]), *found))
    header = ("cause, frames, part", "joints", *completion)
    tables["cells"] = Table("Mean error in gaps, mm, by cause, length and body part", header, rows)
    rows = [
        (
            name,
            *map(number_text, (each["held"], *each["held_frames"].values())),
            *(number_text(each["held_cause"][one]) for one in _causes(scores)),
        )
        for name, each in completion.items()
        if each["held"] is not None
    ]
    if rows:
        header = ("method", "all", *AXES["frames"], *_causes(scores))
        tables["regions"] = Table("Filled joints within the 90 % regions that methods state, %", header, rows)
    return tables


def _angle_tables(scores: dict) -> dict[str, Table]:
    summaries = {name: entry["summary"] for name, entry in scores["completion"].items()}
    turned = {name: each["angles"] for name, each in summaries.items() if "angles" in each}
    if not turned:
        return {}
    levels = [level["name"] for level in scores["levels"]]
    rows = []
    for name, each in turned.items():
        figures = (*each["levels"], *each["angle"].values(), each["determined"], each["held"])
        rows.append(
            (name, number_text(each["degrees"]["value"]), _interval(each["degrees"]), *map(number_text, figures))
        )
    caption = "Mean error of joint angles of the legs, degrees: mean over levels, by level, and by joint"
    header = ("method", "°", "95 % interval", *levels, *ANGLE_AXES["angle"], "determined %", "in 90 % interval")
    (_, *lengths), causes = ANGLE_AXES["unmeasured"], _causes(scores)
    by_hole = [
        (name, *(number_text(each["unmeasured"][one]) for one in ("none", *lengths)),
         *(number_text(each["by"][one]) for one in causes))
        for name, each in turned.items()
    ]  # fmt: skip
    title = "Mean error of joint angles of the legs, degrees, by the longest gap among the joints that show them"
    return {
        "angles": Table(caption, header, rows),
        "angle_holes": Table(title, ("method", "no gap", *lengths, *causes), by_hole),
    }


def _causes(scores: dict) -> list[str]:
    """Return the causes of gaps in the order of the levels that are called after them, others behind."""
    levels = [level["name"] for level in scores["levels"]]
    return sorted(AXES["cause"], key=lambda cause: levels.index(cause) if cause in levels else len(levels))


def _captures(scores: dict) -> Table:
    keys = {
        "pcp": "PCP %", "seen_near": "seen %", "seen_mm": "seen mm", "near": "unseen %", "mm": "unseen mm",
        "found": "given %", "extra": "extra people %",
    }  # fmt: skip
    rows = []
    for name, entry in scores["capture"].items():
        each = entry["summary"]
        measured = each["pcp"] is not None
        rows.append((name, *(map(number_text, (each[key] for key in keys)) if measured else _unmeasured(keys))))
    caption = (
        "From detections to poses: strict PCP; joints within 0.1 m, and mean error of those given, that two cameras or "
        "more saw (seen) and that fewer saw (unseen); the share of the unseen that were given a place"
    )
    return Table(caption, ("capture", *keys.values()), rows)


def _interval(score: dict) -> str:
    return "-" if score["low"] is None else f"{score['low']:.1f} to {score['high']:.1f}"


def _unmeasured(columns: Collection[str]) -> list[str]:
    return [NOT_MEASURED, *[""] * (len(columns) - 1)]


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
    return Table("Against earlier scores: difference of the mean error in gaps, mm, on the same clips", header, rows)


def _figure(completion: dict, classes: list[str], values, label: str) -> Figure:
    figure = Figure(figsize=(8.2, 3.6), layout="constrained")
    axes = figure.subplots()
    for number, (name, each) in enumerate(completion.items()):
        found = [np.nan if value is None else value for value in values(each)]
        style: dict = {"color": PERSONS[number % len(PERSONS)], "marker": _MARKERS[number % len(_MARKERS)]}
        axes.plot(range(len(classes)), found, label=name, markersize=5, **style)
    axes.set_xticks(range(len(classes)), classes)
    axes.set(xlabel=label, ylabel="mean error [mm]")
    axes.set_ylim(bottom=0)
    plain(axes)
    figure.legend(loc="outside right upper", frameon=False)
    return figure
