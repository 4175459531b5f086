"""A figure of the histograms of a data set."""

import io

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from dmae.data.labels import Visibility
from synth.datasets.statistics.histograms import QUANTITIES, Statistics

_CAUSES = {
    Visibility.VISIBLE: ("visible", "#3c9d4e"),
    Visibility.HIDDEN_BY_SELF: ("hidden by self", "#f2c14e"),
    Visibility.HIDDEN_BY_PERSON: ("by a person", "#d1495b"),
    Visibility.HIDDEN_BY_OBJECT: ("by an object", "#3066be"),
    Visibility.OUTSIDE_IMAGE: ("outside the image", "#b8b8b8"),
    Visibility.BEHIND_CAMERA: ("behind the camera", "#8a8a8a"),
}
_BARS = "#2f6f9f"


def draw(found: Statistics) -> bytes:
    """Return a figure as PNG: joints by cause of occlusion, and one panel for each of `QUANTITIES`."""
    figure = Figure(figsize=(13, 9.5), layout="constrained")
    grid = figure.add_gridspec(4, 4)
    _draw_causes(figure.add_subplot(grid[:, 0]), found)
    places = [(row, column) for row in range(4) for column in (1, 2, 3)]
    for (row, column), quantity in zip(places, QUANTITIES.values(), strict=False):
        axes = figure.add_subplot(grid[row, column])
        axes.set_title(f"{quantity.meaning}{f' [{quantity.unit}]' if quantity.unit else ''}", fontsize=8)
        axes.set_yticks([])
        axes.spines[["top", "left", "right"]].set_visible(False)
        axes.tick_params(labelsize=8)
        counts = found.histograms.get(quantity.name)
        if counts is None or not counts.sum():
            _say_not_measured(axes)
            continue
        used = np.flatnonzero(counts)
        axes.stairs(counts / counts.sum(), quantity.edges, fill=True, color=_BARS)
        axes.set_xlim(quantity.edges[used[0]], quantity.edges[used[-1] + 1])
        axes.xaxis.set_major_locator(MaxNLocator("auto", integer=quantity.edges[0] == -0.5))
    panel = figure.add_subplot(grid[3, 2:])
    _draw_occluders(panel, found)
    file = io.BytesIO()
    figure.savefig(file, format="png", dpi=110)
    return file.getvalue()


def _draw_causes(axes: Axes, found: Statistics) -> None:
    axes.set_title("joints in views, by cause", fontsize=9)
    axes.spines[["top", "right", "left"]].set_visible(False)
    if found.causes is None:
        _say_not_measured(axes)
        return
    judged = found.causes[:, : Visibility.ABSENT]
    shares = judged / np.maximum(judged.sum(1, keepdims=True), 1)
    rows, left = np.arange(len(found.joints)), np.zeros(len(found.joints))
    for cause, (name, colour) in _CAUSES.items():
        axes.barh(rows, shares[:, cause], left=left, color=colour, label=name)
        left += shares[:, cause]
    axes.set(xlim=(0, 1), ylim=(len(rows) - 0.5, -0.5), yticks=rows)
    axes.set_yticklabels([joint.replace("_", " ") for joint in found.joints], fontsize=8)
    axes.xaxis.set_major_formatter("{x:.0%}")
    axes.tick_params(labelsize=8)
    axes.legend(loc="upper center", bbox_to_anchor=(0.4, -0.03), ncols=2, frameon=False, fontsize=8)


def _draw_occluders(axes: Axes, found: Statistics) -> None:
    axes.set_title("what hides joints", fontsize=8)
    axes.spines[["top", "right", "left"]].set_visible(False)
    axes.set_xticks([])
    if not found.occluders.total():
        _say_not_measured(axes)
        return
    common = [(name, count) for name, count in found.occluders.most_common(8) if count]
    total = found.occluders.total()
    axes.barh(range(len(common)), [count / total for _, count in common], color=_BARS)
    for row, (_, count) in enumerate(common):
        axes.text(count / total, row, f" {count / total:.0%}", va="center", fontsize=8)
    axes.set(yticks=range(len(common)), ylim=(len(common) - 0.5, -0.5))
    axes.set_yticklabels([name for name, _ in common], fontsize=8)


def _say_not_measured(axes: Axes) -> None:
    axes.text(0.5, 0.5, "not measured", ha="center", va="center", transform=axes.transAxes, color="#888888")
    axes.set(xticks=[], yticks=[])
