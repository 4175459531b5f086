"""The figure and the page that compare recorded with generated motion."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator
from scipy.ndimage import gaussian_filter1d

from dmae.reporting.page import CaptionedFigure, Section, write_report
from dmae.reporting.tables import Table
from synth.datasets.motion_realism import Difference, Sample
from synth.motion.kinematics import GROUPS, Quantity

_FAR = 2.0
"""Distances above this multiple of the distance between halves of the recordings are highlighted."""
_BINS = 48
_REAL, _SIM, _INK, _MUTED = "#a9b8c6", "#d9541e", "#1d2733", "#55606c"


def draw(real: Sequence[Sample], sim: Sequence[Sample], differences: Sequence[Difference]) -> Figure:
    """Draw both distributions of every quantity, in rows by `GROUPS`. Values outside an axis are left out."""
    found = {difference.quantity.name: difference for difference in differences}
    figure = Figure(figsize=(13.5, 1.9 * len(GROUPS) + 0.7))
    panels, height = figure.subplots(len(GROUPS), 5), figure.get_figheight()
    figure.subplots_adjust(
        left=0.015, right=0.985, bottom=0.35 / height, top=1 - 1.25 / height, hspace=0.95, wspace=0.16
    )
    for row, (group, quantities) in zip(panels, GROUPS.items(), strict=True):
        words = {"fontsize": 11, "fontweight": "bold", "color": _INK}
        row[0].annotate(group, (0, 1), (0, 24), "axes fraction", "offset points", **words)
        for axes, quantity in zip(row, quantities, strict=True):
            _draw_panel(axes, quantity, real, sim, found.get(quantity.name))
    names = (f"recorded: {_counted(real)}", f"simulated: {_counted(sim)}")
    handles = [Patch(facecolor=_REAL, label=names[0]), Line2D([], [], color=_SIM, linewidth=1.8, label=names[1])]
    words = {"frameon": False, "fontsize": 11, "labelcolor": _INK, "borderaxespad": 0, "borderpad": 0}
    figure.legend(handles=handles, loc="upper left", bbox_to_anchor=(0.015, 1 - 0.12 / height), ncols=2, **words)
    text = (
        "After each title: Wasserstein distance of both, and in brackets that of random halves of the recordings; "
        f"orange where it is more than {_FAR:g} times that"
    )
    figure.text(0.015, 1 - 0.48 / height, text, va="top", fontsize=9.5, color=_MUTED)
    return figure


def _draw_panel(
    axes: Axes, quantity: Quantity, real: Sequence[Sample], sim: Sequence[Sample], difference: Difference | None
) -> None:
    low, high = quantity.span
    edges = np.geomspace(low, high, _BINS + 1) if quantity.log else np.linspace(low, high, _BINS + 1)
    for samples, style in ((real, {"color": _REAL, "fill": True}), (sim, {"color": _SIM, "linewidth": 1.6})):
        values = np.concatenate([each.values[quantity.name] for each in samples])
        # Light smoothing, because shapes are compared, not single bins.
        shares = gaussian_filter1d(np.histogram(values, edges)[0] / max(1, len(values)), 0.7, mode="nearest")
        axes.stairs(shares, edges, **style)
    axes.set(xlim=quantity.span, yticks=[])
    axes.set_ylim(bottom=0)
    if quantity.log:
        axes.set_xscale("log")
        axes.xaxis.set_major_locator(LogLocator(numticks=4))
        axes.xaxis.set_minor_locator(NullLocator())
        axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.tick_params(labelsize=8, colors=_MUTED, length=3)
    axes.spines[["top", "right", "left"]].set_visible(False)
    axes.spines["bottom"].set_color(_MUTED)
    title = quantity.name.removesuffix(", speed").removesuffix(", acceleration")
    axes.set_title(f"{title}, {quantity.unit}", fontsize=9, loc="left", color=_INK, pad=5)
    text, far = "not measured", False
    if difference:
        text = f"{_text(difference.wasserstein)} ({_text(difference.halves_wasserstein)})"
        far = difference.ratio > _FAR
    axes.set_title(text, fontsize=9, loc="right", color=_SIM if far else _MUTED, pad=5)


def table(differences: Sequence[Difference]) -> Table:
    """Return all differences as a table for a terminal or a page."""
    return Table(
        "Quantiles of both. W is the Wasserstein distance, in the quantity's unit, KS the Kolmogorov-Smirnov distance; "
        "in brackets those of random halves of the recordings; times is the ratio of both W",
        ("quantity", "unit", "real 5%", "50%", "95%", "sim 5%", "50%", "95%",
         "W", "halves", "times", "KS", "halves"),
        [
            (d.quantity.name, d.quantity.unit, *map(_text, d.real), *map(_text, d.sim),
             _text(d.wasserstein), f"({_text(d.halves_wasserstein)})", f"{d.ratio:.1f}",
             f"{d.ks:.2f}", f"({d.halves_ks:.2f})")
            for d in differences
        ],
    )  # fmt: skip


def write_page(
    path: Path,
    real: Sequence[Sample],
    sim: Sequence[Sample],
    differences: Sequence[Difference],
    figure: Figure,
    left_out: Sequence[str],
) -> None:
    """Write a page with the figure, the table of distances, and the measured tracks."""
    how = (
        "Angles, speeds and accelerations of the joints of BODY_25, measured in the same way on both: low-pass "
        "filtered at about 6 Hz, left and right together. Takes are fitted to one body on a level floor. Areas are "
        "fractions of all values, within the axis or beyond. The zero of ankles and faces differs between recorded "
        "skeletons."
    )
    weights = "A track is one person in one take or clip. Its weight is its seconds, spread evenly over it."
    if left_out:
        weights += f" Left out: {'; '.join(left_out)}."
    tracks = [
        Table(f"{what}: {_counted(samples)}", ("track", "seconds"), [(x.name, f"{x.seconds:.1f}") for x in samples])
        for what, samples in (("Recorded", real), ("Simulated", sim))
    ]
    sections = [
        Section("Largest differences", largest_differences(differences), figures=[CaptionedFigure(how, figure)]),
        Section("Distances", tables=[table(differences)]),
        Section("What was measured", weights, tracks),
    ]
    write_report(path, "Motion, recorded and simulated", sections)


def largest_differences(differences: Sequence[Difference], count: int = 6) -> str:
    """Return text about the quantities that differ more than recordings differ from each other."""
    far = sorted((d for d in differences if d.ratio > _FAR), key=lambda d: -d.ratio)
    listed = [
        f"{d.quantity.name} ({d.ratio:.1f} times; median {_text(d.sim[1])} for {_text(d.real[1])} {d.quantity.unit})"
        for d in far[:count]
    ]
    text = f"{len(far)} of {len(differences)} distances are more than {_FAR:g} times those of halves of the recordings"
    return f"{text}{', the largest ' if far else ''}{', '.join(listed)}."


def _counted(samples: Sequence[Sample]) -> str:
    return f"{len(samples)} tracks, {sum(each.seconds for each in samples):.0f} s"


def _text(value: float) -> str:
    """Return a value as text with at least two digits and at most three decimals."""
    if np.isnan(value):
        return "-"
    digits = 3 if not value else int(np.clip(1 - np.floor(np.log10(abs(value))), 0, 3))
    return f"{value:.{digits}f}"


def numbers(
    real: Sequence[Sample], sim: Sequence[Sample], differences: Sequence[Difference], left_out: Sequence[str]
) -> dict:
    """Return all results for JSON, with None for NaN."""

    def known(values: dict) -> dict:
        return {key: None if isinstance(value, float) and np.isnan(value) else value for key, value in values.items()}

    return {
        "real": [{"name": each.name, "seconds": each.seconds} for each in real],
        "sim": [{"name": each.name, "seconds": each.seconds} for each in sim],
        "left_out": list(left_out),
        "differences": [
            {"quantity": d.quantity.name, "unit": d.quantity.unit}
            | known({key: value for key, value in vars(d).items() if key != "quantity"})
            for d in differences
        ],
    }
