"""The page that compares a recording with its simulation."""

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from dmae.reporting.page import CaptionedFigure, Section, write_report
from synth.detector.comparison import ENOUGH, SCORE_EDGES, Row, table
from synth.detector.statistics import DetectorStatistics


def write_page(path: Path, real: DetectorStatistics, sim: DetectorStatistics, rows: Sequence[Row]) -> None:
    """Write a page with the table of rows and figures of the distributions of both."""
    over = sum(row.exceeded for row in rows)
    text = f"{over} of {sum(row.allowed is not None for row in rows)} limits are exceeded."
    section = Section(
        f"{real.name} and its simulation", text, [table(rows)], [CaptionedFigure(*each) for each in _figures(real, sim)]
    )
    write_report(path, "Detections, real and simulated", [section])


def _figures(real: DetectorStatistics, sim: DetectorStatistics) -> list[tuple[str, Figure]]:
    pairs = (("real", real, "tab:blue"), ("simulated", sim, "tab:orange"))
    figures = []

    def axes(caption: str, columns: int = 1):
        figure = Figure(figsize=(10, 3.2), layout="constrained")
        figures.append((caption, figure))
        return figure.subplots(1, columns, squeeze=False)[0]

    (ax,) = axes("Fraction of the joints missed, of persons detected.")
    for i, (label, both, colour) in enumerate(pairs):
        ax.bar(np.arange(len(both.kinds)) + 0.4 * i - 0.2, np.nanmean(both.missed, 0), 0.4, label=label, color=colour)
    ax.set_xticks(range(len(real.kinds)), real.kinds, rotation=45)
    ax.legend()

    left, right = axes("Lengths of misses, and errors of detected joints.", 2)
    for label, both, colour in pairs:
        for ax, values in ((left, both.miss_seconds), (right, both.error)):
            ax.plot(np.sort(values), np.linspace(0, 1, len(values)), color=colour, label=label)
    left.set(xscale="log", xlabel="s", ylabel="fraction of misses that are shorter")
    right.set(
        xscale="log", xlim=(1e-3, 1), xlabel="heights of the person", ylabel="fraction of joints of a smaller error"
    )
    right.legend()

    (ax,) = axes("Error by confidence: median and 90 % quantile.")
    middles = [(a + min(b, 1)) / 2 for a, b in pairwise(SCORE_EDGES)]
    for label, both, colour in pairs:
        classes = [both.error[(both.score >= a) & (both.score < b)] for a, b in pairwise(SCORE_EDGES)]
        for share, style in ((0.5, "-"), (0.9, "--")):
            heights = [np.quantile(each, share) if len(each) >= ENOUGH else np.nan for each in classes]
            ax.plot(middles, heights, style, color=colour, label=f"{label}, {share:.0%}")
    ax.set(xlabel="confidence", ylabel="heights of the person")
    ax.legend()

    kinds = [kind for kind in ("shoulder", "elbow", "wrist", "knee", "ankle") if kind in real.kinds]
    for ax, kind in zip(axes("Number of views that detect a joint.", len(kinds)), kinds, strict=True):
        for i, (_, both, colour) in enumerate(pairs):
            share = both.views[both.kinds.index(kind)]
            ax.bar(np.arange(len(share)) + 0.4 * i - 0.2, share, 0.4, color=colour)
        ax.set_title(kind)
    return figures
