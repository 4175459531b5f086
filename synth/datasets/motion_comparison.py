"""Compare how recorded and generated people move: tracks, kinematic quantities, a figure and a page."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from fnmatch import fnmatch
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator
from scipy.ndimage import gaussian_filter1d
from scipy.stats import ks_2samp, wasserstein_distance

from dmae.data.clip import Clip, Poses3D, person_name
from dmae.data.conversion import convert
from dmae.data.skeleton import BODY25
from dmae.data.store import clip_folders, load_clip
from dmae.progress import progress
from dmae.reporting.page import CaptionedFigure, Section, write_report
from dmae.reporting.tables import Table
from synth.datasets.config import MIN_SECONDS
from synth.motion.config import ReadingConfig
from synth.motion.feet import fit_to_body
from synth.motion.kinematics import GROUPS, QUANTITIES, Quantity, kinematics
from synth.motion.readers import format_of, reader, take_name
from synth.motion.readers.takes import subject_and_trial
from synth.motion.source import cut, read_take
from synth.people.body import SKELETON, Body
from synth.physics.body_state import reference_joints

_FORMATS = sorted(reader, key=lambda name: (reader[name].markers, name))
"""Formats of takes, with joints before markers. If a take exists in several formats, the first of them is used."""
_PERFORMER = Body(1.70)
"""A body with average proportions. Takes are fitted to it, because every format places its joints differently."""


@dataclass(frozen=True)
class Track:
    """The motion of one person."""

    name: str  # Name for messages and tables
    fps: float  # Frames per second
    xyz: np.ndarray  # (F, 25, 3) joints of `BODY25`, m, world, floor at z = 0; NaN where unknown

    @property
    def seconds(self) -> float:
        """The duration for which any joint of the person is known, s."""
        return float((~np.isnan(self.xyz).all((1, 2))).sum() / self.fps)


def take_tracks(
    path: Path, fps: float, names: Sequence[str] = ("*",), reading: ReadingConfig | None = None
) -> tuple[list[Track], list[str]]:
    """Read recorded takes in the same way as the generator: on the floor, on one body, at one frame rate.

    The directions of limbs come from the files. The body determines the positions of joints on limbs, and of nose, ears
    and toes, as for simulated people. `names` are patterns of file names without suffix, with the wildcards `*` and
    `?`.

    Returns a track for each take, and descriptions of files that are left out because they contain a take in another
    format.

    Raises:
        FileNotFoundError: there are no takes at the path, which is a file or is searched at any depth.
        ValueError: no take matches the patterns, or a file is malformed.
    """
    reading = reading or ReadingConfig()
    found = sorted(path.rglob("*")) if path.is_dir() else [path]
    files = [file for file in found if format_of(file) and file.is_file()]
    if not files:
        raise FileNotFoundError(
            f"{path}: expected takes ({', '.join(f'.{name}' for name in _FORMATS)}) or clips, found neither"
        )
    chosen = [file for file in files if any(fnmatch(take_name(file), name) for name in names)]
    if not chosen:
        there = ", ".join(sorted({take_name(file) for file in files}))
        raise ValueError(f"{path}: no take is called {' or '.join(names)}; there are {there}")
    firsts: dict[tuple[int, int], Path] = {}
    kept, again = [], []
    for file in sorted(chosen, key=lambda file: _FORMATS.index(str(format_of(file)))):
        named = subject_and_trial(take_name(file))
        first = firsts.setdefault(named, file) if any(named) else file
        # Files of the same take in the same folder are all kept. Conversions of a take are in other folders.
        if first.parent == file.parent:
            kept.append(file)
        else:
            again.append(f"{file.relative_to(path)} is {first.relative_to(path)}")
    tracks = []
    for file in progress(sorted(kept), "reading takes"):
        take = read_take(file, reading.fps, unit=reading.unit, up=reading.up, mapping=reading.mapping)
        motion = fit_to_body(cut(take, start=0, seconds=len(take) / take.fps, fps=fps), _PERFORMER)
        joints = reference_joints(_PERFORMER, motion.root, motion.rotations)
        tracks.append(Track(take.name, fps, convert(Poses3D(SKELETON, joints[:, None]), BODY25).xyz[:, 0]))
    return tracks, again


def clip_tracks(path: Path, *, captured: bool) -> list[Track]:
    """Read every person's track in a clip or data set; see `tracks_of`.

    Raises FileNotFoundError if there are no clips at the path.
    """
    folders = clip_folders(path)
    named = ((str(folder), load_clip(folder)) for folder in folders)
    return tracks_of(progress(named, "reading clips", len(folders)), captured=captured)


def tracks_of(clips: Iterable[tuple[str, Clip]], *, captured: bool) -> list[Track]:
    """Return the track of every person of named clips: of the captured poses if wanted and there, else of the truth.

    Raises:
        ValueError: the clips have no persons, or a clip has no such poses or another frame rate than the first clip.
    """
    tracks: list[Track] = []
    names = []
    for name, clip in clips:
        names.append(name)
        poses = clip.poses if captured and clip.poses is not None else clip.truth
        if poses is None:
            wanted = "poses (dmae capture makes them) or a truth" if captured else "a truth, as in simulated clips"
            raise ValueError(f"{name}: expected {wanted}, found none")
        if tracks and clip.fps != tracks[0].fps:
            raise ValueError(f"{name}: expected {tracks[0].fps:g} frames a second as before, found {clip.fps:g}")
        xyz = convert(poses, BODY25).xyz
        tracks += [Track(f"{Path(name).name}, {person_name(p)}", clip.fps, xyz[:, p]) for p in range(xyz.shape[1])]
    if not tracks:
        raise ValueError(f"expected people in the clips, found {len(names)} clips without people")
    return tracks


def same_rate(recorded: Sequence[Track], simulated: Sequence[Track], real: str, sim: str) -> None:
    """Raise ValueError if recorded tracks of `real` and simulated tracks of `sim` have different frame rates."""
    rates = recorded[0].fps, simulated[0].fps
    if rates[0] != rates[1]:
        raise ValueError(
            f"expected one frame rate, found {rates[0]:g} a second in {real} and {rates[1]:g} in {sim}; simulate with "
            f"scene.fps={rates[0]:g}"
        )


# Compare the motion of generated and recorded people by distributions of kinematic quantities.

_SPLITS = 20
_QUANTILES = (0.05, 0.5, 0.95)


@dataclass(frozen=True)
class Sample:
    """The kinematics of a track."""

    name: str  # Name of the track
    seconds: float  # Duration that it counts as, s
    values: dict[str, np.ndarray]  # Values of each of `QUANTITIES`, evenly spaced over the track, in order of time


@dataclass(frozen=True)
class Difference:
    """One quantity of recorded and generated tracks."""

    quantity: Quantity
    # real, sim: Quantiles of 5, 50 and 95 %
    real: tuple[float, ...]
    sim: tuple[float, ...]
    wasserstein: float  # Wasserstein-1 distance, in the quantity's unit
    ks: float  # Kolmogorov-Smirnov distance: the greatest difference of the distribution functions
    # halves_wasserstein, halves_ks: The same distances between two random halves of the recorded tracks, medians over
    # many draws. NaN where almost no track has the quantity.
    halves_wasserstein: float
    halves_ks: float

    @property
    def ratio(self) -> float:
        """The ratio of the distance to the distance between halves of the recordings; 0 where nothing differs."""
        if not self.wasserstein:
            return 0.0
        return self.wasserstein / self.halves_wasserstein if self.halves_wasserstein else np.inf


def measure(tracks: Sequence[Track], longest: float) -> list[Sample]:
    """Measure the kinematics of every track that is long enough. Each counts as `longest` s at most.

    Raises ValueError if no track is long enough.
    """
    samples = []
    for track in progress([track for track in tracks if track.seconds >= MIN_SECONDS], "measuring"):
        seconds, values = min(track.seconds, longest), {}
        for name, array in kinematics(track.xyz, track.fps).items():
            known = array[~np.isnan(array)]
            count = min(round(seconds * track.fps) * (array.size // len(array)), len(known))
            values[name] = known[np.linspace(0, len(known) - 1, count).round().astype(int)]
        samples.append(Sample(track.name, seconds, values))
    if not samples:
        lengths = ", ".join(f"{track.name} {track.seconds:.2f} s" for track in tracks) or "no tracks"
        raise ValueError(f"expected a track of {MIN_SECONDS} s or more, found {lengths}")
    return samples


def compare(real: Sequence[Sample], sim: Sequence[Sample], *, rng: np.random.Generator) -> list[Difference]:
    """Compare recorded and generated tracks in every quantity that both have.

    Random halves of the recorded tracks are compared too. Those of a single track are the two halves of its time.
    """
    pieces = max(1, 2 // len(real))
    orders = [rng.permutation(len(real) * pieces) for _ in range(_SPLITS)]
    differences = []
    for quantity in progress(QUANTITIES, "comparing"):
        parts = [part for each in real for part in np.array_split(each.values[quantity.name], pieces)]
        both = np.concatenate(parts), np.concatenate([each.values[quantity.name] for each in sim])
        if not min(map(len, both)):
            continue
        of_real, of_sim = (tuple(map(float, np.quantile(values, _QUANTILES))) for values in both)
        halves = [
            _distances(*(np.concatenate([parts[i] for i in half]) for half in np.array_split(order, 2)))
            for order in orders
        ]
        wasserstein, ks = _distances(*both)
        of_halves = map(float, np.median(halves, axis=0))
        differences.append(Difference(quantity, of_real, of_sim, wasserstein, ks, *of_halves))
    return differences


def _distances(one: np.ndarray, other: np.ndarray) -> tuple[float, float]:
    """Return the Wasserstein and Kolmogorov-Smirnov distances; NaN if one sample is empty."""
    if not min(len(one), len(other)):
        return np.nan, np.nan
    return float(wasserstein_distance(one, other)), float(ks_2samp(one, other, method="asymp").statistic)


# The figure and the page that compare recorded with generated motion.

_FAR = 2.0
"""Distances above this multiple of the distance between halves of the recordings are highlighted."""
_NAMED = 6
"""Greatest number of differences that the text names."""
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
    filled: dict = {"color": _REAL, "fill": True}
    for samples, style in ((real, filled), (sim, {"color": _SIM, "linewidth": 1.6})):
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


def largest_differences(differences: Sequence[Difference]) -> str:
    """Return text about the quantities that differ more than recordings differ from each other."""
    far = sorted((d for d in differences if d.ratio > _FAR), key=lambda d: -d.ratio)
    listed = [
        f"{d.quantity.name} ({d.ratio:.1f} times; median {_text(d.sim[1])} for {_text(d.real[1])} {d.quantity.unit})"
        for d in far[:_NAMED]
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
    return {
        "real": [{"name": each.name, "seconds": each.seconds} for each in real],
        "sim": [{"name": each.name, "seconds": each.seconds} for each in sim],
        "left_out": list(left_out),
        "differences": [
            {"quantity": d.quantity.name, "unit": d.quantity.unit}
            | {key: None if value != value else value for key, value in vars(d).items() if key != "quantity"}
            for d in differences
        ],
    }
