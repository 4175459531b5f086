"""The results of a stress matrix in words, tables and curves, and the page that shows them."""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from dmae.data.json_values import json_text
from dmae.evaluation.corruption.registry import find_corruption
from dmae.evaluation.stress.matrix import HIDDEN_ERROR, PCP_DROP
from dmae.files.contents import write_atomic
from dmae.reporting.figures import plain
from dmae.reporting.page import CaptionedFigure, Section, write_report
from dmae.reporting.tables import Table, counted

_LISTED = 8  # Names in a sentence, at most
_REFERENCES = {
    "truth": "Results are compared with the truth of the clips.",
    "capture": "The clips have no truth. Results are compared with the joints that all cameras measured in three views "
    "or more before anything was corrupted.",
}


def summary(result: dict) -> list[str]:
    """Return the results in sentences: the comparison, the axes on which methods do not break, and the best method."""
    clips, axes = result["clips"], result["axes"]
    sentences = [
        f"{counted(len(result['methods']), 'method')} on {counted(len(clips), 'clip')} ({_listed(clips)}), "
        f"{counted(len(axes), 'corruption')}. {_REFERENCES[result['reference']]}"
    ]
    # A capture that fails without any corruption does not fall by 10 points more, and so never breaks.
    starts = {name: at["points"][0]["pcp"][0] for name, at in axes[0]["methods"].items()} if axes else {}
    if known := [f"{name} {pcp:.1f}" for name, pcp in starts.items() if pcp is not None]:
        sentences.append(f"PCP before any corruption, in %: {', '.join(known)}.")
    broken = Counter({axis["name"]: len(axis["methods"]) - len(_unbroken(axis)) for axis in axes})
    if worst := [f"{name} ({number} of {len(result['methods'])})" for name, number in broken.most_common(3) if number]:
        sentences.append(f"These corruptions break the most methods: {_listed(worst)}.")
    harmless = [axis["name"] for axis in axes if _unbroken(axis) == set(axis["methods"])]
    if harmless:
        sentences.append(f"No method breaks over the whole range of {_listed(harmless)}.")
    held = [f"{name} {sum(name in _unbroken(axis) for axis in axes)}" for name in result["methods"]]
    sentences.append(f"Of {counted(len(axes), 'corruption')}, this many do not break a method: {', '.join(held)}.")
    alone = [axis for axis in axes if axis["best"] and axis["level_with"] == [] and len(axis["methods"]) > 1]
    best = Counter(axis["best"] for axis in alone)
    for name, number in best.most_common():
        sentences.append(f"At the greatest level, {name} is better than every other method, beyond noise, on {number}.")
    level = sum(bool(axis["level_with"]) for axis in axes)
    if level:
        sentences.append(f"On {level}, other methods are within noise of the best.")
    if any(axis["level_with"] is None for axis in axes):
        sentences.append(
            "The clips are too short for intervals: expected five seconds or more, and one more for each further clip."
        )
    return sentences


def breaking_tables(result: dict) -> list[Table]:
    """Return two tables of the levels at which methods break, by PCP and by unmeasured joints; a row for each axis."""
    captions = {
        "pcp": f"Level at which PCP of the method is {PCP_DROP:g} points lower than on the uncorrupted clips",
        "hidden": f"Level at which the mean error of unmeasured joints passes {HIDDEN_ERROR:g} mm",
    }
    intervals = any(axis["level_with"] is not None for axis in result["axes"])
    return [
        Table(
            f"{caption}{_INTERVAL if intervals else ''}; > is beyond the range",
            ("corruption", "unit", *result["methods"]),
            [
                (axis["name"], axis["unit"], *(_break(axis, name, figure) for name in result["methods"]))
                for axis in result["axes"]
            ],
        )
        for figure, caption in captions.items()
    ]


def best_table(result: dict) -> Table:
    """Return a table of the best method at the greatest level of each axis."""
    rows = []
    for axis in result["axes"]:
        points = [method["points"][-1] for method in axis["methods"].values()]
        best = axis["best"] and axis["methods"][axis["best"]]["points"][-1]["pcp"]
        near = axis["level_with"]
        others = "not known" if near is None else _listed(near) if near else "no other method" if axis["best"] else ""
        rows.append((axis["name"], f"{points[0]['level']:g} {axis['unit']}", axis["best"] or "-", _value(best), others))
    header = ("corruption", "greatest level", "best", "PCP %", "within noise of it")
    return Table("The best method by PCP at the greatest level", header, rows)


def angle_tables(result: dict) -> list[Table]:
    """Return a table of the error of angles at level 0 and at the greatest level of each axis; none if not scored."""
    ends = [
        (axis["name"], [axis["methods"][name]["points"][end] for name in result["methods"]], axis["unit"])
        for axis in result["axes"]
        for end in ((0, -1) if axis is result["axes"][0] else (-1,))
    ]
    if not any("angles" in point for _, points, _ in ends for point in points):
        return []
    rows = [
        (name, f"{points[0]['level']:g} {unit}", *(_value(each.get("angles")) for each in points))
        for name, points, unit in ends
    ]
    caption = "Mean error of hip, knee and ankle angles, degrees, with 95 % interval"
    return [Table(caption, ("corruption", "level", *result["methods"]), rows)]


def pair_tables(result: dict) -> list[Table]:
    """Return a table of PCP for each pair of axes, a row for each two levels."""
    return [
        Table(
            f"PCP, %, with both {pair['names'][0]} ({pair['units'][0]}) and {pair['names'][1]} ({pair['units'][1]})",
            (*pair["names"], *result["methods"]),
            [
                (
                    *(f"{level:g}" for level in point["levels"]),
                    *(_value(each["pcp"]) for each in point["methods"].values()),
                )
                for point in pair["points"]
            ],
        )
        for pair in result["pairs"]
    ]


def breaking_sentence(axis: dict) -> str:
    """Return a sentence with the level at which each method breaks on an axis."""
    breaks = {name: method["breaks"]["pcp"] for name, method in axis["methods"].items()}
    broken = [name for name, found in breaks.items() if found and found[0] is not None]
    parts = [f"{name} breaks at {_break(axis, name, 'pcp')}" for name in broken]
    if held := [name for name in breaks if name in _unbroken(axis)]:
        parts.append(f"{_listed(held)} hold{'s' if len(held) == 1 else ''} over the whole range")
    if unknown := [name for name, found in breaks.items() if found is None]:
        parts.append(f"not measured: {_listed(unknown)}")
    return f"By PCP, in {axis['unit']}: {'; '.join(parts)}."


def _unbroken(axis: dict) -> set[str]:
    breaks = {name: method["breaks"]["pcp"] for name, method in axis["methods"].items()}
    return {name for name, found in breaks.items() if found is not None and found[0] is None}


def _break(axis: dict, name: str, figure: str) -> str:
    method = axis["methods"][name]
    found, most = method["breaks"][figure], method["points"][-1]["level"]
    if found is None:
        return "-"
    level, low, high = (f"> {most:g}" if value is None else f"{value:.2g}" for value in found)
    return level if found[1] is None else f"{level} ({low} to {high})"


def _value(interval: Sequence[float | None] | None) -> str:
    if not interval or interval[0] is None:
        return "-"
    value, low, high = interval
    return f"{value:.1f}" if low is None else f"{value:.1f} ({low:.1f} to {high:.1f})"


def _listed(names: Sequence[str]) -> str:
    shown = [*names[:_LISTED], *([f"{len(names) - _LISTED} more"] if len(names) > _LISTED else [])]
    return shown[0] if len(shown) == 1 else f"{', '.join(shown[:-1])} and {shown[-1]}"


_INTERVAL = ", with 95 % interval"
_COLOURS = ("#000000", "#e69f00", "#56b4e9", "#009e73", "#cc79a7", "#d55e00", "#0072b2", "#777777")
"""Colours of Okabe and Ito, which colour-blind readers can distinguish. Yellow is hard to see on white; grey replaces
it."""
_MARKERS = "osD^vP*X"


def axis_figure(axis: dict) -> Figure:
    """Draw all methods' PCP and error of unmeasured joints along one of the `axes` of `curves`."""
    figure = Figure(figsize=(11.5, 3.6), layout="constrained")
    left, right = figure.subplots(1, 2)
    _draw(left, axis, "pcp")
    _draw(right, axis, "hidden")
    left.set(ylabel="PCP [%]", ylim=(min(left.get_ylim()[0], 90), 101))
    right.set(ylabel="error of unmeasured joints [mm]", ylim=(0, None))
    right.axhline(HIDDEN_ERROR, color="#999999", linewidth=0.8, linestyle=":")
    if all(point["hidden"][0] is None for method in axis["methods"].values() for point in method["points"]):
        right.set(ylim=(0, 1.2 * HIDDEN_ERROR))
        right.text(0.5, 0.5, "no unmeasured joint was filled", transform=right.transAxes, ha="center", fontsize=9)
    for panel in (left, right):
        panel.set_xlabel(axis["unit"] if axis["name"] in axis["unit"] else f"{axis['name']} [{axis['unit']}]")
        plain(panel)
    figure.legend(*left.get_legend_handles_labels(), loc="outside right upper", frameon=False)
    return figure


def _draw(panel: Axes, axis: dict, figure: str) -> None:
    for number, (name, method) in enumerate(axis["methods"].items()):
        levels = [point["level"] for point in method["points"]]
        value, low, high = np.array([point[figure] for point in method["points"]], float).T
        style: dict = {"color": _COLOURS[number % len(_COLOURS)], "zorder": 3}
        panel.plot(
            levels, value, f"{_MARKERS[number % len(_MARKERS)]}-", markersize=4.5, linewidth=1.6, label=name, **style
        )
        panel.fill_between(levels, low, high, color=style["color"], alpha=0.13, linewidth=0)
    panel.set_xticks(sorted({point["level"] for method in axis["methods"].values() for point in method["points"]}))
    panel.xaxis.set_major_formatter("{x:g}")


_MEASURED = (
    "Strict PCP, one-to-one matching within 0.5 m. Unmeasured joints are the joints that the capture of the method did "
    "not measure, of people that it found; the error is over those that the method filled. Intervals are "
    "of 95 %, from resampled whole seconds; they describe other moments of these clips, not other clips. Level 0 is "
    f"the original clip. A method breaks where its PCP is {PCP_DROP:g} points below its own at level 0, or where the "
    f"mean error of unmeasured joints exceeds {HIDDEN_ERROR:g} mm, interpolated linearly between levels."
)


def write_result(result: dict, out: Path) -> None:
    """Write `stress.json` and the page `stress.html`."""
    write_atomic(out / "stress.json", json_text(result))
    compared, *found = summary(result)
    paragraphs = [compared, " ".join(found)]
    write_report(out / "stress.html", "What breaks the methods", page_sections(result), summary=paragraphs)


def page_sections(result: dict) -> list[Section]:
    """Return the sections of the page."""
    found = [
        Section("Where methods break", tables=[*breaking_tables(result), best_table(result), *angle_tables(result)])
    ]
    for axis in result["axes"]:
        bands = " Bands are 95 % intervals." * (axis["level_with"] is not None)
        caption = f"PCP and mean error of unmeasured joints by level of {axis['name']}.{bands}"
        figure = CaptionedFigure(caption, axis_figure(axis))
        found.append(Section(axis["name"], f"{_documentation(axis)} {breaking_sentence(axis)}", figures=[figure]))
    if result["pairs"]:
        found.append(Section("Two corruptions", "PCP with two corruptions together.", tables=pair_tables(result)))
    methods = Table("Methods", ("method", "description"), list(result["methods"].items()))
    found.append(Section("How this was measured", " ".join([_MEASURED, *result["notes"]]), tables=[methods]))
    return found


def _documentation(axis: dict) -> str:
    """Return the first two paragraphs of a corruption's docstring, or its line of help if it is not installed."""
    try:
        text = find_corruption(axis["name"]).function.__doc__ or ""
    except ValueError:
        return axis["about"]
    return " ".join(" ".join(text.split("\n\n")[:2]).split())
