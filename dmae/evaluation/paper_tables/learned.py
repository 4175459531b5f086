"""Tables for which models are trained: people who interact (3), pose fusion (4), the codes of joint and time (5)."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import torch

from dmae.completion.complete import load_completer
from dmae.completion.config import (
    AugmentConfig,
    CodesConfig,
    DecoderConfig,
    EncoderConfig,
    ExamplesConfig,
    LearningConfig,
    Loss,
    MaskingConfig,
    ModelConfig,
    TrainConfig,
)
from dmae.completion.network import DMAE
from dmae.completion.training import train
from dmae.completion.training_data import Recipe, cut_examples, masked_rows, pose_pair
from dmae.completion.weights import find_shipped, load_model
from dmae.data.clip import Clip
from dmae.data.rng import Stream, generator
from dmae.data.skeleton import BODY25, SHELF14
from dmae.evaluation.config import TableConfig, TableSize
from dmae.evaluation.evaluate import load_methods
from dmae.evaluation.paper_tables.cameras import counts_table
from dmae.evaluation.paper_tables.recording import (
    AGAINST,
    METHODS,
    NOISE_NOTE,
    PROTOCOL_NOTE,
    SHELF_NOTE,
    NamedClips,
    actor_table,
    annotated_frames,
    camera_table,
    check_truth,
    halves,
    load_recording,
    load_sets,
    remark_on_system,
    system_scores,
    tally_trials,
)
from dmae.evaluation.paper_tables.table import MeasuredRow, TableColumn, limb_table, mean_score, paper_table
from dmae.evaluation.scores import figure_score, run_table, score, summary
from dmae.metrics.pcp import better_limbs, correct_limbs, limb_names
from dmae.metrics.position import PCK_THRESHOLD
from dmae.metrics.registry import protocol
from dmae.metrics.table import block_of, tally
from dmae.progress import progress
from dmae.reconstruction.pipeline import capture

# Table 5: the codes of joint and time, in the network of the paper and with its masks.

BOTH, INTERPOLATED = "both codes", "interpolation through the same masks"
VARIANTS = {
    "neither code": CodesConfig(signal=64, no_joint=True, no_time=True),
    "code of time": CodesConfig(signal=64, no_joint=True),
    "code of joints": CodesConfig(signal=64, no_time=True),
    BOTH: CodesConfig(signal=64),
}
_CODE_STEPS = {TableSize.small: 300, TableSize.full: 9000}
_CODE_NOTES = (
    "The paper's network in a size that a CPU trains in minutes (64 channels, two layers; the paper has 256 and six), "
    "trained and scored on simulated clips, since BU-Mocap is not available and the paper's 1000 epochs are beyond a "
    "CPU. Half of the joints and half of the frames are masked, as in the paper.",
    "The second half of the clips is scored: masked joints within 0.2 m (recall), and their mean error. One training a "
    "row: intervals are about other moments, not about other trainings.",
)
_CODE_COLUMNS = (
    TableColumn("recall", "recall of masked joints", lead=True),
    TableColumn("mpjpe", "MPJPE of masked joints", "mm", lead=True),
)


def codes_table(config: TableConfig, out: Path) -> dict:
    """Return table 5.

    Args:
        config: `data` and `extra_data` are data sets of clips with truth.
        out: Folder for the models that are trained.

    Raises:
        ValueError: a data set has a single clip, or a clip no truth.
    """
    learned, scored = halves(config.data, config.extra_data)
    clips = [replace(clip, poses=None) for clip in learned]
    plan = training_plan(config)
    tables: dict[str, pd.DataFrame] = {}
    for name, codes in VARIANTS.items():
        changed = replace(plan, model=replace(plan.model, codes=codes))
        folder = train(changed, clips, out / "models" / f"table_5_{name.replace(' ', '_')}")
        tables[name] = _masked_joints(load_model(folder)[0], plan, scored, interpolated=False)
    tables[INTERPOLATED] = _masked_joints(load_model(folder)[0], plan, scored, interpolated=True)
    rows = []
    for name, table in tables.items():
        recall, error = (table[table["figure"] == figure] for figure in ("recall", "mpjpe"))
        rows.append(MeasuredRow(name, {"recall": mean_score(recall), "mpjpe": mean_score(error, scale=1.0)}))
    return paper_table(
        config, _CODE_COLUMNS, rows, against=BOTH, comparable=None, recording=f"{len(scored)} simulated clips",
        frames={}, footnotes=[*_CODE_NOTES, NOISE_NOTE], rules="joints within 0.2 m",
    )  # fmt: skip


def training_plan(config: TableConfig) -> TrainConfig:
    """Return how each network is trained: as `model=paper`, smaller and faster."""
    steps = _CODE_STEPS[config.size]
    return TrainConfig(
        model=ModelConfig(
            encoder=EncoderConfig(dim=64, depth=2, heads=2, head_dim=32, mlp=128),
            decoder=DecoderConfig(dim=32, depth=1),
            dropout=0.1, key_init=0.0, residual=False, align_heading=False,
        ),
        examples=ExamplesConfig(
            masking=MaskingConfig(scattered=1.0, joints=0.5, frames=0.5),
            augment=AugmentConfig(mirror=0.0, reverse=0.0, scale=0.0, speed=0.0, true_poses=0.0, noise=0.0),
        ),
        learning=LearningConfig(steps=steps, epoch=min(steps, 500), loss=Loss.mse, lr=1e-3),
        seed=config.seed,
    )  # fmt: skip


def _masked_joints(model: DMAE, plan: TrainConfig, clips: NamedClips, *, interpolated: bool) -> pd.DataFrame:
    """Return the score table of masked joints: recall, and error in mm. The masks are the same for every model."""
    recipe = Recipe(plan.model, model.rest.numpy().astype(np.float64), plan.examples.masking, plan.examples.augment)
    parts = []
    for number, clip in enumerate(clips):
        pair = pose_pair(replace(clip, poses=None), BODY25, plan.model.fps)
        rows = masked_rows(pair, recipe, rng=generator(plan.seed, number, Stream.STRESS))
        length = len(rows.base) // pair.truth.xyz.shape[1]
        starts = rows.starts[rows.starts % length % recipe.model.frames == 0]
        examples = cut_examples(rows, starts, recipe.model)
        with torch.inference_mode():
            predicted = examples.windows.base if interpolated else model(*examples.windows).xyz
        error = torch.linalg.norm(predicted - examples.truth, dim=-1).numpy()
        frames = starts[:, None] % length + np.arange(recipe.model.frames)
        keys = {"block": block_of(frames, recipe.model.fps)[..., None]}
        for figure, value in (("recall", error <= PCK_THRESHOLD), ("mpjpe", 1000 * error)):
            table = tally(value, examples.hidden.numpy(), **keys)
            parts.append(table.assign(figure=figure, clip=clip.id, cameras="", person=0))
    return pd.concat(parts)


# Table 3: interacting people, simulated in place of BU-Mocap, and the gain from transfer learning.

TUNED_HERE, ALONE = "dmae, fine-tuned on this data", "dmae, trained only on this data"
_TRANSFER_STEPS = {TableSize.small: (60, 200), TableSize.full: (1000, 6000)}
"""Steps of fine-tuning, and of training from scratch."""
_OBSERVED_WEIGHT = 0.2
"""Settings with which the shipped weights were trained."""
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
            scores = score(poses, trial.given, trial.truth, trial.actors, fps=trial.clip.fps)
            runs[name].append({"clip": trial.clip.id, "cameras": trial.cameras} | scores)
            limbs[name].append(found[name])
    rows = [_row(name, runs[name], pd.concat(limbs[name])) for name in methods]
    rows += [_row(name, *found) for name, found in system_scores(scored, config, []).items()]
    return paper_table(
        config, _TRANSFER_COLUMNS, rows, against=AGAINST, comparable=None, recording=f"{len(scored)} simulated clips",
        frames={"persons times frames": frames}, footnotes=[*_TRANSFER_NOTES, PROTOCOL_NOTE, NOISE_NOTE],
    )  # fmt: skip


def _row(name: str, runs: list[dict], limbs: pd.DataFrame) -> MeasuredRow:
    mean, table = summary(runs)["mean"], run_table(runs)
    cells = {"pcp": mean_score(limbs), "mpjpe": figure_score(table, "mpjpe"), "hidden": figure_score(table, "hidden")}
    cells |= {"recall": mean["pck"]["recall"], "precision": mean["pck"]["precision"]}
    return MeasuredRow(name, cells | {"hidden_recall": figure_score(table, "recall")}, **remark_on_system(name))


def _transfer_models(config: TableConfig, learned: NamedClips, out: Path) -> dict[str, Path]:
    """Return the folders of the model that is fine-tuned on these clips, and of the model trained only on them."""
    weights = Path(config.weights) if config.weights else find_shipped(BODY25)
    model = load_model(weights)[0].config
    captured = list(_transfer_clips(learned, config))
    tuning, steps = _TRANSFER_STEPS[config.size]
    start = {"seed": config.seed, "model": model}
    plans = {
        TUNED_HERE: TrainConfig(init=str(weights), learning=_learning(tuning), **start),
        ALONE: TrainConfig(learning=_learning(steps), **start),
    }
    folders = {TUNED_HERE: out / "models" / "table_3_tuned", ALONE: out / "models" / "table_3_alone"}
    return {name: train(plan, captured, folders[name]) for name, plan in plans.items()}


def _learning(steps: int) -> LearningConfig:
    return LearningConfig(steps=steps, epoch=min(steps, 200), observed_weight=_OBSERVED_WEIGHT)


def _transfer_clips(clips: NamedClips, config: TableConfig) -> Iterator[Clip]:
    for clip in progress(clips, "capturing"):
        yield replace(clip, poses=capture(clip, config.capture))


# Table 4: pose fusion, limb by limb.

FUSED, FUSED_TUNED, BETTER = (
    "fusion, trained only on simulation", "fusion, fine-tuned on some frames", "better of dmae and tuned fusion",
)  # fmt: skip
GROUPS = {
    "head": ("bottom_head-top_head",),
    "torso": ("mid_hip-bottom_head",),
    "upper arms": ("r_shoulder-r_elbow", "l_shoulder-l_elbow"),
    "lower arms": ("r_elbow-r_wrist", "l_elbow-l_wrist"),
    "upper legs": ("r_hip-r_knee", "l_hip-l_knee"),
    "lower legs": ("r_knee-r_ankle", "l_knee-l_ankle"),
}
"""Limbs that published evaluations report together."""
_SKELETON = "body21+shelf14"
_FUSION_STEPS = {TableSize.small: 150, TableSize.full: 6000}
_TUNING_STEPS = 60
_REPLAY = 0.25
_TUNED_FRAMES, _APART = 40, 10
"""Frames at the beginning of the recording that are learned from, and those after them that are not scored."""


def fusion_table(config: TableConfig, out: Path) -> dict:
    """Return table 4.

    Args:
        config: `data` is a recording; `extra_data` are simulated clips that fusion is learned from.
        out: Folder for the models that are trained.

    Raises:
        ValueError: the data is more than one recording, or has no truth on Shelf's joints.
    """
    clip = load_recording(config)
    used = min(_TUNED_FRAMES, len(clip) // 4)
    apart = min(_APART, used)
    scored = clip.select(frames=slice(used + apart, None))
    check_truth(scored, config.number)
    methods = load_methods(["linear", "dmae"], config.weights)
    for name, weights in _fusion_models(config, clip.select(frames=slice(0, used)), out).items():
        methods[name] = load_completer(weights)
    rules = protocol["hkbu"]
    ((trial, filled, tables),) = tally_trials([scored], config, methods, [])
    truth, frames = trial.truth.xyz, annotated_frames(trial)
    errors = {}
    for name, poses in filled.items():
        scores = score(poses, trial.given, trial.truth, trial.actors, fps=trial.clip.fps)
        run = {"clip": trial.clip.id, "cameras": trial.cameras} | scores
        errors[name] = {"mpjpe": figure_score(run_table([run]), "mpjpe")}
    if FUSED_TUNED in filled:
        limbs = better_limbs(rules, filled[FUSED_TUNED].xyz, filled[AGAINST].xyz, truth, SHELF14)
        tables[BETTER] = limb_table(trial, *limbs, correct_limbs(truth, truth, SHELF14)[1])
    columns, kinds = [], {}
    for group, limbs in GROUPS.items():
        columns.append(TableColumn(group, group))
        kinds[group] = [limb_names(SHELF14).index(limb) for limb in limbs]
    columns.append(TableColumn("average", f"average ({'+'.join(map(str, frames))} frames)", lead=True))
    columns.append(TableColumn("mpjpe", "MPJPE", "mm", lead=True))
    kinds["average"] = [*range(len(limb_names(SHELF14)))]
    rows = []
    for name, table in tables.items():
        cells = {key: mean_score(table[table["limb"].isin(chosen)]) for key, chosen in kinds.items()}
        rows.append(MeasuredRow(name, cells | errors.get(name, {}), **_remarks(name)))
    missing = "there are no simulated clips to train on: give extra_data=[...]"
    rows += [MeasuredRow(name, missing=missing) for name in (FUSED, FUSED_TUNED, BETTER) if name not in tables]
    shelf = clip.provenance.get("format") == "shelf"
    notes = [
        f"{FUSED_TUNED}: also trained on the first {used} frames of this recording. These and the next {apart} frames "
        "are not scored in any row. Published rows are therefore not compared. The paper fine-tunes on frames that it "
        "does not evaluate; this data has no other frames.",
        *([SHELF_NOTE] if shelf else []), PROTOCOL_NOTE, NOISE_NOTE,
    ]  # fmt: skip
    return paper_table(
        config, columns, rows, against=AGAINST, comparable=None, recording=clip.id,
        frames={f"actor {number}": count for number, count in enumerate(frames, 1)}, footnotes=notes,
    )  # fmt: skip


def _remarks(name: str) -> dict[str, str]:
    if name != BETTER:
        return {}
    return {
        "protocol": "hkbu, better of two by the truth",
        "note": "chosen for each person and frame by looking at the truth, as the paper's released evaluation does; no "
        "system can do so",
    }


def _fusion_models(config: TableConfig, tuning: Clip, out: Path) -> dict[str, Path]:
    """Return the folders of the models, pretrained on simulated clips and then tuned; none without such clips."""
    if not config.extra_data:
        return {}
    simulated = list(_fusion_clips(config))
    steps, epoch = _FUSION_STEPS[config.size], min(_FUSION_STEPS[config.size], 200)
    first = TrainConfig(skeleton=_SKELETON, learning=LearningConfig(steps=steps, epoch=epoch), seed=config.seed)
    folder = train(first, simulated, out / "models" / "table_4_pretrained")
    cameras = len(tuning.rig)
    views = [count for count in range(cameras, cameras - 3, -1) if count >= 2]
    second = replace(
        first, init=str(folder), extra_data=config.extra_data, examples=ExamplesConfig(views=views, replay=_REPLAY),
        learning=LearningConfig(steps=_TUNING_STEPS, epoch=_TUNING_STEPS),
    )  # fmt: skip
    tuned = train(second, [tuning], out / "models" / "table_4_tuned", extra_clips=simulated)
    return {FUSED: folder, FUSED_TUNED: tuned}


def _fusion_clips(config: TableConfig) -> Iterator[Clip]:
    for clip in progress(load_sets(config.extra_data), "capturing"):
        yield clip if clip.poses else replace(clip, poses=capture(clip, config.capture))


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
