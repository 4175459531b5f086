"""Compare a recording with its simulation, by the statistics of their detections."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from scipy.stats import ks_2samp

from dmae.numerics.statistics import mean_known
from dmae.reporting.page import CaptionedFigure, Section, write_report
from dmae.reporting.tables import Table
from synth.detector.config import Limits
from synth.detector.statistics import GROSS, DetectorStatistics

SCORE_EDGES = (0.0, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.01)
"""Edges of the bins of confidence."""
ENOUGH = 100
"""Fewest detected joints in a bin, or fewest misses, for a comparison."""


@dataclass(frozen=True)
class Row:
    """One statistic of a recording and its simulation."""

    what: str  # Name of the statistic
    real: float  # Value of the recording
    sim: float  # Value of the simulation
    distance: float  # Distance between both
    allowed: float | None = None  # Greatest allowed distance; None if any distance is allowed

    @property
    def exceeded(self) -> bool:
        return self.allowed is not None and not self.distance <= self.allowed


@contextmanager
def speaking_of(option: str) -> Iterator[None]:
    """Have errors about clips, in the block, say of which set they are: clips of two sets can have one name."""
    try:
        yield
    except ValueError as error:
        raise ValueError(f"{option}: {error}") from None


def compare(real: DetectorStatistics, sim: DetectorStatistics, limits: Limits) -> list[Row]:
    """Compare every statistic. Statistics by view are compared only if both have the same number of views.

    Raises ValueError if the recordings have different skeletons.
    """
    if real.kinds != sim.kinds:
        raise ValueError(f"the recording has joints {list(real.kinds)}, the simulation {list(sim.kinds)}")
    rows = []
    # Kinds that one of them cannot miss, as its detector or its people lack them, are not compared.
    known = [np.isfinite(mean_known(both.missed, 0)) for both in (real, sim)]
    kinds = [(k, kind) for k, kind in enumerate(real.kinds) if all(each[k] for each in known)]
    for k, kind in kinds:
        a, b = (float(mean_known(both.missed[:, k])) for both in (real, sim))
        rows.append(Row(f"missed: {kind}", a, b, abs(a - b), limits.miss))
    for side, name in enumerate(("on the camera's side", "on the far side")):
        for k, kind in kinds:
            a, b = float(real.missed_by_side[k, side]), float(sim.missed_by_side[k, side])
            if np.isfinite([a, b]).all():
                rows.append(_plain(f"missed {name}: {kind}", a, b))
    if real.views.size and real.views.shape == sim.views.shape:
        for k, kind in kinds:
            shares = real.views[k], sim.views[k]
            a, b = (float(each @ np.arange(len(each))) for each in shares)
            distance = float(np.abs(np.cumsum(shares[0] - shares[1])).max())
            rows.append(Row(f"views that detect: {kind}", a, b, distance, limits.views))
        for view, (a, b) in enumerate(zip(mean_known(real.missed, 1), mean_known(sim.missed, 1), strict=True)):
            rows.append(_plain(f"missed in view {view}", float(a), float(b)))
    few = min(len(real.miss_seconds), len(sim.miss_seconds)) < ENOUGH
    for pair in real.joint_misses:
        a, b = real.joint_misses[pair], sim.joint_misses[pair]
        rows.append(Row(f"missed together: {pair}", a, b, abs(a - b), None if few else limits.joint_miss))
    rows.append(_distance("length of misses, s", real.miss_seconds, sim.miss_seconds, None if few else limits.distance))
    rows.append(_distance("error", real.error, sim.error, limits.distance))
    for k, kind in kinds:
        rows.append(_distance(f"error: {kind}", real.error[real.kind == k], sim.error[sim.kind == k], None))
    for low, high in pairwise(SCORE_EDGES):
        some = [both.error[(both.score >= low) & (both.score < high)] for both in (real, sim)]
        if min(map(len, some)) >= ENOUGH:
            a, b = map(float, map(np.median, some))
            rows.append(
                Row(f"median error at confidence {low:.1f}-{min(high, 1):.1f}", a, b, abs(b / a - 1), limits.confidence)
            )
    for lag, correlation in real.autocorrelation.items():
        rows.append(_plain(f"correlation of errors after {lag} s", correlation, sim.autocorrelation[lag]))
    rows.append(_plain("constant fraction of errors", real.constant, sim.constant))
    rows.append(_plain(f"errors above {GROSS} heights", *(float((both.error > GROSS).mean()) for both in (real, sim))))
    for k, kind in kinds:
        if real.inverted[real.kind == k].any() or sim.inverted[sim.kind == k].any():
            rows.append(_plain(f"inverted: {kind}", *(float(b.inverted[b.kind == k].mean()) for b in (real, sim))))
    for name, what in (
        ("person_missed", "people missed whole"),
        ("ghosts", "ghosts in a view and frame"),
        ("ghost_joints", "joints of a ghost"),
        ("ghost_score", "confidence of its joints"),
        ("fragments", "fragments in a view and frame"),
    ):
        rows.append(_plain(what, *(float(mean_known(getattr(both, name), None)) for both in (real, sim))))
    return rows


def _plain(what: str, real: float, sim: float) -> Row:
    return Row(what, real, sim, abs(real - sim))


def _distance(what: str, real: np.ndarray, sim: np.ndarray, allowed: float | None) -> Row:
    """Compare two distributions: medians, and Kolmogorov-Smirnov distance."""
    if not len(real) or not len(sim):
        return Row(f"distribution of {what}", float("nan"), float("nan"), float("nan"))
    distance = float(ks_2samp(real, sim).statistic)
    return Row(f"distribution of {what}", float(np.median(real)), float(np.median(sim)), distance, allowed)


def table(rows: Sequence[Row]) -> Table:
    """Return all rows as a table for a terminal or a page."""
    return Table(
        "Lengths are in heights of the person in the image; of distributions the medians are shown",
        ("statistic", "real", "simulated", "distance", "allowed", ""),
        [
            (row.what, f"{row.real:.3f}", f"{row.sim:.3f}", f"{row.distance:.3f}",
             "" if row.allowed is None else f"{row.allowed:.2f}", "exceeded" if row.exceeded else "")
            for row in rows
        ],
    )  # fmt: skip


# The page


def write_page(path: Path, real: DetectorStatistics, sim: DetectorStatistics, rows: Sequence[Row]) -> None:
    """Write a page with the table of rows, and figures that show the distributions of both."""
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
        ax.bar(np.arange(len(both.kinds)) + 0.4 * i - 0.2, mean_known(both.missed, 0), 0.4, label=label, color=colour)
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
