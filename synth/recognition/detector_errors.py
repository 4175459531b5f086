"""Errors of a detector by the occluder of a joint: observations of clips, tables, and a figure."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from dmae.data.clip import Clip
from dmae.data.conversion import convert, convert_detections
from dmae.data.labels import Visibility
from dmae.data.resources import read_preset
from dmae.data.skeleton import BODY25
from dmae.data.store import clip_folders, load_clip
from dmae.parallel import in_parallel
from dmae.progress import progress
from dmae.reporting.tables import Table
from synth.detector.config import DetectorConfig
from synth.detector.fitting import redetect
from synth.detector.parts import KINDS
from synth.detector.statistics import FRAGMENT, GROSS, match_detections
from synth.recognition.realism import NEAR, UNOBSTRUCTED, Sightings, percent, sightings

_IN_IMAGE = Visibility.HIDDEN_BY_OBJECT
_MIRROR = list(BODY25.mirror)


@dataclass(frozen=True)
class DetectorObservations:
    """The results of a detector on some clips.

    `joints` has a row for each joint in the images of people who were found: its `kind`, its `cause` (`Visibility`),
    its `margin`, the distance in depth from the occluder, m, `error`, the distance from the true position, in heights,
    `score`, whether it was `missed`, and whether it is `inverted`: the same joint of the other side is nearer, by half
    and by `GROSS`. `people` has a row for each person in the images: the shares of joints that are `visible`, and
    `unobstructed`, visible or hidden only by the person's own body, and whether a detection was `found`. Rows of both
    have `size`, the height that the body would have if it stood upright at its distance, px, `crowding`, the distance
    in the image from the hips to the nearest other hips, in heights, and `direction`, as `Sightings.direction`.
    """

    joints: pd.DataFrame
    people: pd.DataFrame
    hidden: np.ndarray  # (n, 25) True for the joints of the n people that are hidden or outside the image
    images: int  # Number of images
    ghosts: int  # Number of detections far from every person
    duplicates: int  # Number of further detections near a person


def observe(clip: Clip) -> DetectorObservations:
    """Compare the detections of a clip with its truth.

    Raises ValueError if the clip has no truth or no visibility labels, or its detections have an unsuitable skeleton.
    """
    seen = sightings(clip)
    body = convert_detections(clip.detections, BODY25)
    true = replace(clip, rig=clip.actual_rig, detections=body, poses=None, detection_labels=None)
    assert clip.truth is not None
    match = match_detections(true, convert(clip.truth, BODY25))
    # Joints that the detector's skeleton lacks, for example small toes, do not count as misses.
    reported = (~np.isnan(match.score)).any((0, 1, 2))
    counted = match.matched[..., None] & (seen.visibility <= _IN_IMAGE) & reported
    height = seen.height[..., None]
    error = np.linalg.norm(match.found - seen.xy, axis=-1) / height
    across = np.linalg.norm(match.found - seen.xy[..., _MIRROR, :], axis=-1) / height
    sided = np.array(_MIRROR) != np.arange(len(BODY25))
    with np.errstate(invalid="ignore"):
        inverted = (error > GROSS) & (across < error / 2) & sided

    def of_joints(values: np.ndarray) -> np.ndarray:
        return np.broadcast_to(values, counted.shape)[counted]

    there = ~np.isnan(match.height)
    joints = pd.DataFrame({
        "kind": of_joints(KINDS),
        "cause": seen.visibility[counted],
        "margin": seen.depth_margin[counted],
        "size": of_joints(height),
        "crowding": of_joints(seen.crowding[..., None]),
        "direction": of_joints(seen.direction[..., None]),
        "error": error[counted],
        "score": match.score[counted],
        "missed": np.isnan(match.score[counted]),
        "inverted": inverted[counted],
    })  # fmt: skip
    people = pd.DataFrame({
        "visible": seen.visible.mean(-1)[there],
        "unobstructed": seen.unobstructed.mean(-1)[there],
        "size": seen.height[there],
        "crowding": seen.crowding[there],
        "direction": seen.direction[there],
        "found": match.matched[there],
    })  # fmt: skip
    ghosts = match.left_over & ~match.near & ~_is_cut(body.xy, seen)
    duplicates = int((match.left_over & match.near).sum())
    images = len(clip) * len(clip.rig)
    return DetectorObservations(joints, people, ~seen.visible[there], images, int(ghosts.sum()), duplicates)


def _is_cut(xy: np.ndarray, seen: Sightings) -> np.ndarray:
    """Return (F, V, D) True for detections of people that are mostly outside the image. `Match` leaves these out."""
    off = np.linalg.norm(seen.xy[:, :, None] - xy[:, :, :, None], axis=-1) / seen.height[:, :, None, :, None]
    known = ~np.isnan(off)
    middle = np.nanmedian(np.where(known.any(-1, keepdims=True), off, np.inf), -1)
    return np.any(middle < FRAGMENT, -1)


def pooled(parts: Sequence[DetectorObservations]) -> DetectorObservations:
    """Return the observations of several clips as one."""

    joints, people = (pd.concat([getattr(p, name) for p in parts], ignore_index=True) for name in ("joints", "people"))
    counts = {name: sum(getattr(part, name) for part in parts) for name in ("images", "ghosts", "duplicates")}
    return DetectorObservations(joints, people, np.concatenate([part.hidden for part in parts]), **counts)


# Tables of a detector's errors: by visibility, cause, depth margin, size, crowding, direction and joint.

_MARGINS = (0.05, 0.15, 0.3, 1.0)
_SIZES = (150.0, 250.0, 400.0)
_CROWDING = (0.15, 0.3, 0.6)
_SHARES = (0.2, 0.4, 0.6, 0.8)
_CAUSES = {
    Visibility.VISIBLE: "visible",
    Visibility.HIDDEN_BY_SELF: "hidden by the own body",
    Visibility.HIDDEN_BY_PERSON: "hidden by another person",
    Visibility.HIDDEN_BY_OBJECT: "hidden by an object",
}
_COLUMNS = (
    ("joints", "near", f"Detected joints within {NEAR:.0%} of the height, %"),
    ("joints", "median", "Median error, % of the height"),
    ("joints", "confidence", "Mean confidence, %"),
    ("joints", "missed", "Joints missed, of people who were found, %"),
    ("joints", "inverted", "Joints on that of the other side, %"),
    ("people", "found", "People found, %"),
)
"""The tables, their columns, and their captions."""


def joint_rows(joints: pd.DataFrame) -> list[dict]:
    """Return the rows of joints. Visible and hidden joints are separate in rows by size, crowding, direction, kind."""
    visible = joints.cause == Visibility.VISIBLE
    groups = [("cause", name, joints.cause == cause) for cause, name in _CAUSES.items()]
    groups += [("margin of hidden joints", *each) for each in _ranges(joints.margin, _MARGINS, "m")]
    for state, chosen in (("visible", visible), ("hidden", ~visible)):
        kinds = [("joint", str(kind), joints.kind == kind) for kind in dict.fromkeys(KINDS)]
        groups += [(f"{name}, {state}", group, some & chosen) for name, group, some in (*_sorted(joints), *kinds)]
    return [_joint_row(heading, group, joints[some]) for heading, group, some in groups if some.any()]


def people_rows(people: pd.DataFrame) -> list[dict]:
    """Return the rows of people. The rows by size, crowding and direction contain only people in plain sight."""
    plain = people.unobstructed >= UNOBSTRUCTED
    groups = [("visible joints", *each) for each in _ranges(people.visible, _SHARES)]
    groups.append(("in plain sight", "", plain))
    groups += [(f"{name}, in plain sight", group, some & plain) for name, group, some in _sorted(people)]
    return [
        {"heading": heading, "group": group, "people": int(some.sum()), "found": float(people.found[some].mean())}
        for heading, group, some in groups
        if some.any()
    ]


def _sorted(seen: pd.DataFrame) -> list[tuple[str, str, pd.Series]]:
    """Return headings and groups, with a mask of the members of each group."""
    found = [("size", *each) for each in _ranges(seen["size"], _SIZES, "px")]
    found += [("crowding", *each) for each in _ranges(seen.crowding, _CROWDING, "heights")]
    return found + [("direction", group, seen.direction == group) for group in ("facing", "sideways", "away")]


def numbers(found: DetectorObservations) -> dict:
    """Return the tables of a detector for JSON: rows of `joints`, of people that were found, and of `people`.

    Each row has a `heading` and a `group`, such as "cause" and "visible", and the number of joints or people. `found`
    and `missed` are shares of these, from 0 to 1. Of detected joints, `near` is the share with an error within 5 % of
    the height, and `inverted` the share that lies on the same joint of the other side; `median` and `p90` of
    errors are in heights. They are None if no joint was detected.
    """
    return {
        "joints": joint_rows(found.joints),
        "people": people_rows(found.people),
        "images": found.images,
        "ghosts": found.ghosts,
        "duplicates": found.duplicates,
    }


def tables(studied: dict[str, dict]) -> list[Table]:
    """Return tables with one column per detector and the rows of the first, without kinds of joints; see `numbers`."""
    names, made = list(studied), []
    for of, column, title in _COLUMNS:
        keyed = {name: {_name(row): row for row in studied[name][of]} for name in names}
        rows = [
            (key, str(row[of]), *(percent(keyed[name].get(key, {}).get(column)) for name in names))
            for key, row in keyed[names[0]].items()
            if not row["heading"].startswith("joint")
        ]
        made.append(Table(title, (of, "number", *names), rows))
    counts = [
        (name, f"{100 * each['ghosts'] / each['images']:.1f}", f"{100 * each['duplicates'] / each['images']:.1f}")
        for name, each in studied.items()
    ]
    made.append(Table("In a hundred images", ("detector", "ghosts", "duplicates"), counts))
    return made


def _name(row: dict) -> str:
    return f"{row['heading']}: {row['group']}" if row["group"] else row["heading"]


def _ranges(values: pd.Series, edges: Sequence[float], unit: str = "") -> list[tuple[str, pd.Series]]:
    """Return the name of each range between edges, with a mask of the values in it."""
    ends = (0.0, *edges, np.inf)
    after = f" {unit}" if unit else ""
    found = []
    for low, high in pairwise(ends):
        name = f"{low:g} or more{after}" if high == np.inf else f"{low:g} to {high:g}{after}"
        found.append((name, (values >= low) & ((values < high) | (high == np.inf))))
    return found


def _joint_row(heading: str, group: str, some: pd.DataFrame) -> dict:
    detected = some[~some.missed]
    row = {"heading": heading, "group": group, "joints": len(some.error), "missed": float(some.missed.mean())}
    if not len(detected.error):
        return row | dict.fromkeys(("near", "median", "p90", "confidence", "inverted"))
    return row | {
        "near": float((detected.error < NEAR).mean()),
        "median": float(np.median(detected.error)),
        "p90": float(np.quantile(detected.error, 0.9)),
        "confidence": float(detected.score.mean()),
        "inverted": float(detected.inverted.mean()),
    }


# Curves of the errors of several detectors.

_FIGURE_COLUMNS = (
    ("cause", "what hides the joint"),
    ("margin of hidden joints", "depth margin of hidden joints"),
    ("size, visible", "size, visible joints"),
    ("crowding, hidden", "nearest other person, hidden joints"),
)
_ROWS = (("near", "joints within 5 % of the height, %"), ("confidence", "mean confidence, %"), ("missed", "missed, %"))
_COLOURS = ("tab:blue", "tab:orange", "tab:green", "tab:purple", "tab:brown")
_SHORT = (("hidden by ", ""), ("the own body", "self"), ("another person", "person"), ("an object", "object"),
          (" or more", "+"), (" to ", "-"), (" heights", " h"))  # fmt: skip


def draw_errors(studied: dict[str, dict]) -> Figure:
    """Return curves of near joints, confidence and misses by cause, margin, size and crowding, a line per detector."""
    figure = Figure(figsize=(14, 8), layout="constrained")
    axes = figure.subplots(len(_ROWS), len(_FIGURE_COLUMNS), sharey="row", squeeze=False)
    for column, (heading, label) in enumerate(_FIGURE_COLUMNS):
        groups = list(dict.fromkeys(
            row["group"] for each in studied.values() for row in each["joints"] if row["heading"] == heading
        ))  # fmt: skip
        for row, (value, title) in enumerate(_ROWS):
            ax = axes[row, column]
            for number, (name, each) in enumerate(studied.items()):
                found = {line["group"]: line for line in each["joints"] if line["heading"] == heading}
                places = [i for i, group in enumerate(groups) if found.get(group, {}).get(value) is not None]
                heights = [100 * found[groups[i]][value] for i in places]
                ax.plot(places, heights, "o-", color=_COLOURS[number % len(_COLOURS)], label=name)
            ax.set_xticks(range(len(groups)), [_shortened(group) for group in groups], fontsize=8)
            ax.set_xlim(-0.3, max(len(groups) - 0.7, 0.3))
            ax.grid(color="#dddddd")
            if column == 0:
                ax.set_ylabel(title)
            if row == len(_ROWS) - 1:
                ax.set_xlabel(label)
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=len(studied))
    return figure


def _shortened(group: str) -> str:
    for long, short in _SHORT:
        group = group.replace(long, short)
    return group


# Compare a detector and simulated detectors with the same truth on the same clips.


def study(folders: Sequence[str | Path], simulated: Sequence[str], seed: int = 0, workers: int = 1) -> dict[str, dict]:
    """Return the `numbers` of the clips' own detections, and then of simulated detectors of these presets on the same
    clips, by name of the detector. Raises as `synth.detector_errors`."""
    presets = {Path(name).stem: read_preset(DetectorConfig, "detector", name) for name in simulated}
    tasks = [(clip, presets, seed) for folder in folders for clip in clip_folders(Path(folder))]
    done = list(progress(in_parallel(_study_clip, tasks, workers), "measuring", len(tasks)))
    names = {next(iter(found)) for found in done}
    if len(names) > 1:
        raise ValueError(f"expected clips of one detector, found {', '.join(sorted(names))}")
    return {name: numbers(pooled([found[name] for found in done])) for name in done[0]}


def _study_clip(folder: Path, simulated: dict[str, DetectorConfig], seed: int) -> dict[str, DetectorObservations]:
    clip = load_clip(folder)
    own = f"{clip.provenance.get('detector', 'detections')} (measured)"
    return {own: observe(clip)} | {name: observe(redetect(clip, config, seed)) for name, config in simulated.items()}
