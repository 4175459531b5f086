"""Recorded and generated motion side by side, as one figure and one page."""

import io
import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator
from scipy.ndimage import gaussian_filter1d

from dmae.report import Picture, Section, write_report
from dmae.rng import Stream, generator
from dmae.store import MANIFEST, write_atomic
from dmae.tables import Table, print_tables
from synth.kinematics import GROUPS, Quantity
from synth.naturalness import LEAST, Difference, Sample, compare, measure
from synth.tracks import ReadingConfig, clip_tracks, take_tracks

_FAR = 2.0
"""Times the distance of halves of the recordings from which on a distance is pointed out."""
_BINS = 48
_REAL, _SIM, _INK, _MUTED = "#a9b8c6", "#d9541e", "#1d2733", "#55606c"


@dataclass(frozen=True)
class CompareMotionConfig:
    """`synth compare-motion`.

    Attributes:
        real: A take (BVH, ASF/AMC, AMASS-style npz, C3D) or a folder with takes at any depth; or a clip or data set of
            clips, of which what was captured counts, and the truth of those of which nothing was.
        sim: A simulated clip or data set of clips, of which the truth counts.
        takes: Only takes whose file names without suffix are like one of these; `*` and `?` stand for anything.
        longest: Most seconds for which a take, or a person of a clip, counts.
        motion: How takes are read.
        out: Folder of the page, the figure and the numbers.
    """

    real: str = "???"
    sim: str = "???"
    takes: list[str] = field(default_factory=lambda: ["*"])
    longest: float = 10.0
    motion: ReadingConfig = field(default_factory=ReadingConfig)
    out: str = "runs/compare_motion"

    def __post_init__(self):
        if not self.longest >= LEAST:
            raise ValueError(f"longest={self.longest}: expected {LEAST} s or more")


def draw(real: Sequence[Sample], sim: Sequence[Sample], differences: Sequence[Difference]) -> Figure:
    """Both distributions of every quantity, in rows of `GROUPS`. What lies beyond an axis lacks in the area."""
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
        "Beside each title: how far apart both lie (Wasserstein distance), in brackets how far random halves of the "
        f"recordings lie apart; orange where it is more than {_FAR:g} times that"
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
        # Smoothed a little: shapes are to be compared, not bins.
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
    """All of them, for a terminal or a page."""
    return Table(
        "Quantiles of both. W is Wasserstein's distance, in the quantity's unit, KS Kolmogorov-Smirnov's; "
        "in brackets those of random halves of the recordings, and how many times as far W is",
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
    """The figure, the distances as a table, and what was measured."""
    how = (
        "Angles, speeds and accelerations of the joints of BODY_25, measured alike on both: smoothed as if cut off at "
        "6 Hz, left and right together. Takes are put on one body and on a level floor. Areas are shares of all that "
        "was measured, within the axis or beyond. Ankles and faces have a zero that every recorded skeleton sets for "
        "itself."
    )
    weighs = (
        "A track is one person in one take or clip. Each weighs as many seconds as stand here, spread evenly over it."
    )
    if left_out:
        weighs += f" Left out: {'; '.join(left_out)}."
    tracks = [
        Table(f"{what}: {_counted(samples)}", ("track", "seconds"), [(x.name, f"{x.seconds:.1f}") for x in samples])
        for what, samples in (("Recorded", real), ("Simulated", sim))
    ]
    sections = [
        Section("How far apart", farthest(differences), figures=[Picture(how, figure)]),
        Section("Distances", tables=[table(differences)]),
        Section("What was measured", weighs, tracks),
    ]
    write_report(path, "Motion, recorded and simulated", sections)


def farthest(differences: Sequence[Difference], count: int = 6) -> str:
    """What is farther apart than recordings are from each other, in a sentence or two."""
    far = sorted((d for d in differences if d.ratio > _FAR), key=lambda d: -d.ratio)
    listed = [
        f"{d.quantity.name} ({d.ratio:.1f} times; median {_text(d.sim[1])} for {_text(d.real[1])} {d.quantity.unit})"
        for d in far[:count]
    ]
    text = f"{len(far)} of {len(differences)} distances are more than {_FAR:g} times those of halves of the recordings"
    return f"{text}{', the farthest ' if far else ''}{', '.join(listed)}."


def _counted(samples: Sequence[Sample]) -> str:
    return f"{len(samples)} tracks, {sum(each.seconds for each in samples):.0f} s"


def _text(value: float) -> str:
    """Two digits or more, three decimals at most."""
    if np.isnan(value):
        return "-"
    digits = 3 if not value else int(np.clip(1 - np.floor(np.log10(abs(value))), 0, 3))
    return f"{value:.{digits}f}"


def run_compare_motion(config: CompareMotionConfig, out: Path) -> None:
    """Print, draw and write how far apart both are: `motion.html`, `motion.png`, `motion.json`.

    Raises:
        FileNotFoundError, ValueError: no takes or clips, or none that can be measured; the message says which.
    """
    path, left_out = Path(config.real), []
    if not path.exists():
        raise FileNotFoundError(f"real={path}: no such file or folder")
    simulated = clip_tracks(Path(config.sim), captured=False)
    if (path / "clip.json").is_file() or (path / MANIFEST).is_file():
        recorded = clip_tracks(path, captured=True)
    else:
        recorded, left_out = take_tracks(path, simulated[0].fps, config.takes, config.motion)
    if recorded[0].fps != simulated[0].fps:
        raise ValueError(
            f"expected one frame rate, found {recorded[0].fps:g} a second in {path} and {simulated[0].fps:g} in "
            f"{config.sim}; simulate with scene.fps={recorded[0].fps:g}"
        )
    left_out += [f"{track.name}, of {track.seconds:.2f} s" for track in recorded + simulated if track.seconds < LEAST]
    real, sim = (measure(tracks, config.longest) for tracks in (recorded, simulated))
    differences = compare(real, sim, rng=generator(0, 0, Stream.VALIDATION))
    figure, image = draw(real, sim, differences), io.BytesIO()
    figure.savefig(image, format="png", dpi=110)
    write_atomic(out / "motion.png", image.getvalue())
    write_atomic(out / "motion.json", json.dumps(_numbers(real, sim, differences, left_out), indent=1))
    write_page(out / "motion.html", real, sim, differences, figure, left_out)
    print_tables([table(differences)])
    for line in left_out:
        print(f"left out: {line}")
    print(farthest(differences))
    print(out / "motion.html")


def _numbers(
    real: Sequence[Sample], sim: Sequence[Sample], differences: Sequence[Difference], left_out: Sequence[str]
) -> dict:
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
