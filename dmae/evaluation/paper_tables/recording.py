"""Tables of one recording: PCP of each actor (1), and by number of cameras (2)."""

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path

import numpy as np

from dmae.data.clip import Clip, Poses3D
from dmae.data.skeleton import SHELF14, Skeleton
from dmae.evaluation.config import EvaluateConfig
from dmae.evaluation.evaluate import load_methods
from dmae.evaluation.paper_tables.config import TableConfig, TableSize
from dmae.evaluation.paper_tables.data_sets import check_truth
from dmae.evaluation.paper_tables.head_placement import convert_with_head
from dmae.evaluation.paper_tables.paper_network import (
    APART,
    MISSING,
    PRETRAINED,
    TUNED,
    TUNED_FRAMES,
    note,
    paper_network,
)
from dmae.evaluation.paper_tables.table import MeasuredRow, TableColumn, paper_table
from dmae.evaluation.paper_tables.tally import Tally, actors_of, limb_tally, pooled
from dmae.evaluation.trials import Trial, filled_trials
from dmae.formats.reading import load
from dmae.metrics.intervals import bootstrap_ratio
from dmae.metrics.pcp import correct_limbs
from dmae.metrics.protocols import Protocol, count_limbs, protocol

METHODS = {
    TableSize.small: ("measured", "linear", "dmae"),
    TableSize.full: ("measured", "linear", "pchip_body", "gaussian_process", "dmae", "dmae_denoise"),
}
AGAINST = "dmae"
"""The row that all others are compared with: the shipped network with default settings."""
SHELF_NOTE = (
    "Published rows are over all 301 frames of Shelf, in which actors 1 to 3 are annotated 279, 37 and 161 times. Rows "
    "measured here are over the frames that are annotated in the data they were given, as the columns state: "
    "differences of some tenths may come from that alone, and a published row that is not called noise is not thereby "
    "shown to differ."
)

PROTOCOL_NOTE = (
    "strict: one prediction for one person, within 0.5 m, and a missed person fails all limbs. Published protocols are "
    "more lenient: false positives cost nothing in any of them."
)
TUNED_NOTE = (
    f"{TUNED}: the first {TUNED_FRAMES} frames of this recording are learned from, as captured by all subsets of the "
    f"cameras. They and the {APART} after them are scored in no row. The paper tunes on Shelf's other frames; this "
    "data has no others."
)
NOISE_NOTE = (
    "Brackets: 95 % bootstrap intervals over blocks of one second. A difference with zero in its interval is noise. "
    "Published figures come without an interval, and theirs is taken to be nothing; under another protocol they differ "
    "by that, too. No interval is stated for fewer than five blocks."
)


def actor_table(config: TableConfig, out: Path) -> dict:
    """Return table 1: PCP of each actor with all cameras.

    Args:
        config: `data` is the recording; `extra_data` are simulated clips that the paper's network is learned from.
        out: Folder for the models that are trained.

    Raises:
        ValueError: the data is more than one recording, or has no truth on Shelf's joints.
    """
    clip, tallies, actors, frames = _measure(config, [], out)
    columns = [
        TableColumn(f"actor_{number}", f"actor {number} ({count} frames)")
        for number, count in zip(range(1, len(actors) + 1), frames, strict=True)
    ]
    columns.append(TableColumn("average", f"average ({'+'.join(map(str, frames))} frames)", lead=True))
    rows = []
    for name, found in tallies.items():
        cells = {column.key: pooled(found, [person]) for person, column in enumerate(columns[:-1])}
        rows.append(MeasuredRow(name, cells | {"average": pooled(found)}, **_remarks(name, config)))
    return _table(config, clip, columns, rows, frames, [])


def camera_table(config: TableConfig, out: Path) -> dict:
    """Return table 2: PCP by the number of cameras, over all subsets of each size.

    Raises:
        ValueError: as `actor_table`.
    """
    cameras = len(load_recording(config).rig)
    counts = [count for count in range(cameras, cameras - 3, -1) if count >= 2]
    clip, tallies, _, frames = _measure(config, counts, out)
    columns, rows = [], {name: MeasuredRow(name, {}, **_remarks(name, config)) for name in tallies}
    beside = "+".join(map(str, frames))
    for count in counts:
        found = {name: [each for each in runs if len(each.cameras) == count] for name, runs in tallies.items()}
        columns.append(TableColumn(f"views_{count}", f"{count} cameras ({beside} frames)", lead=True))
        for name, row in rows.items():
            row.cells[f"views_{count}"] = pooled(found[name])
        if count < len(clip.rig):
            columns.append(TableColumn(f"worst_{count}", f"worst {count}"))
            for name, row in rows.items():
                row.cells[f"worst_{count}"] = float(np.fmin.reduce([_mean(each) for each in found[name]]))
    notes = ["Cells are means over all subsets with this number of cameras; PCP also has the worst subset."]
    return _table(config, clip, columns, list(rows.values()), frames, notes)


def load_recording(config: TableConfig) -> Clip:
    """Return the one clip that a table of a recording is about.

    Raises:
        ValueError: there are several, or it has no truth on Shelf's joints.
    """
    clips = load(config.data)
    if len(clips) != 1:
        raise ValueError(
            f"{config.data.path}: {len(clips)} clips; table {config.number} is about the people of one recording. Name "
            "a single clip's folder"
        )
    (clip,) = clips
    check_truth(clip, config.number)
    return clip


def tally_trials(
    clips: Sequence[Clip],
    config: TableConfig,
    methods: dict[str, Callable[[Poses3D, float], Poses3D]],
    views: list[int],
) -> Iterator[tuple[Trial, dict[str, Poses3D], dict[str, Tally]]]:
    """Yield every trial, the poses of each method, and the tally of its limbs by the protocol of the table."""
    rules = protocol[config.protocol]
    scoring = EvaluateConfig(capture=config.capture, views=views, skeleton=SHELF14.name)
    place: Callable[[Poses3D, Skeleton], Poses3D] = partial(convert_with_head, head=rules.head)
    for trial, filled in filled_trials(clips, scoring, methods, place):
        yield trial, filled, {name: tally_poses(trial, poses, rules) for name, poses in filled.items()}


def tally_poses(trial: Trial, poses: Poses3D, rules: Protocol) -> Tally:
    """Return the tally of the limbs of one prediction."""
    truth = trial.truth.xyz
    correct, counted = count_limbs(rules, poses.xyz, truth, trial.truth.skeleton)
    return limb_tally(trial, correct, counted, correct_limbs(truth, truth, trial.truth.skeleton)[1])


def annotated_frames(trial: Trial) -> list[int]:
    """Return in how many frames each actor of a trial is annotated."""
    known = (~np.isnan(trial.truth.xyz).any(-1)).any(-1)
    return known[:, actors_of(trial)].sum(0).tolist()


def _measure(
    config: TableConfig, views: list[int], out: Path
) -> tuple[Clip, dict[str, list[Tally]], list[int], list[int]]:
    """Return the scored clip, the tallies of each method, the actors, and the annotated frames of each actor."""
    clip = load_recording(config)
    methods = load_methods(EvaluateConfig(methods=list(METHODS[config.size]), weights=config.weights))
    if config.extra_data:
        used = min(TUNED_FRAMES, len(clip) // 4)
        methods |= paper_network(config, clip.select(frames=slice(0, used)), out)
        clip = clip.select(frames=slice(used + min(APART, used), None))
        check_truth(clip, config.number)
    tallies: dict[str, list[Tally]] = {name: [] for name in methods}
    actors, frames = [], []
    for trial, _, found in tally_trials([clip], config, methods, views):
        actors, frames = actors_of(trial), annotated_frames(trial)
        for name, tally in found.items():
            tallies[name].append(tally)
    return clip, tallies, actors, frames


def _remarks(name: str, config: TableConfig) -> dict[str, str]:
    return note(config) if name in (PRETRAINED, TUNED) else {}


def _mean(tally: Tally) -> float:
    """Return the mean PCP of a subset of cameras, %; NaN where nothing counts."""
    return bootstrap_ratio(pooled([tally]), draws=1).value


def _table(
    config: TableConfig,
    clip: Clip,
    columns: Sequence[TableColumn],
    rows: Sequence[MeasuredRow],
    frames: Sequence[int],
    notes: Sequence[str],
) -> dict:
    shelf = clip.provenance.get("format") == "shelf"
    if config.extra_data:
        notes = [*notes, TUNED_NOTE]
    else:
        rows = [*rows, *(MeasuredRow(name, missing=MISSING) for name in (PRETRAINED, TUNED))]
    return paper_table(
        config, columns, rows, against=AGAINST, recording=clip.id, comparable="Shelf" if shelf else None,
        footnotes=[*notes, *([SHELF_NOTE] if shelf else []), PROTOCOL_NOTE, NOISE_NOTE],
        frames={f"actor {number}": count for number, count in enumerate(frames, 1)},
    )  # fmt: skip
