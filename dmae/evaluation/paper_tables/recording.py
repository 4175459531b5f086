"""Tables of one recording: PCP of each actor (1), and by number of cameras (2), with the paper's own network.

The ends of Shelf's annotated head, which no detector finds, are placed by the formulas of published evaluations. Each
formula has constants that were tuned on that recording; `dmae.data.conversion.convert` uses that of Zhang et al. 2020,
here `4da`.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd

from dmae.data.clip import Clip, Poses3D, Source
from dmae.data.conversion import convert
from dmae.data.skeleton import SHELF14, Skeleton
from dmae.evaluation.config import EvaluateConfig, TableConfig, TableSize
from dmae.evaluation.evaluate import Trial, filled_trials, load_methods
from dmae.evaluation.paper_tables.clips import load_recording
from dmae.evaluation.paper_tables.network import MISSING, NETWORK, STAGES, TUNED_NOTE, note, paper_network
from dmae.evaluation.paper_tables.table import (
    NOISE_NOTE,
    MeasuredRow,
    TableColumn,
    actors_of,
    limb_table,
    mean_score,
    paper_table,
)
from dmae.evaluation.scores import score
from dmae.metrics.angles import leg_angles
from dmae.metrics.pcp import correct_limbs, count_limbs
from dmae.metrics.registry import protocol
from dmae.reconstruction.config import CaptureConfig, capture_method

_LANDMARKS = ("nose", "l_ear", "r_ear", "l_shoulder", "r_shoulder")
_TOP_OF_NOSE = np.array([0.75, 0.75, 1.5])
"""The top of the head from the middle of the shoulders, as multiples of the nose's offset from there."""
_SHARE = {"mvpose": 1.0, "voxelpose": 0.75}  # Weight of the nose's formula against that of the ears


def convert_with_head(poses: Poses3D, target: Skeleton, head: str) -> Poses3D:
    """Return poses on another skeleton, the ends of the head placed by a published formula.

    Args:
        poses: On any skeleton that `convert` can bring to the target.
        target: Only the head of Shelf's skeleton depends on the formula.
        head: `4da`, `mvpose` (Dong et al. 2019) or `voxelpose` (Tu et al. 2020). Poses that have that head already, or
            not the joints that the formula needs, are converted as by `4da`.
    """
    converted = convert(poses, target)
    own = target in poses.skeleton.parts or not set(_LANDMARKS) <= set(poses.skeleton.joints)
    if head not in _SHARE or target != SHELF14 or own:
        return converted
    landmarks = poses.skeleton.index(*_LANDMARKS)
    joints = poses.xyz[:, :, landmarks].astype(np.float64)
    nose, ears, shoulders = joints[:, :, 0], joints[:, :, 1:3].mean(2), joints[:, :, 3:].mean(2)
    ends = np.stack([(shoulders + nose) / 2, shoulders + (nose - shoulders) * _TOP_OF_NOSE], 2)
    if _SHARE[head] < 1:
        bottom = (shoulders + ears) / 2
        ends = _SHARE[head] * ends + (1 - _SHARE[head]) * np.stack([bottom, 2 * ears - bottom], 2)
    xyz, source = converted.xyz.copy(), converted.source.copy()
    placed = target.index("bottom_head", "top_head")
    xyz[:, :, placed] = ends
    weakest = poses.source[:, :, landmarks].max(-1, keepdims=True)
    source[:, :, placed] = np.where(np.isnan(ends).any(-1), Source.ABSENT, weakest)
    return replace(converted, xyz=xyz, source=source)


_MEASURED = "measured"
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


def actor_table(config: TableConfig, out: Path) -> dict:
    """Return table 1: PCP of each actor with all cameras.

    Args:
        config: `data` is the recording; `extra_data` are simulated clips that the paper's network is learned from.
        out: Folder for the models that are trained.

    Raises:
        ValueError: the data is more than one recording, or has no truth on Shelf's joints.
    """
    clip, tables, frames = _measure(config, [], out)
    columns = [
        TableColumn(f"actor_{number}", f"actor {number} ({count} frames)") for number, count in enumerate(frames, 1)
    ]
    rows = []
    for name, table in tables.items():
        cells = {column.key: mean_score(table[table["person"] == n]) for n, column in enumerate(columns)}
        cells |= {"average": mean_score(table), "without_2": mean_score(table[table["person"] != 1])}
        rows.append(MeasuredRow(name, cells, **_remarks(name)))
    columns.append(TableColumn("average", f"average ({'+'.join(map(str, frames))} frames)", lead=True))
    if len(frames) > 2:
        columns.append(TableColumn("without_2", "average without actor 2"))
    return _table(config, clip, columns, rows, frames, [])


def camera_table(config: TableConfig, out: Path) -> dict:
    """Return table 2: PCP by the number of cameras, over all subsets of each size.

    Raises:
        ValueError: as `actor_table`.
    """
    cameras = len(load_recording(config).rig)
    counts = [count for count in range(cameras, cameras - 3, -1) if count >= 2]
    clip, tables, frames = _measure(config, counts, out)
    columns, rows = [], {name: MeasuredRow(name, {}, **_remarks(name)) for name in tables}
    beside = "+".join(map(str, frames))
    for count in counts:
        columns.append(TableColumn(f"views_{count}", f"{count} cameras ({beside} frames)", lead=True))
        if count < len(clip.rig):
            columns.append(TableColumn(f"worst_{count}", f"worst {count}"))
        actors = [f"views_{count}_actor_{number}" for number in range(1, len(frames) + 1)]
        columns += [TableColumn(key, f"actor {number}") for number, key in enumerate(actors, 1)]
        for name, row in rows.items():
            table = tables[name][tables[name]["views"] == count]
            row.cells[f"views_{count}"] = mean_score(table)
            row.cells.update({key: mean_score(table[table["person"] == n]) for n, key in enumerate(actors)})
            if count < len(clip.rig):
                means = [mean_score(subset).value for _, subset in table.groupby("cameras")]
                row.cells[f"worst_{count}"] = float(np.fmin.reduce(means))
    notes = ["Cells are means over all subsets with this number of cameras; PCP also has the worst subset."]
    return _table(config, clip, columns, list(rows.values()), frames, notes)


def tally_trials(
    clips: Sequence[Clip],
    config: TableConfig,
    methods: dict[str, Callable[[Poses3D, float], Poses3D]],
    views: list[int],
) -> Iterator[tuple[Trial, dict[str, Poses3D], dict[str, pd.DataFrame]]]:
    """Yield every trial, the poses of each method, and the score table of its limbs by the protocol of the table."""
    rules = protocol[config.protocol]
    scoring = EvaluateConfig(capture=config.capture, views=views, skeleton=SHELF14.name)
    place: Callable[[Poses3D, Skeleton], Poses3D] = partial(convert_with_head, head=rules.head)
    for trial, filled in filled_trials(clips, scoring, methods, place):
        truth, skeleton = trial.truth.xyz, trial.truth.skeleton
        known = correct_limbs(truth, truth, skeleton)[1]
        yield (
            trial,
            filled,
            {
                name: limb_table(trial, *count_limbs(rules, poses.xyz, truth, skeleton), known)
                for name, poses in filled.items()
            },
        )


def scored_run(trial: Trial, poses: Poses3D, config: TableConfig) -> dict:
    """Return the scores of poses of a trial, as a run of `dmae.evaluation.scores.run_table`."""
    angles = leg_angles(trial.truth)[0] if config.angles else None
    scores = score(poses, trial.given, trial.truth, trial.actors, fps=trial.clip.fps, angles=angles)
    return {"clip": trial.clip.id, "cameras": trial.cameras} | scores


def angle_columns(config: TableConfig) -> list[TableColumn]:
    """Return the column of errors of joint angles, if they are scored."""
    return [TableColumn("angles", "hips, knees, ankles", "°")] if config.angles else []


def system_scores(
    clips: Sequence[Clip], config: TableConfig, views: list[int]
) -> dict[str, tuple[list[dict], pd.DataFrame]]:
    """Return the scores of each published system on its own capture, as measured: runs, and the table of limbs."""
    default = () if config.size is TableSize.small else capture_method
    found = {}
    for name in default if config.systems is None else config.systems:
        chosen, runs, tables = replace(config, capture=CaptureConfig(method=name)), [], []
        for trial, filled, limbs in tally_trials(clips, chosen, load_methods([_MEASURED]), views):
            runs.append(scored_run(trial, filled[_MEASURED], config))
            tables.append(limbs[_MEASURED].assign(views=len(trial.cameras)))
        found[name] = runs, pd.concat(tables)
    return found


def remark_on_system(name: str) -> dict[str, str]:
    """Return what has to be known about the row of a published system; nothing for other rows."""
    if name not in capture_method:
        return {}
    system = capture_method[name]
    return {"note": f"after {system.paper}, from these detections and as it measured them (capture.method={name})"}


def annotated_frames(trial: Trial) -> list[int]:
    """Return in how many frames each actor of a trial is annotated."""
    known = (~np.isnan(trial.truth.xyz).any(-1)).any(-1)
    return known[:, actors_of(trial)].sum(0).tolist()


def _measure(config: TableConfig, views: list[int], out: Path) -> tuple[Clip, dict[str, pd.DataFrame], list[int]]:
    """Return the scored clip, the score table of each method, and the annotated frames of each actor."""
    clip = load_recording(config)
    methods = load_methods(METHODS[config.size], config.weights)
    methods |= paper_network(config, clip, out)
    tables: dict[str, list[pd.DataFrame]] = {name: [] for name in methods}
    for trial, _, found in tally_trials([clip], config, methods, views):
        frames = annotated_frames(trial)
        for name, table in found.items():
            tables[name].append(table.assign(views=len(trial.cameras)))
    systems = {name: table for name, (_, table) in system_scores([clip], config, views).items()}
    return clip, {name: pd.concat(parts) for name, parts in tables.items()} | systems, frames


def _remarks(name: str) -> dict[str, str]:
    return note() if name in NETWORK else remark_on_system(name)


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
        rows = [*rows, *(MeasuredRow(name, missing=MISSING) for name in NETWORK[1:])]
    return paper_table(
        config, columns, rows, against=AGAINST, recording=clip.id, comparable="Shelf" if shelf else None,
        footnotes=[*notes, *([SHELF_NOTE] if shelf else []), PROTOCOL_NOTE, NOISE_NOTE],
        frames={f"actor {number}": count for number, count in enumerate(frames, 1)},
        pairs=STAGES if config.extra_data else (),
    )  # fmt: skip
