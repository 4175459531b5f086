"""Describe a data set: counts and histograms, contacts, terms of use, a figure and a page."""

import io
import json
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import reduce
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from dmae.data.clip import Clip
from dmae.data.labels import Visibility
from dmae.data.store import MANIFEST, clip_folders, load_clip, read_manifest
from dmae.data.typed import check_arguments
from dmae.files.contents import write_atomic
from dmae.numerics.body import body_heading
from dmae.numerics.paths import runs
from dmae.parallel import check_workers, in_parallel
from dmae.progress import progress
from dmae.reporting.tables import counted, markdown_table
from synth.datasets.config import SplitBy
from synth.datasets.splits import identities
from synth.labels.forces import owners
from synth.physics.body_state import FILE as STATE
from synth.physics.body_state import BodyState, load_state
from synth.rooms.config import room_choices


class ClipContacts(NamedTuple):
    """Contacts between different people of one clip."""

    frames: int  # Number of frames of the clip
    touching: int  # Number of frames in which a person touches another
    touches: int  # Number of uninterrupted stretches of such frames
    force: float  # Greatest force in a frame, N: the median over the frames with contact; 0 without contact


def clip_contacts(state: BodyState) -> ClipContacts:
    """Return the contacts between people, counted in the body states of a clip."""
    one, other = owners(state.contact_names)[state.contact_between].T
    between = (one >= 0) & (other >= 0) & (one != other)
    greatest = np.zeros(len(state.qpos))
    np.maximum.at(greatest, state.contact_frame[between], np.linalg.norm(state.contact_force[between], axis=1))
    touching = np.zeros(len(state.qpos), bool)
    touching[state.contact_frame[between]] = True
    force = float(np.median(greatest[touching])) if touching.any() else 0.0
    return ClipContacts(len(state.qpos), int(touching.sum()), len(runs(touching)), force)


def spread(clips: Sequence[ClipContacts]) -> dict[str, float]:
    """Return the number of clips, and of each measure of contact its least, median and greatest value."""
    shares = np.array([clip.touching / clip.frames for clip in clips])
    found: dict[str, float] = {"clips": len(clips), "frames": sum(clip.frames for clip in clips)}
    measures = {"share": shares, "touches": [clip.touches for clip in clips], "force": [clip.force for clip in clips]}
    for name, values in measures.items():
        found |= {f"{name}_{which}": float(take(values)) for which, take in _SPREAD.items()}
    return found


_SPREAD: dict[str, Callable] = {"least": np.min, "median": np.median, "most": np.max}


# Counts and histograms of clips. They can be added over a data set with constant memory.

MOST_CAMERAS = 32
"""Greatest number of cameras in a histogram."""


@dataclass(frozen=True)
class BinnedQuantity:
    """A quantity with a histogram."""

    name: str  # Key in the results
    meaning: str  # Description for readers
    unit: str  # Unit of the edges
    edges: np.ndarray  # (N + 1,) edges of the bins. Values beyond the ends count in the first and the last bin.


QUANTITIES = {
    each.name: each
    for each in (
        BinnedQuantity("persons_in_image", "persons in an image", "", np.arange(-0.5, 13)),
        BinnedQuantity("visible_views", "cameras that see a joint", "", np.arange(-0.5, MOST_CAMERAS + 1)),
        BinnedQuantity("distance", "distance of a person from a camera", "m", np.arange(0, 15.5, 0.5)),
        BinnedQuantity(
            "azimuth", "camera around a person, 0 in front, 90 to the left", "degrees", np.arange(-180, 181, 15)
        ),
        BinnedQuantity("elevation", "camera above the level of a person's hips", "degrees", np.arange(-90, 91, 7.5)),
        BinnedQuantity("box_height", "height of a person in an image", "px", np.arange(0, 1201, 40)),
        BinnedQuantity("visible_share", "share of a person's pixels that is visible", "", np.linspace(0, 1, 21)),
        BinnedQuantity("hip_speed", "speed of the hips", "m/s", np.arange(0, 4.05, 0.1)),
        BinnedQuantity("wrist_speed", "speed of the wrists", "m/s", np.arange(0, 8.2, 0.2)),
        BinnedQuantity("stature", "height of persons", "m", np.arange(1.0, 2.11, 0.05)),
    )
}


@dataclass
class Statistics:
    """Counts of some clips, for the J joints of the skeleton's first part. `+` adds two of them."""

    joints: tuple[str, ...] = ()  # Names of the J joints
    # `clips`, `clips_without_truth`, `frames`, `images`, `seconds`, and clips by number of persons, `persons=3`, and
    # of cameras, `cameras=5`
    counts: Counter = field(default_factory=Counter)
    causes: np.ndarray | None = None  # (J, 7) numbers of joints in views, by `Visibility`
    # Counts in the bins of each of `QUANTITIES`, by its name
    histograms: dict[str, np.ndarray] = field(default_factory=dict)
    # Number of hidden joints by occluder: `self`, `person`, or the name of an object
    occluders: Counter = field(default_factory=Counter)
    # Number of clips by arena, interaction, and kind of motion: `arena=office`
    scenes: Counter = field(default_factory=Counter)
    # `ClipContacts` of each clip with body states, by interaction
    contacts: dict[str, tuple[ClipContacts, ...]] = field(default_factory=dict)
    persons: set[str] = field(default_factory=set)  # Names of persons, from `synth.datasets.splits`
    takes: set[str] = field(default_factory=set)  # Names of takes, from `synth.datasets.splits`
    rigs: set[str] = field(default_factory=set)  # Names of rigs, from `synth.datasets.splits`

    def __add__(self, other: "Statistics") -> "Statistics":
        """Return the sum of both counts. Raises ValueError if the clips have different skeletons."""
        if self.joints and other.joints and self.joints != other.joints:
            raise ValueError(f"expected clips of one skeleton, found joints {self.joints} and {other.joints}")
        known = [each.causes for each in (self, other) if each.causes is not None]
        names, kinds = self.histograms | other.histograms, self.contacts | other.contacts
        return Statistics(
            joints=self.joints or other.joints,
            counts=self.counts + other.counts,
            causes=np.sum(known, 0) if known else None,
            histograms={name: np.add(self.histograms.get(name, 0), other.histograms.get(name, 0)) for name in names},
            occluders=self.occluders + other.occluders,
            scenes=self.scenes + other.scenes,
            contacts={kind: self.contacts.get(kind, ()) + other.contacts.get(kind, ()) for kind in kinds},
            persons=self.persons | other.persons,
            takes=self.takes | other.takes,
            rigs=self.rigs | other.rigs,
        )


def measure(data: Path | list[Path], *, workers: int = 1) -> Statistics:
    """Return the statistics of the clips and data sets in folders.

    Raises:
        FileNotFoundError: there is neither a clip nor a data set.
        ValueError: no clip is ok, one is damaged, or clips have different skeletons.
    """
    each = data if isinstance(data, list) else [data]
    folders = [folder for path in each for folder in clip_folders(Path(path))]
    found = in_parallel(_measure_clip, ((folder,) for folder in folders), workers)
    return reduce(Statistics.__add__, progress(found, "reading clips", len(folders)), Statistics())


def _measure_clip(folder: Path) -> Statistics:
    clip = load_clip(folder)
    spec = clip.provenance.get("spec")
    found = measure_clip(clip)
    found.rigs.add(*identities(folder, SplitBy.rig))
    if spec:
        found.persons |= identities(folder, SplitBy.person)
        found.takes |= identities(folder, SplitBy.motion)
    if spec and (folder / STATE).is_file():
        kind = spec.get("interaction", {}).get("kind", "none")
        found.contacts[kind] = (clip_contacts(load_state(folder)),)
    return found


def measure_clip(clip: Clip) -> Statistics:
    """Return the statistics of one clip."""
    views = len(clip.rig)
    found = Statistics(counts=Counter(clips=1, frames=len(clip), images=views * len(clip)))
    found.counts[f"cameras={views}"] += 1
    found.counts["seconds"] += len(clip) / clip.fps  # type: ignore[assignment]  # the only one that is no integer
    spec = clip.provenance.get("spec")
    if spec:
        found.scenes.update(scene_kinds(spec))
        _add(found, "stature", [person["body"]["stature"] for person in spec["persons"]])
    if clip.truth is None:
        found.counts["clips_without_truth"] += 1
        return found
    found.counts[f"persons={clip.truth.xyz.shape[1]}"] += 1
    _measure_people(clip, found)
    if clip.occlusion is not None:
        _measure_occlusion(clip, found)
    return found


def scene_kinds(spec: dict) -> tuple[str, str, str]:
    """Return what a clip counts as in `Statistics.scenes`, from the scene in its provenance."""
    together = spec.get("interaction", {}).get("kind", "none")
    # Pages that are published name the file of a room, not where it was.
    return f"arena={Path(spec['arena']).name}", f"motion={spec['motion']['kind']}", f"interaction={together}"


def clips_by(counts: Counter[str], kind: str) -> dict[str, int]:
    """Return the numbers of clips by arena, motion, interaction, persons or cameras, from `Statistics.scenes` or
    `counts`."""
    return {key.removeprefix(f"{kind}="): count for key, count in counts.items() if key.startswith(f"{kind}=")}


def _add(found: Statistics, name: str, values) -> None:
    edges = QUANTITIES[name].edges
    values = np.asarray(values, np.float64).ravel()
    values = np.clip(values[np.isfinite(values)], edges[0], edges[-1])
    found.histograms[name] = np.histogram(values, edges)[0]


def _measure_people(clip: Clip, found: Statistics) -> None:
    assert clip.truth is not None
    rig = clip.actual_rig
    part = clip.truth.skeleton.parts[0]
    xyz = clip.truth.xyz[:, :, : len(part)].astype(np.float64)
    hips = xyz[:, :, part.index("l_hip", "r_hip")].mean(2)
    towards = rig.centers[:, None] - hips[:, None]
    level = np.linalg.norm(towards[..., :2], axis=-1)
    _add(found, "distance", np.linalg.norm(towards, axis=-1))
    _add(found, "elevation", np.degrees(np.arctan2(towards[..., 2], level)))
    around = np.arctan2(towards[..., 1], towards[..., 0]) - body_heading(xyz, part)[:, None]
    _add(found, "azimuth", np.degrees((around + np.pi) % (2 * np.pi) - np.pi))
    _add(found, "hip_speed", np.linalg.norm(np.diff(hips, axis=0), axis=-1) * clip.fps)
    wrists = xyz[:, :, part.index("l_wrist", "r_wrist")]
    _add(found, "wrist_speed", np.linalg.norm(np.diff(wrists, axis=0), axis=-1) * clip.fps)
    xy, _ = rig.project(xyz)
    inside = rig.inside(xy)
    _add(found, "persons_in_image", inside.any(-1).sum(-1))
    y = xy[..., 1]
    high = np.where(inside, y, -np.inf).max(-1) - np.where(inside, y, np.inf).min(-1)
    _add(found, "box_height", np.where(inside.any(-1), high, np.nan))


def _measure_occlusion(clip: Clip, found: Statistics) -> None:
    assert clip.truth is not None and clip.occlusion is not None
    part = clip.truth.skeleton.parts[0]
    found.joints = part.joints
    code = clip.occlusion.visibility[..., : len(part)]
    found.causes = np.stack([(code == cause).sum((0, 1, 2)) for cause in Visibility], -1)
    there = (code != Visibility.ABSENT).any(1)
    _add(found, "visible_views", np.where(there, (code == Visibility.VISIBLE).sum(1), np.nan))
    if clip.occlusion.amodal_pixels is not None:
        _add(found, "visible_share", clip.occlusion.visible_fraction)
    found.occluders["self"] += int((code == Visibility.HIDDEN_BY_SELF).sum())
    found.occluders["person"] += int((code == Visibility.HIDDEN_BY_PERSON).sum())
    if clip.occlusion.occluder is not None:
        by = clip.occlusion.occluder[..., : len(part)][code == Visibility.HIDDEN_BY_OBJECT]
        for index, count in enumerate(np.bincount(by[by >= 0], minlength=len(clip.occlusion.objects)).tolist()):
            # Names of props begin with their number in the scene, for example 0/drum.
            found.occluders[clip.occlusion.objects[index].rpartition("/")[2]] += count


# The terms of use of a data set, which follow from its inputs: free parts, and parts with separate terms.

PROCEDURAL = "procedural"


def terms(scenes: Counter[str]) -> str:
    """Return the section on rights for the page of a data set, in Markdown, from `Statistics.scenes`."""
    motion, rooms = clips_by(scenes, "motion"), clips_by(scenes, "arena")
    recorded = {kind: count for kind, count in motion.items() if kind != PROCEDURAL}
    foreign = {room: count for room, count in rooms.items() if room not in room_choices()}
    lines = [
        "People, clothes, textures, rooms and detectors of dmae-synth are made by its code, from published statistics. "
        "The clips that it makes of them belong to you, for commercial use as well."
    ]
    if recorded:
        lines.append(
            f"**Recorded motion** ({_listed(recorded)}): the terms of those takes apply to these clips. "
            "`clip.json` names the take of each person."
        )
    if foreign:
        lines.append(f"**Rooms from files** ({_listed(foreign)}): the terms of those files apply to images of them.")
    if not motion:
        lines.append(
            "**Not simulated by this project**: the clips do not state their origin. Ask the source of the clips."
        )
    return "\n\n".join(lines)


def _listed(counts: dict[str, int]) -> str:
    return ", ".join(f"{name}: {counted(count, 'clip')}" for name, count in sorted(counts.items()))


# A figure of the histograms of a data set.

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
    _draw_occluders(figure.add_subplot(grid[3, 2:]), found)
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


# The page of a data set: its contents in words, tables and one figure.

PAGE, PICTURE, NUMBERS = "README.md", "statistics.png", "statistics.json"
FORMAT = 1
_HIDDEN = (Visibility.HIDDEN_BY_SELF, Visibility.HIDDEN_BY_PERSON, Visibility.HIDDEN_BY_OBJECT)
_OCCLUDERS = 12
"""Greatest number of listed occluders."""


@check_arguments
def stats(path: str | Path, out: str | Path, *, extra_data: Sequence[str | Path] = (), workers: int = 1) -> dict:
    """Describe a data set: occlusion by joint and cause, contacts, people, distances, angles, motion.

    Args:
        path: The data set, or a clip.
        out: Folder of the page, `README.md`, its figure, and the numbers of both.
        extra_data: More data sets that the same page describes.
        workers: Processes; -1 for one per core.

    Returns:
        The numbers, as in `statistics.json`.

    Raises:
        FileNotFoundError: there is neither a clip nor a data set.
        ValueError: `out` contains something other than an earlier page, or a clip is damaged.

    Examples:
        >>> for clip in synth.generate(seconds=1, clips=2, seed=7, out="walks"): pass
        >>> synth.stats("walks", "card")["counts"]["frames"]
        50
    """
    data, out = [Path(each) for each in (path, *extra_data)], Path(out)
    check_workers(workers)
    if out.is_dir() and any(out.iterdir()) and not (out / NUMBERS).is_file():
        raise ValueError(
            f"{out}: expected no such folder, an empty one, or one with an earlier {NUMBERS}; choose another out"
        )
    found = measure(data, workers=workers)
    lines = [line for path in data if (path / MANIFEST).is_file() for line in read_manifest(path)]
    failed = sum(line["status"] != "ok" for line in lines)
    write_atomic(out / PICTURE, draw(found))
    write_atomic(out / PAGE, page(found, ", ".join(path.resolve().name for path in data), failed))
    made = numbers(found, failed)
    write_atomic(out / NUMBERS, json.dumps(made, indent=1))
    return made


def numbers(found: Statistics, failed: int) -> dict:
    """Return the statistics for JSON."""
    histograms = {
        name: {"unit": QUANTITIES[name].unit, "edges": QUANTITIES[name].edges.tolist(), "counts": counts.tolist()}
        for name, counts in found.histograms.items()
    }
    causes = {} if found.causes is None else {
        joint: dict(zip((cause.name.lower() for cause in Visibility), row, strict=True))
        for joint, row in zip(found.joints, found.causes.tolist(), strict=True)
    }  # fmt: skip
    return {
        "format": FORMAT,
        "counts": dict(found.counts) | {"clips_failed": failed},
        "different": {"persons": len(found.persons), "takes": len(found.takes), "rigs": len(found.rigs)},
        "scenes": dict(found.scenes),
        "contacts": _spreads(found),
        "occlusion": causes,
        "occluders": dict(found.occluders),
        "histograms": histograms,
    }


def _spreads(found: Statistics) -> dict[str, dict[str, float]]:
    return {kind: spread(clips) for kind, clips in sorted(found.contacts.items())}


def page(found: Statistics, name: str, failed: int) -> str:
    """Return the page in Markdown."""
    counts = found.counts
    rows = [
        ("clips", f"{counts['clips']}{f', and {failed} that failed' if failed else ''}"),
        ("frames", f"{counts['frames']}, {counts['seconds']:.0f} s"),
        ("views of frames", str(counts["images"])),
        ("clips by persons", _listed_counts(counts, "persons")),
        ("clips by cameras", _listed_counts(counts, "cameras")),
        *((f"clips by {key}", _listed_counts(found.scenes, key)) for key in ("arena", "motion", "interaction")),
        ("different persons, motions, rigs", ", ".join(str(len(x)) for x in (found.persons, found.takes, found.rigs))),
    ]
    if counts["clips_without_truth"]:
        rows.append(("clips without truth", f"{counts['clips_without_truth']}; nothing below is of them"))
    parts = [
        f"# {name}\n\nSimulated people who hide each other: clips of calibrated cameras with exact joints.",
        f"![Histograms]({PICTURE})",
        markdown_table(("", ""), rows),
        "## Occlusion\n\n" + _occlusion(found),
        "## Contacts between people\n\n" + _contacts(found),
        "## Quantities\n\n" + _quantities(found),
        "## Rights\n\n" + terms(found.scenes),
    ]
    return "\n\n".join(parts) + "\n"


def _listed_counts(counts: Counter[str], kind: str) -> str:
    found = clips_by(counts, kind)
    order = sorted(found, key=lambda key: (not key.isdigit(), int(key) if key.isdigit() else 0, key))
    return ", ".join(f"{key}: {found[key]}" for key in order) or "not known"


def _occlusion(found: Statistics) -> str:
    if found.causes is None:
        return "Not measured: the clips have no labels of visibility."
    judged = found.causes[:, : Visibility.ABSENT]
    total = judged.sum()
    if not total:
        return "Not measured: no clip contains a person."
    rows = [
        (joint.replace("_", " "), *(f"{share:.0%}" for share in row / max(1, row.sum())))
        for joint, row in [("all", judged.sum(0)), *zip(found.joints, judged, strict=True)]
    ]
    head = ("joint", *(cause.name.lower().replace("_", " ") for cause in Visibility if cause != Visibility.ABSENT))
    hidden = judged[:, _HIDDEN].sum()
    by = [(name, f"{count / max(1, hidden):.0%}") for name, count in found.occluders.most_common(_OCCLUDERS) if count]
    return (
        "Share of joints in views, of persons who are in the scene.\n\n"
        + markdown_table(head, rows)
        + f"\n\nWhat hides the {hidden} hidden joints:\n\n"
        + markdown_table(("occluder", "of the hidden joints"), by)
    )


def _contacts(found: Statistics) -> str:
    if not found.contacts:
        return "Not measured: no clip has the state of its bodies."
    return (
        "Share of frames in which a person touches another, number of touches, and greatest force in such a frame; of "
        "clips the least, the median and the greatest.\n\n"
        + markdown_table(CONTACT_HEAD, contact_rows(_spreads(found)))
    )


CONTACT_HEAD = ("interaction", "clips", "frames in contact", "touches", "force, N")


def contact_rows(contacts: dict[str, dict]) -> list[tuple[str, ...]]:
    """Return the rows of the contact table, from `contacts` of `statistics.json`."""

    def three(row: dict, name: str, style: str) -> str:
        return " / ".join(format(row[f"{name}_{which}"], style) for which in ("least", "median", "most"))

    return [
        (kind, str(row["clips"]), three(row, "share", ".0%"), three(row, "touches", ".0f"), three(row, "force", ".0f"))
        for kind, row in contacts.items()
    ]


def _quantities(found: Statistics) -> str:
    rows = []
    for name, quantity in QUANTITIES.items():
        counts, values = found.histograms.get(name), ["not measured", "", ""]
        if counts is not None and counts.sum():
            values = [f"{value:.3g}" for value in quantiles(counts, quantity.edges)]
        rows.append((quantity.meaning, quantity.unit, *values))
    return "Precision is the bin width of the histograms in `statistics.json`.\n\n" + markdown_table(
        ("quantity", "unit", "5 % below", "median", "95 % below"), rows
    )


def quantiles(counts: np.ndarray, edges: np.ndarray) -> list[float]:
    """Return approximate quantiles of a histogram (N,), 5, 50 and 95 %: the middles of the bins that reach them."""
    reached = np.cumsum(counts) / counts.sum()
    bins = [int(np.searchsorted(reached, share - 1e-9)) for share in (0.05, 0.5, 0.95)]
    return [float((edges[each] + edges[each + 1]) / 2) for each in bins]
