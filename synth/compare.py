"""A recording and its simulation side by side: do its detections fail as the real ones do?"""

import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from joblib import Parallel, delayed
from matplotlib.figure import Figure
from scipy.stats import ks_2samp

from dmae.clip import Clip
from dmae.data import DataConfig, Format, load
from dmae.progress import progress
from dmae.report import Picture, Section, write_report
from dmae.tables import Table, print_tables
from synth.failures import GROSS, Failures, measure

SCORES = (0.0, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.01)
"""Edges of the classes of confidence."""
_ENOUGH = 100
"""Detected joints in a class without which nothing is said of it."""
_POOLED = ("kind", "error", "inverted", "score", "runs")


@dataclass(frozen=True)
class CompareConfig:
    """`synth compare`.

    Attributes:
        real: Folder of the recording: a clip, which `dmae convert` makes of any, or Shelf's text files.
        sim: Folder of the simulated clips.
        frames: First frame of the recording, and the one after the last; by default all.
        miss: Greatest difference allowed between shares of missed joints.
        together: The same between shares of joints missed with their neighbour.
        distance: Greatest Kolmogorov-Smirnov distance between distributions of errors and of runs.
        confidence: Greatest relative difference between the median errors at one confidence.
        views: Greatest Kolmogorov-Smirnov distance between distributions of by how many views a joint is detected.
        workers: Processes; -1 for one a core.
        out: Folder of the page and of the numbers.
    """

    real: str = "???"
    sim: str = "???"
    frames: list[int] | None = None
    miss: float = 0.03
    together: float = 0.1
    distance: float = 0.1
    confidence: float = 0.2
    views: float = 0.15
    workers: int = 1
    out: str = "runs/compare"


@dataclass(frozen=True)
class Row:
    """One statistic of both; `off` is their distance, `allowed` the most it may be, or None where any will do."""

    what: str
    real: float
    sim: float
    off: float
    allowed: float | None = None

    @property
    def exceeded(self) -> bool:
        return self.allowed is not None and not self.off <= self.allowed


def read_recording(path: Path, frames: Sequence[int] | None = None) -> Clip:
    """One recording, a clip or Shelf's text files, or the stretch of it from one frame to before another.

    Raises:
        FileNotFoundError, ValueError: there is none, or not of one clip, or without such frames.
    """
    kind = Format.shelf if (path / "detection").is_dir() else Format.clip
    try:
        clips = load(DataConfig(kind, str(path)))
    except FileNotFoundError as error:
        raise FileNotFoundError(f"{error}; other recordings are made clips by dmae convert") from None
    if len(clips) != 1:
        raise ValueError(f"{path}: expected one recording, found {len(clips)} clips")
    clip = clips[0]
    if frames is None:
        return clip
    if len(frames) != 2 or not 0 <= frames[0] < frames[1] <= len(clip):
        raise ValueError(f"frames={list(frames)}: expected [first, end] within the {len(clip)} frames of {path}")
    return clip.select(frames=slice(*frames))


def measure_all(clips: Iterable[Clip], count: int, workers: int = 1) -> Failures:
    """The failures of `count` clips together: samples pooled, shares averaged by the clips' lengths."""
    jobs = Parallel(n_jobs=workers, return_as="generator")(delayed(_measure)(clip) for clip in clips)
    parts, frames = zip(*progress(jobs, "measuring", count), strict=True)
    return pool(parts, frames)


def _measure(clip: Clip) -> tuple[Failures, int]:
    return measure(clip), len(clip)


def pool(parts: Sequence[Failures], frames: Sequence[int]) -> Failures:
    """Several clips' failures as one's."""
    values = {f.name: [getattr(part, f.name) for part in parts] for f in fields(Failures)}
    views = {len(part.ghosts) for part in parts}
    if len(views) > 1 or len(set(values["kinds"])) > 1:
        raise ValueError(f"clips of {sorted(views)} cameras, or of several skeletons, cannot be measured as one")

    def mean(name: str):
        if isinstance(values[name][0], dict):
            return {key: _mean([part[key] for part in values[name]], frames) for key in values[name][0]}
        return _mean(values[name], frames)

    shared = {"name": values["name"][0], "fps": values["fps"][0], "kinds": values["kinds"][0]}
    pooled = {name: np.concatenate(values[name]) for name in _POOLED}
    return Failures(**shared, **pooled, **{name: mean(name) for name in values if name not in shared | pooled})


def _mean(values: list, weights: Sequence[int]):
    array = np.array(values, float)
    known = ~np.isnan(array)
    weight = np.where(known, np.reshape(np.asarray(weights, float), (-1, *(1,) * (array.ndim - 1))), 0)
    total = weight.sum(0)
    mean = np.where(total > 0, (weight * np.nan_to_num(array)).sum(0) / np.maximum(total, 1e-9), np.nan)
    return mean if mean.ndim else float(mean)


def compare(real: Failures, sim: Failures, limits: CompareConfig) -> list[Row]:
    """Every statistic of both; those by view, and by number of views, only of recordings of as many views.

    Raises:
        ValueError: they are of different skeletons.
    """
    if real.kinds != sim.kinds:
        raise ValueError(f"the recording has joints {list(real.kinds)}, the simulation {list(sim.kinds)}")
    rows = []
    for k, kind in enumerate(real.kinds):
        a, b = (float(np.nanmean(both.missed[:, k])) for both in (real, sim))
        rows.append(Row(f"missed: {kind}", a, b, abs(a - b), limits.miss))
    for side, name in enumerate(("on the camera's side", "on the far side")):
        for k, kind in enumerate(real.kinds):
            a, b = float(real.turned[k, side]), float(sim.turned[k, side])
            if np.isfinite([a, b]).all():
                rows.append(_plain(f"missed {name}: {kind}", a, b))
    if real.views.shape == sim.views.shape:
        rows += [_seen_by(kind, real.views[k], sim.views[k], limits.views) for k, kind in enumerate(real.kinds)]
        for view, (a, b) in enumerate(zip(np.nanmean(real.missed, 1), np.nanmean(sim.missed, 1), strict=True)):
            rows.append(_plain(f"missed in view {view}", float(a), float(b)))
    for pair in real.together:
        a, b = real.together[pair], sim.together[pair]
        rows.append(Row(f"missed together: {pair}", a, b, abs(a - b), limits.together))
    rows.append(_distance("length of misses, s", real.runs, sim.runs, limits.distance))
    rows.append(_distance("error", real.error, sim.error, limits.distance))
    for k, kind in enumerate(real.kinds):
        rows.append(_distance(f"error: {kind}", real.error[real.kind == k], sim.error[sim.kind == k], None))
    for low, high in pairwise(SCORES):
        some = [both.error[(both.score >= low) & (both.score < high)] for both in (real, sim)]
        if min(map(len, some)) >= _ENOUGH:
            a, b = map(float, map(np.median, some))
            rows.append(
                Row(f"median error at confidence {low:.1f}-{min(high, 1):.1f}", a, b, abs(b / a - 1), limits.confidence)
            )
    rows += [_plain(f"correlation of errors after {lag} s", real.lags[lag], sim.lags[lag]) for lag in real.lags]
    rows.append(_plain("constant share of errors", real.constant, sim.constant))
    rows.append(_plain(f"errors above {GROSS} heights", *(float((both.error > GROSS).mean()) for both in (real, sim))))
    for k, kind in enumerate(real.kinds):
        if real.inverted[real.kind == k].any() or sim.inverted[sim.kind == k].any():
            rows.append(
                _plain(f"left for right: {kind}", *(float(b.inverted[b.kind == k].mean()) for b in (real, sim)))
            )
    for name in ("person_missed", "ghosts", "ghost_joints", "ghost_score", "fragments"):
        a, b = (float(np.nanmean(getattr(both, name))) for both in (real, sim))
        rows.append(_plain({"person_missed": "people missed whole", "ghosts": "false persons a view and frame",
                            "ghost_joints": "joints of a false person", "ghost_score": "confidence of its joints",
                            "fragments": "fragments a view and frame"}[name], a, b))  # fmt: skip
    return rows


def _plain(what: str, real: float, sim: float) -> Row:
    return Row(what, real, sim, abs(real - sim))


def _seen_by(kind: str, real: np.ndarray, sim: np.ndarray, allowed: float) -> Row:
    """Mean number of views that detect a joint, and how far its distributions (V + 1,) are apart."""
    means = [float(shares @ np.arange(len(shares))) for shares in (real, sim)]
    return Row(f"views that detect: {kind}", *means, float(np.abs(np.cumsum(real - sim)).max()), allowed)


def _distance(what: str, real: np.ndarray, sim: np.ndarray, allowed: float | None) -> Row:
    """Medians, and the Kolmogorov-Smirnov distance between the distributions."""
    if not len(real) or not len(sim):
        return Row(f"distribution of {what}", float("nan"), float("nan"), float("nan"))
    off = float(ks_2samp(real, sim).statistic)
    return Row(f"distribution of {what}", float(np.median(real)), float(np.median(sim)), off, allowed)


def table(rows: Sequence[Row]) -> Table:
    """All rows, for a terminal or a page."""
    return Table(
        "Lengths are in heights of the person in the image; of distributions the medians are shown",
        ("statistic", "real", "simulated", "distance", "allowed", ""),
        [
            (row.what, f"{row.real:.3f}", f"{row.sim:.3f}", f"{row.off:.3f}",
             "" if row.allowed is None else f"{row.allowed:.2f}", "exceeded" if row.exceeded else "")
            for row in rows
        ],
    )  # fmt: skip


def write_page(path: Path, real: Failures, sim: Failures, rows: Sequence[Row]) -> None:
    """The table and what it is made of, drawn."""
    over = sum(row.exceeded for row in rows)
    text = f"{over} of {sum(row.allowed is not None for row in rows)} stated distances are exceeded."
    section = Section(
        f"{real.name} and its simulation", text, [table(rows)], [Picture(*each) for each in _figures(real, sim)]
    )
    write_report(path, "Detections, real and simulated", [section])


def _figures(real: Failures, sim: Failures) -> list[tuple[str, Figure]]:
    pairs = (("real", real, "tab:blue"), ("simulated", sim, "tab:orange"))
    figures = []

    def axes(caption: str, columns: int = 1):
        figure = Figure(figsize=(10, 3.2), layout="constrained")
        figures.append((caption, figure))
        return figure.subplots(1, columns, squeeze=False)[0]

    (ax,) = axes("Share of the joints missed, of people who are detected.")
    for i, (label, both, colour) in enumerate(pairs):
        ax.bar(np.arange(len(both.kinds)) + 0.4 * i - 0.2, np.nanmean(both.missed, 0), 0.4, label=label, color=colour)
    ax.set_xticks(range(len(real.kinds)), real.kinds, rotation=45)
    ax.legend()

    left, right = axes("How long joints are missed, and how far detected ones are off.", 2)
    for label, both, colour in pairs:
        for ax, values in ((left, both.runs), (right, both.error)):
            ax.plot(np.sort(values), np.linspace(0, 1, len(values)), color=colour, label=label)
    left.set(xscale="log", xlabel="s", ylabel="share of the stretches that are shorter")
    right.set(
        xscale="log", xlim=(1e-3, 1), xlabel="heights of the person", ylabel="share of the joints that are nearer"
    )
    right.legend()

    (ax,) = axes("Error by confidence: median, and the tenth above the upper line.")
    middles = [(a + min(b, 1)) / 2 for a, b in pairwise(SCORES)]
    for label, both, colour in pairs:
        classes = [both.error[(both.score >= a) & (both.score < b)] for a, b in pairwise(SCORES)]
        for share, style in ((0.5, "-"), (0.9, "--")):
            heights = [np.quantile(each, share) if len(each) >= _ENOUGH else np.nan for each in classes]
            ax.plot(middles, heights, style, color=colour, label=f"{label}, {share:.0%}")
    ax.set(xlabel="confidence", ylabel="heights of the person")
    ax.legend()

    kinds = [kind for kind in ("shoulder", "elbow", "wrist", "knee", "ankle") if kind in real.kinds]
    for ax, kind in zip(axes("By how many views a joint is detected.", len(kinds)), kinds, strict=True):
        for i, (_, both, colour) in enumerate(pairs):
            share = both.views[both.kinds.index(kind)]
            ax.bar(np.arange(len(share)) + 0.4 * i - 0.2, share, 0.4, color=colour)
        ax.set_title(kind)
    return figures


def run_compare(config: CompareConfig, out: Path) -> None:
    """Print and draw both; exits with status 1 if a stated distance is exceeded.

    Raises:
        ValueError: one of them holds nobody to be measured on, or their skeletons differ.
    """
    real = measure(read_recording(Path(config.real), config.frames))
    clips = load(DataConfig(Format.clip, config.sim))
    sim = replace(measure_all(clips, len(clips), config.workers), name=Path(config.sim).name)
    rows = compare(real, sim, config)
    print_tables([table(rows)])
    write_page(out / "compare.html", real, sim, rows)
    print(out / "compare.html")
    exceeded = [row.what for row in rows if row.exceeded]
    if exceeded:
        sys.exit(f"{len(exceeded)} stated distances are exceeded: {', '.join(exceeded)}")
