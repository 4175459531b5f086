"""Tables for which models are trained: people who interact (3) and pose fusion (4); and the maker of every table."""

from dataclasses import replace
from pathlib import Path

import pandas as pd

from dmae.completion.complete import load_completer
from dmae.completion.config import LearningConfig, TrainConfig
from dmae.completion.training import train
from dmae.completion.weights import find_shipped, load_model
from dmae.data.skeleton import BODY25, SHELF14
from dmae.evaluation.config import TableConfig, TableSize
from dmae.evaluation.evaluate import load_methods
from dmae.evaluation.paper_tables.cameras import counts_table
from dmae.evaluation.paper_tables.clips import NamedClips, captured, check_truth, halves, load_recording
from dmae.evaluation.paper_tables.network import (
    MISSING,
    NETWORK,
    STAGES,
    TUNED,
    TUNED_NOTE,
    codes_table,
    note,
    paper_network,
)
from dmae.evaluation.paper_tables.recording import (
    AGAINST,
    METHODS,
    PROTOCOL_NOTE,
    SHELF_NOTE,
    actor_table,
    angle_columns,
    annotated_frames,
    camera_table,
    remark_on_system,
    scored_run,
    system_scores,
    tally_trials,
)
from dmae.evaluation.paper_tables.table import NOISE_NOTE, MeasuredRow, TableColumn, limb_table, mean_score, paper_table
from dmae.evaluation.scores import figure_score, run_table, summary
from dmae.metrics.pcp import better_limbs, correct_limbs, limb_names
from dmae.metrics.registry import protocol

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
    """Return table 3.

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
    runs: dict[str, list[dict]] = {name: [] for name in methods}
    limbs: dict[str, list[pd.DataFrame]] = {name: [] for name in methods}
    frames = 0
    for trial, filled, found in tally_trials(scored, config, methods, []):
        frames += sum(annotated_frames(trial))
        for name, poses in filled.items():
            runs[name].append(scored_run(trial, poses, config))
            limbs[name].append(found[name])
    rows = [_row(name, runs[name], pd.concat(limbs[name])) for name in methods]
    rows += [_row(name, *found) for name, found in system_scores(scored, config, []).items()]
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
    return MeasuredRow(name, cells | {"hidden_recall": figure_score(table, "recall")}, **remark_on_system(name))


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


# Table 4: pose fusion, limb by limb.

BETTER = "better of dmae and the paper's network, final"
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
    """Return table 4, with all cameras.

    Args:
        config: `data` is a recording; `extra_data` are simulated clips that fusion is learned from.
        out: Folder for the models that are trained.

    Raises:
        ValueError: the data is more than one recording, or has no truth on Shelf's joints.
    """
    clip = load_recording(config)
    methods = load_methods(["linear", AGAINST], config.weights) | paper_network(config, clip, out)
    rules = protocol["hkbu"]
    ((trial, filled, tables),) = tally_trials([clip], config, methods, [])
    truth, frames = trial.truth.xyz, annotated_frames(trial)
    errors = {}
    for name, poses in filled.items():
        table = run_table([scored_run(trial, poses, config)])
        errors[name] = {figure: figure_score(table, figure) for figure in ("mpjpe", "angles")}
    if TUNED in filled:
        limbs = better_limbs(rules, filled[AGAINST].xyz, filled[TUNED].xyz, truth, SHELF14)
        tables[BETTER] = limb_table(trial, *limbs, correct_limbs(truth, truth, SHELF14)[1])
    columns, kinds = [], {}
    for group, limb in GROUPS.items():
        columns.append(TableColumn(group, group))
        kinds[group] = [limb_names(SHELF14).index(limb)]
    columns.append(TableColumn("average", f"average ({'+'.join(map(str, frames))} frames)", lead=True))
    columns += [TableColumn("mpjpe", "MPJPE", "mm", lead=True), *angle_columns(config)]
    kinds["average"] = [*range(len(limb_names(SHELF14)))]
    rows = []
    for name, table in tables.items():
        cells = {key: mean_score(table[table["limb"].isin(chosen)]) for key, chosen in kinds.items()}
        rows.append(MeasuredRow(name, cells | errors.get(name, {}), **_remarks(name)))
    rows += [MeasuredRow(name, missing=MISSING) for name in (*NETWORK[1:], BETTER) if name not in tables]
    shelf = clip.provenance.get("format") == "shelf"
    return paper_table(
        config, columns, rows, against=AGAINST, comparable="Shelf" if shelf else None, recording=clip.id,
        frames={f"actor {number}": count for number, count in enumerate(frames, 1)},
        footnotes=[TUNED_NOTE, *([SHELF_NOTE] if shelf else []), PROTOCOL_NOTE, NOISE_NOTE],
        pairs=STAGES if config.extra_data else (),
    )  # fmt: skip


def _remarks(name: str) -> dict[str, str]:
    if name in NETWORK:
        return note()
    if name != BETTER:
        return {}
    return {
        "protocol": "hkbu, better of two by the truth",
        "note": "chosen for each person and frame by looking at the truth, as the paper's released evaluation does; no "
        "system can do so",
    }


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
