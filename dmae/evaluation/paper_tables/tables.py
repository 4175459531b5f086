"""The tables. One recording: PCP by actor (1), by number of cameras (2) and by limb (4). Simulated data sets: people
who interact (3), and error by number of cameras (6). Table 5 is in `network`.

The ends of Shelf's annotated head, which no detector finds, are placed by the formulas of published evaluations. Each
formula has constants that were tuned on that recording; `dmae.data.conversion.convert` uses the formula of Zhang et al.
2020, here `4da`.

Table 6 is not in the paper. Published figures by number of cameras are on CMU Panoptic, whose recordings are not here;
simulated people have truth.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from itertools import combinations
from pathlib import Path

import numpy as np
import pandas as pd

from dmae.completion.complete import load_completer
from dmae.completion.config import LearningConfig, TrainConfig
from dmae.completion.training import train
from dmae.completion.weights import find_shipped, load_model
from dmae.data.clip import Clip, Poses3D, Source
from dmae.data.conversion import convert
from dmae.data.skeleton import BODY25, SHELF14, Skeleton
from dmae.evaluation.config import EvaluateConfig, TableConfig, TableSize
from dmae.evaluation.evaluate import Trial, filled_trials, load_methods, runs_of
from dmae.evaluation.paper_tables.clips import NamedClips, captured, check_truth, halves, load_recording, load_sets
from dmae.evaluation.paper_tables.layout import MeasuredRow, TableColumn, paper_table
from dmae.evaluation.paper_tables.network import (
    MISSING,
    NETWORK,
    NETWORK_NOTE,
    STAGES,
    TUNED,
    TUNED_NOTE,
    codes_table,
    paper_network,
)
from dmae.evaluation.scores import annotated_persons, figure_score, mean_score, run_table, summary
from dmae.metrics.angles import leg_angles
from dmae.metrics.pcp import better_limbs, correct_limbs, count_limbs, limb_names
from dmae.metrics.registry import protocol
from dmae.metrics.table import Score, block_of, tally
from dmae.numerics.statistics import evenly_spaced
from dmae.progress import progress
from dmae.reconstruction.config import CaptureConfig, capture_method

_LANDMARKS = ("nose", "l_ear", "r_ear", "l_shoulder", "r_shoulder")
_TOP_OF_NOSE = np.array([0.75, 0.75, 1.5])
"""Multiples of the offset of the nose from the middle of the shoulders, which lead to the top of the head."""
_SHARE = {"mvpose": 1.0, "voxelpose": 0.75}  # Weight of the nose; the rest is the weight of the ears


def convert_with_head(poses: Poses3D, target: Skeleton, head: str) -> Poses3D:
    """Return poses on another skeleton, as `convert`, the ends of Shelf's head placed by a published formula.

    `head` is `4da`, `mvpose` (Dong et al. 2019) or `voxelpose` (Tu et al. 2020). Poses that have that head already, or
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

SYSTEMS_NOTE = (
    "Re-implemented systems measure joints and complete none, so they are compared with `measured`, this package's "
    "capture without completion. They see detections alone, where most "
    "publications had images, affinity fields or heatmaps."
)
PROTOCOL_NOTE = (
    "strict: one prediction for one person, within 0.5 m, and a missed person fails all limbs. Published protocols are "
    "more lenient: false positives cost nothing in any of them."
)


# Trials, and the score table of their limbs by the protocol of a table


def table_trials(
    clips: Sequence[Clip],
    config: TableConfig,
    methods: dict[str, Callable[[Poses3D, float], Poses3D]],
    views: list[int],
    systems: Sequence[str] = (),
) -> Iterator[tuple[Trial, dict[str, Poses3D]]]:
    """Yield every trial with the poses of each method, on Shelf's joints with the head placed as in the protocol.

    The trials of published systems follow, each on its own capture, with its poses as it measured them.
    """
    scoring = EvaluateConfig(capture=config.capture, views=views, skeleton=SHELF14.name)
    place: Callable[[Poses3D, Skeleton], Poses3D] = partial(convert_with_head, head=protocol[config.protocol].head)
    yield from filled_trials(clips, scoring, methods, place)
    for name in systems:
        own = replace(scoring, capture=CaptureConfig(method=name))
        for trial, filled in filled_trials(clips, own, load_methods(["measured"]), place):
            yield trial, {name: filled["measured"]}


def chosen_systems(config: TableConfig) -> Sequence[str]:
    """Return the published systems that get a row: the configured ones; else all, or none in a small table."""
    if config.systems is not None:
        return config.systems
    return () if config.size == TableSize.small else [*capture_method]


def limb_table(trial: Trial, correct: np.ndarray, counted: np.ndarray) -> pd.DataFrame:
    """Return the score table of the limbs (F, T, L) of the actors of a trial: which are correct, and which count.

    Blocks of time, persons and limbs without truth have no rows; they are the same for all methods.
    """
    known = correct_limbs(trial.truth.xyz, trial.truth.xyz, trial.truth.skeleton)[1]
    correct, counted, known = (limbs[:, actors_of(trial)] for limbs in (correct & counted, counted, known))
    keys = {
        "block": block_of(np.arange(len(known)), trial.clip.fps)[:, None, None],
        "person": np.arange(known.shape[1])[:, None],
        "limb": np.arange(known.shape[2]),
    }
    cameras = ",".join(map(str, trial.cameras))
    table = tally(correct, counted, among=known, **keys)
    return table.assign(clip=trial.clip.id, cameras=cameras, views=len(trial.cameras))


def limbs_of(trial: Trial, poses: Poses3D, config: TableConfig) -> pd.DataFrame:
    """Return the score table of poses' limbs, by the table's protocol."""
    truth = trial.truth
    return limb_table(trial, *count_limbs(protocol[config.protocol], poses.xyz, truth.xyz, truth.skeleton))


def actors_of(trial: Trial) -> list[int]:
    """Return the true persons that averages include: the actors of the trial, or all annotated persons."""
    return list(annotated_persons(trial.truth) if trial.actors is None else trial.actors)


def annotated_frames(trial: Trial) -> list[int]:
    """Return in how many frames each actor of a trial is annotated."""
    known = (~np.isnan(trial.truth.xyz).any(-1)).any(-1)
    return known[:, actors_of(trial)].sum(0).tolist()


def true_angles(trial: Trial, config: TableConfig) -> np.ndarray | None:
    """Return the true angles of the legs of a trial, if they are scored."""
    return leg_angles(trial.truth)[0] if config.angles else None


def angle_columns(config: TableConfig) -> list[TableColumn]:
    """Return the column of errors of joint angles, if they are scored; Shelf's joints have no feet to show ankles."""
    return [TableColumn("angles", "hips and knees", "°")] if config.angles else []


BETTER = "better of dmae and the paper's network, final"


def remarks(name: str) -> dict[str, str]:
    """Return what has to be known about a row: fields of `MeasuredRow`."""
    if name in NETWORK:
        return {"note": NETWORK_NOTE}
    if name in capture_method:
        paper = capture_method[name].paper
        note = f"after {paper}, from these detections and as it measured them (capture.method={name})"
        return {"note": note, "against": "measured", "paper": paper}
    if name == BETTER:
        return {
            "protocol": "hkbu, better of two by the truth",
            "note": "chosen for each person and frame by looking at the truth, as the paper's released evaluation "
            "does; no system can do so",
        }
    return {}


# The tables of one recording


def actor_table(config: TableConfig, out: Path) -> dict:
    """Return table 1: PCP of each actor with all cameras. `data` is the recording.

    `extra_data` are simulated clips that the paper's network is learned from. Raises ValueError if the data is more
    than one recording, or has no truth on Shelf's joints.
    """
    clip = load_recording(config)
    tables, frames = _measure(config, clip, [], out)
    columns = [
        TableColumn(f"actor_{number}", f"actor {number} ({count} frames)") for number, count in enumerate(frames, 1)
    ]
    rows = []
    for name, table in tables.items():
        cells: dict[str, Score | float] = {"average": mean_score(table)}
        cells |= {column.key: mean_score(table[table["person"] == n]) for n, column in enumerate(columns)}
        cells["without_2"] = mean_score(table[table["person"] != 1])
        rows.append(MeasuredRow(name, cells, **remarks(name)))
    columns.append(TableColumn("average", f"average ({'+'.join(map(str, frames))} frames)", lead=True))
    if len(frames) > 2:
        columns.append(TableColumn("without_2", "average without actor 2"))
    return _recording_table(config, clip, columns, rows, frames)


def camera_table(config: TableConfig, out: Path) -> dict:
    """Return table 2: PCP by the number of cameras, over all subsets of each size; data and errors as `actor_table`."""
    clip = load_recording(config)
    counts = [count for count in range(len(clip.rig), len(clip.rig) - 3, -1) if count >= 2]
    tables, frames = _measure(config, clip, counts, out)
    columns, rows = [], {name: MeasuredRow(name, {}, **remarks(name)) for name in tables}
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
    return _recording_table(config, clip, columns, list(rows.values()), frames, notes)


GROUPS = {
    "left upper arm": "l_shoulder-l_elbow",
    "right upper arm": "r_shoulder-r_elbow",
    "left lower arm": "l_elbow-l_wrist",
    "right lower arm": "r_elbow-r_wrist",
    "left upper leg": "l_hip-l_knee",
    "right upper leg": "r_hip-r_knee",
    "left lower leg": "l_knee-l_ankle",
    "right lower leg": "r_knee-r_ankle",
    "head": "bottom_head-top_head",
    "torso": "mid_hip-bottom_head",
}
"""The limb of each column, in the paper's order."""


def fusion_table(config: TableConfig, out: Path) -> dict:
    """Return table 4: PCP of each limb with all cameras, before and after pose fusion; see `actor_table`."""
    clip = load_recording(config)
    methods = load_methods(["linear", AGAINST], config.weights) | paper_network(config, clip, out)
    ((trial, filled),) = table_trials([clip], config, methods, [])
    frames = annotated_frames(trial)
    tables = {name: limbs_of(trial, poses, config) for name, poses in filled.items()}
    errors = {}
    for name, run in runs_of(trial, filled, true_angles(trial, config)).items():
        table = run_table([run])
        errors[name] = {figure: figure_score(table, figure) for figure in ("mpjpe", "angles")}
    if TUNED in filled:
        pair = filled[AGAINST].xyz, filled[TUNED].xyz
        tables[BETTER] = limb_table(trial, *better_limbs(protocol["hkbu"], *pair, trial.truth.xyz, SHELF14))
    names = limb_names(SHELF14)
    columns = [TableColumn(group, group) for group in GROUPS]
    columns.append(TableColumn("average", f"average ({'+'.join(map(str, frames))} frames)", lead=True))
    columns += [TableColumn("mpjpe", "MPJPE", "mm", lead=True), *angle_columns(config)]
    rows = []
    for name, table in tables.items():
        cells: dict[str, Score | float] = {"average": mean_score(table), **errors.get(name, {})}
        cells |= {group: mean_score(table[table["limb"] == names.index(limb)]) for group, limb in GROUPS.items()}
        rows.append(MeasuredRow(name, cells, **remarks(name)))
    return _recording_table(config, clip, columns, rows, frames, trained=(*NETWORK[1:], BETTER))


def _measure(config: TableConfig, clip: Clip, views: list[int], out: Path) -> tuple[dict[str, pd.DataFrame], list[int]]:
    """Return the score table of the limbs of each method and system, and the annotated frames of each actor."""
    methods = load_methods(METHODS[config.size], config.weights) | paper_network(config, clip, out)
    tables: dict[str, list[pd.DataFrame]] = {}
    for trial, filled in table_trials([clip], config, methods, views, chosen_systems(config)):
        for name, poses in filled.items():
            tables.setdefault(name, []).append(limbs_of(trial, poses, config))
    return {name: pd.concat(parts) for name, parts in tables.items()}, annotated_frames(trial)


def _recording_table(
    config: TableConfig,
    clip: Clip,
    columns: Sequence[TableColumn],
    rows: Sequence[MeasuredRow],
    frames: Sequence[int],
    notes: Sequence[str] = (),
    trained: Sequence[str] = NETWORK[1:],
) -> dict:
    """Return the table; rows that are `trained` on simulated clips are not measured without such clips."""
    shelf = clip.provenance.get("format") == "shelf"
    if not config.extra_data:
        rows = [*rows, *(MeasuredRow(name, missing=MISSING) for name in trained)]
    return paper_table(
        config, columns, rows, against=AGAINST, recording=clip.id, comparable="Shelf" if shelf else None,
        frames={f"actor {number}": count for number, count in enumerate(frames, 1)},
        footnotes=[
            *notes, *([TUNED_NOTE] if config.extra_data else []), *([SHELF_NOTE] if shelf else []),
            *([SYSTEMS_NOTE] if any(row.paper for row in rows) else []), PROTOCOL_NOTE,
        ],
        pairs=STAGES if config.extra_data else (),
    )  # fmt: skip


# Table 3: interacting people, simulated in place of BU-Mocap, and the gain from transfer learning.

TUNED_HERE, ALONE = "dmae, fine-tuned on this data", "dmae, trained only on this data"
_TRANSFER_STEPS = {TableSize.small: (60, 200), TableSize.full: (1000, 6000)}
"""Steps of fine-tuning, and of training from scratch."""
_OBSERVED_WEIGHT = 0.2  # Settings with which the shipped weights were trained
_TRANSFER_NOTES = (
    "The paper's own recordings of interactions (BU-Mocap) are replaced by simulated ones. Published rows are "
    "therefore not compared. The first half of the clips of each data set is used for training, the second is scored.",
    f"dmae: weights trained on other data. {TUNED_HERE}: the same weights, then trained on the first half. {ALONE}: "
    "trained on the first half only.",
    "PCP, recall and precision of joints within 0.2 m, and MPJPE are of all joints; unmeasured joints are those that "
    "capture did not measure. If a row fills fewer of them, its error is over fewer joints.",
)
_TRANSFER_COLUMNS = (
    TableColumn("pcp", "PCP", lead=True),
    TableColumn("recall", "recall"),
    TableColumn("precision", "precision"),
    TableColumn("mpjpe", "MPJPE", "mm", lead=True),
    TableColumn("hidden_recall", "recall of unmeasured joints", lead=True),
    TableColumn("hidden", "MPJPE of unmeasured joints", "mm", lead=True),
)


def interaction_table(config: TableConfig, out: Path) -> dict:
    """Return table 3: people who interact, and the gain from learning from such people.

    `data` and `extra_data` are data sets of interactions. Raises ValueError if one has a single clip, or a clip no
    truth on Shelf's joints.
    """
    learned, scored = halves(config.data, config.extra_data)
    check_truth(scored[0], config.number)
    methods = load_methods(METHODS[config.size], config.weights)
    for name, weights in _transfer_models(config, learned, out).items():
        methods[name] = load_completer(weights)
    runs: dict[str, list[dict]] = {}
    limbs: dict[str, list[pd.DataFrame]] = {}
    frames = 0
    for trial, filled in table_trials(scored, config, methods, [], chosen_systems(config)):
        frames += sum(annotated_frames(trial)) if AGAINST in filled else 0
        for name, run in runs_of(trial, filled, true_angles(trial, config)).items():
            runs.setdefault(name, []).append(run)
            limbs.setdefault(name, []).append(limbs_of(trial, filled[name], config))
    rows = []
    for name, scored_runs in runs.items():
        mean, table = summary(scored_runs)["mean"], run_table(scored_runs)
        cells: dict[str, Score | float] = {"hidden_recall": figure_score(table, "recall")}
        cells["pcp"] = mean_score(pd.concat(limbs[name]))
        cells |= {figure: figure_score(table, figure) for figure in ("mpjpe", "hidden", "angles")}
        cells |= {"recall": mean["pck"]["recall"], "precision": mean["pck"]["precision"]}
        rows.append(MeasuredRow(name, cells, **remarks(name)))
    return paper_table(
        config, [*_TRANSFER_COLUMNS, *angle_columns(config)], rows, against=AGAINST, comparable=None,
        recording=f"{len(scored)} simulated clips",
        frames={"persons times frames": frames},
        footnotes=[*_TRANSFER_NOTES, *([SYSTEMS_NOTE] if any(row.paper for row in rows) else []), PROTOCOL_NOTE],
    )  # fmt: skip


def _transfer_models(config: TableConfig, learned: NamedClips, out: Path) -> dict[str, Path]:
    """Return the folders of the model that is fine-tuned on these clips, and of the model trained only on them."""
    weights = Path(config.weights) if config.weights else find_shipped(BODY25)
    model = load_model(weights)[0].config
    clips = list(captured([replace(clip, poses=None) for clip in learned], config.capture))
    tuning, alone = (
        LearningConfig(steps=steps, epoch=min(steps, 200), observed_weight=_OBSERVED_WEIGHT)
        for steps in _TRANSFER_STEPS[config.size]
    )
    tuned = TrainConfig(init=str(weights), learning=tuning, seed=config.seed, model=model)
    return {
        TUNED_HERE: train(tuned, clips, out / "models" / "table_3_tuned"),
        ALONE: train(replace(tuned, init=None, learning=alone), clips, out / "models" / "table_3_alone"),
    }


# Table 6: error and recall by the number of cameras.

_MOST_SUBSETS = 5  # Subsets of a size for each clip, evenly spread over all of them
_NOTES = (
    "Published rows are on CMU Panoptic, with real detections of people who stand and play music in a dome; rows "
    "measured here are on simulated people, so that they are beside each other and not compared.",
    f"Up to {_MOST_SUBSETS} subsets of cameras of each size and clip. MPJPE is over joints of people who are found; "
    "recall is the share of all true joints within 0.2 m, so that a person who is not found lowers it.",
)


def counts_table(config: TableConfig, out: Path) -> dict:
    """Return table 6: error in mm and recall by the number of cameras. It trains nothing.

    `data` and `extra_data` are data sets of simulated clips. Raises ValueError if a clip has no truth on Shelf's
    joints, or clips have different numbers of cameras.
    """
    clips = load_sets([config.data.path, *config.extra_data])
    methods = load_methods(METHODS[config.size], config.weights)
    runs: dict[tuple[str, int], list[dict]] = {}
    cameras = len(clips[0].rig)
    for clip in progress(clips, "scoring"):
        check_truth(clip, config.number)
        if len(clip.rig) != cameras:
            raise ValueError(f"clip {clip.id!r} has {len(clip.rig)} cameras, {clips[0].id!r} has {cameras}")
        for count in range(2, cameras + 1):
            subsets = list(combinations(range(cameras), count))
            chosen = evenly_spaced(len(subsets), _MOST_SUBSETS)
            for subset in (subsets[index] for index in chosen):
                ((trial, filled),) = table_trials([clip.select(views=list(subset))], config, methods, [])
                for name, run in runs_of(trial, filled, true_angles(trial, config)).items():
                    runs.setdefault((name, count), []).append(run | {"cameras": subset})
    columns, rows = [], {name: MeasuredRow(name, {}) for name in methods}
    for count in range(2, cameras + 1):
        columns.append(TableColumn(f"mpjpe_{count}", f"MPJPE, {count} cameras", "mm", lead=count == cameras))
        columns.append(TableColumn(f"recall_{count}", f"recall, {count}"))
        columns += [replace(each, key=f"angles_{count}", heading=f"angles, {count}") for each in angle_columns(config)]
        for name, row in rows.items():
            found = runs[name, count]
            table = run_table(found)
            row.cells.update({f"{figure}_{count}": figure_score(table, figure) for figure in ("mpjpe", "angles")})
            row.cells[f"recall_{count}"] = summary(found)["mean"]["pck"]["recall"]
    return paper_table(
        config, columns, list(rows.values()), against=AGAINST, comparable=None,
        recording=f"{len(clips)} simulated clips", frames={}, footnotes=_NOTES,
    )  # fmt: skip


_MAKERS = {1: actor_table, 2: camera_table, 3: interaction_table, 4: fusion_table, 5: codes_table, 6: counts_table}


def make_table(config: TableConfig, out: Path) -> dict:
    """Return a table of the paper, see `dmae.evaluation.paper_tables.layout.paper_table`.

    `out` is a folder for models: a training that was interrupted is continued, one that is finished is not repeated.
    Raises ValueError if the data does not fit the table (no truth, another skeleton, or more or fewer clips than it is
    about), or the folder holds models of other data or options.
    """
    return _MAKERS[config.number](config, out)
