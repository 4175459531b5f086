"""Tables of simulated data sets: people who interact (3), error by number of cameras (6); and the maker of every table.

Table 6 is not in the paper. Published figures by number of cameras are on CMU Panoptic, whose recordings are not here;
simulated people have truth.
"""

from dataclasses import replace
from itertools import combinations
from pathlib import Path

import numpy as np
import pandas as pd

from dmae.completion.complete import load_completer
from dmae.completion.config import LearningConfig, TrainConfig
from dmae.completion.training import train
from dmae.completion.weights import find_shipped, load_model
from dmae.data.skeleton import BODY25
from dmae.evaluation.config import TableConfig, TableSize
from dmae.evaluation.evaluate import load_methods
from dmae.evaluation.paper_tables.clips import NamedClips, captured, check_truth, halves, load_sets
from dmae.evaluation.paper_tables.network import codes_table
from dmae.evaluation.paper_tables.recording import (
    AGAINST,
    METHODS,
    PROTOCOL_NOTE,
    actor_table,
    angle_columns,
    annotated_frames,
    camera_table,
    chosen_systems,
    fusion_table,
    limbs_of,
    remarks,
    scored_run,
    table_trials,
)
from dmae.evaluation.paper_tables.table import NOISE_NOTE, MeasuredRow, TableColumn, mean_score, paper_table
from dmae.evaluation.scores import figure_score, run_table, summary
from dmae.progress import progress

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
    "PCP, recall and precision of joints within 0.2 m, and MPJPE are of all joints; hidden joints are the joints that "
    "capture did not measure. If a row fills fewer of them, its error is over fewer joints.",
)
_TRANSFER_COLUMNS = (
    TableColumn("pcp", "PCP", lead=True),
    TableColumn("recall", "recall"),
    TableColumn("precision", "precision"),
    TableColumn("mpjpe", "MPJPE", "mm", lead=True),
    TableColumn("hidden_recall", "recall of hidden joints", lead=True),
    TableColumn("hidden", "MPJPE of hidden joints", "mm", lead=True),
)


def interaction_table(config: TableConfig, out: Path) -> dict:
    """Return table 3: people who interact, and the gain from learning from such people.

    Args:
        config: `data` and `extra_data` are data sets of interactions.
        out: Folder for the models that are trained.

    Raises:
        ValueError: a data set has a single clip, or a clip no truth on Shelf's joints.
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
        for name, poses in filled.items():
            runs.setdefault(name, []).append(scored_run(trial, poses, config))
            limbs.setdefault(name, []).append(limbs_of(trial, poses, config))
    rows = [_row(name, runs[name], pd.concat(limbs[name])) for name in runs]
    return paper_table(
        config, [*_TRANSFER_COLUMNS, *angle_columns(config)], rows, against=AGAINST, comparable=None,
        recording=f"{len(scored)} simulated clips",
        frames={"persons times frames": frames}, footnotes=[*_TRANSFER_NOTES, PROTOCOL_NOTE, NOISE_NOTE],
    )  # fmt: skip


def _row(name: str, runs: list[dict], limbs: pd.DataFrame) -> MeasuredRow:
    mean, table = summary(runs)["mean"], run_table(runs)
    cells = {"pcp": mean_score(limbs)} | {
        figure: figure_score(table, figure) for figure in ("mpjpe", "hidden", "angles")
    }
    cells |= {"recall": mean["pck"]["recall"], "precision": mean["pck"]["precision"]}
    return MeasuredRow(name, cells | {"hidden_recall": figure_score(table, "recall")}, **remarks(name))


def _transfer_models(config: TableConfig, learned: NamedClips, out: Path) -> dict[str, Path]:
    """Return the folders of the model that is fine-tuned on these clips, and of the model trained only on them."""
    weights = Path(config.weights) if config.weights else find_shipped(BODY25)
    model = load_model(weights)[0].config
    clips = list(captured([replace(clip, poses=None) for clip in learned], config.capture))
    tuning, steps = _TRANSFER_STEPS[config.size]
    start = {"seed": config.seed, "model": model}
    plans = {
        TUNED_HERE: TrainConfig(init=str(weights), learning=_learning(tuning), **start),
        ALONE: TrainConfig(learning=_learning(steps), **start),
    }
    folders = {TUNED_HERE: out / "models" / "table_3_tuned", ALONE: out / "models" / "table_3_alone"}
    return {name: train(plan, clips, folders[name]) for name, plan in plans.items()}


def _learning(steps: int) -> LearningConfig:
    return LearningConfig(steps=steps, epoch=min(steps, 200), observed_weight=_OBSERVED_WEIGHT)


# Table 6: error and recall by the number of cameras.

_MOST_SUBSETS = 5  # Subsets of a size for each clip, evenly spread over all of them
_NOTES = (
    "Published rows are on CMU Panoptic, with real detections of people who stand and play music in a dome; rows "
    "measured here are on simulated people, so that they are beside each other and not compared.",
    f"Up to {_MOST_SUBSETS} subsets of cameras of each size and clip. MPJPE is over joints of people who are found; "
    "recall is the share of all true joints within 0.2 m, so that a person who is not found lowers it.",
)


def counts_table(config: TableConfig, out: Path) -> dict:
    """Return table 6: error in mm and recall by the number of cameras.

    Args:
        config: `data` and `extra_data` are data sets of simulated clips, all with the same number of cameras.
        out: Not used; this table trains nothing.

    Raises:
        ValueError: a clip has no truth on Shelf's joints, or clips have different numbers of cameras.
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
            chosen = np.unique(np.linspace(0, len(subsets) - 1, _MOST_SUBSETS).astype(int))
            for subset in (subsets[index] for index in chosen):
                ((trial, filled),) = table_trials([clip.select(views=list(subset))], config, methods, [])
                for name, poses in filled.items():
                    run = scored_run(trial, poses, config) | {"cameras": subset}
                    runs.setdefault((name, count), []).append(run)
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
        recording=f"{len(clips)} simulated clips", frames={}, footnotes=[*_NOTES, NOISE_NOTE],
        rules="joints within 0.2 m",
    )  # fmt: skip


_MAKERS = {1: actor_table, 2: camera_table, 3: interaction_table, 4: fusion_table, 5: codes_table, 6: counts_table}


def make_table(config: TableConfig, out: Path) -> dict:
    """Return a table of the paper, see `dmae.evaluation.paper_tables.table.paper_table`.

    Args:
        config: The number of the table and its data.
        out: Folder for models: a training that was interrupted is continued, one that is finished is not repeated.

    Raises:
        ValueError: the data does not fit the table (no truth, another skeleton, or more or fewer clips than it is
            about), or the folder holds models of other data or options.
    """
    return _MAKERS[config.number](config, out)
