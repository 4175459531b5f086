"""Degradation curves: the scores of each method along an axis, with bands of 95 % and names at the ends of lines."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.optimize import isotonic_regression

from dmae.evaluation.stress.curves import HIDDEN_ERROR

_COLOURS = ("#000000", "#e69f00", "#56b4e9", "#009e73", "#cc79a7", "#d55e00", "#0072b2", "#777777")
"""Colours of Okabe and Ito, which colour-blind readers can distinguish. Yellow is hard to see on white; grey replaces
it."""
_MARKERS = "osD^vP*X"
_APART = 0.075
"""Smallest distance between two names, as a share of the height of a panel."""


def axis_figure(axis: dict) -> Figure:
    """Draw PCP and the error of hidden joints of all methods along an axis.

    Args:
        axis: One of the `axes` that `dmae.evaluation.stress.curves.curves` returned.
    """
    figure = Figure(figsize=(11.5, 3.6), layout="constrained")
    left, right = figure.subplots(1, 2)
    _draw(left, axis, "pcp")
    _draw(right, axis, "hidden")
    left.set(ylabel="PCP [%]", ylim=(min(left.get_ylim()[0], 90), 101))
    right.set(ylabel="error of hidden joints [mm]", ylim=(0, None))
    right.axhline(HIDDEN_ERROR, color="#999999", linewidth=0.8, linestyle=":")
    for panel, which in ((left, "pcp"), (right, "hidden")):
        panel.set_xlabel(axis["unit"] if axis["name"] in axis["unit"] else f"{axis['name']} [{axis['unit']}]")
        panel.grid(color="#dddddd", linewidth=0.5)
        panel.spines[["top", "right"]].set_visible(False)
        _name_lines(panel, axis, which)
    return figure


def _draw(panel: Axes, axis: dict, figure: str) -> None:
    for number, (name, method) in enumerate(axis["methods"].items()):
        levels = [point["level"] for point in method["points"]]
        value, low, high = np.array([point[figure] for point in method["points"]], float).T
        style = {"color": _COLOURS[number % len(_COLOURS)], "zorder": 3}
        panel.plot(
            levels, value, f"{_MARKERS[number % len(_MARKERS)]}-", markersize=4.5, linewidth=1.6, label=name, **style
        )
        panel.fill_between(levels, low, high, color=style["color"], alpha=0.13, linewidth=0)
    panel.set_xticks(sorted({point["level"] for method in axis["methods"].values() for point in method["points"]}))
    panel.xaxis.set_major_formatter("{x:g}")


def _name_lines(panel: Axes, axis: dict, figure: str) -> None:
    """Write the name of each method at the end of its line. Names that would overlap are moved apart."""
    low, high = panel.get_ylim()
    ends = []
    for number, (name, method) in enumerate(axis["methods"].items()):
        known = [(point["level"], point[figure][0]) for point in method["points"] if point[figure][0] is not None]
        if known:
            ends.append(((known[-1][1] - low) / (high - low), known[-1], name, _COLOURS[number % len(_COLOURS)]))
    ends.sort(key=lambda end: end[0])
    heights = _apart([end[0] for end in ends])
    for height, (_, place, name, colour) in zip(heights, ends, strict=True):
        panel.annotate(
            name, place, (1.03, height), "data", "axes fraction", color=colour, fontsize=9, va="center",
            arrowprops={"arrowstyle": "-", "color": colour, "linewidth": 0.5, "shrinkA": 0, "shrinkB": 3},
        )  # fmt: skip


def _apart(heights: list[float]) -> np.ndarray:
    """Return increasing heights in [0, 1], at least `_APART` from each other, as near as possible to the given ones."""
    if not heights:
        return np.empty(0)
    least = _APART * np.arange(len(heights))
    return np.clip(isotonic_regression(np.array(heights) - least).x, 0, 1 - least[-1]) + least
