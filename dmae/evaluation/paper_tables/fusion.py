"""Table 4: pose fusion, limb by limb."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from dmae.completion.pipeline import load_completer
from dmae.completion.training.config import ExamplesConfig, LearningConfig, TrainConfig
from dmae.completion.training.train import train
from dmae.data.clip import Clip
from dmae.data.skeleton import SHELF14
from dmae.evaluation.config import EvaluateConfig
from dmae.evaluation.evaluate import load_methods
from dmae.evaluation.paper_tables.config import TableConfig, TableSize
from dmae.evaluation.paper_tables.data_sets import check_truth, load_sets
from dmae.evaluation.paper_tables.recording import (
    AGAINST,
    NOISE_NOTE,
    PROTOCOL_NOTE,
    SHELF_NOTE,
    annotated_frames,
    load_recording,
    tally_trials,
)
from dmae.evaluation.paper_tables.table import MeasuredRow, TableColumn, paper_table
from dmae.evaluation.paper_tables.tally import limb_tally, pooled
from dmae.evaluation.scores import score
from dmae.metrics.pcp import correct_limbs, limb_names
from dmae.metrics.protocols import better_limbs, protocol
from dmae.metrics.time_blocks import block_sums
from dmae.progress import progress
from dmae.reconstruction.pipeline import capture

PRETRAINED, TUNED, BETTER = (
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
_STEPS = {TableSize.small: 150, TableSize.full: 6000}
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
    methods = load_methods(EvaluateConfig(methods=["linear", "dmae"], weights=config.weights))
    for name, weights in _trained(config, clip.select(frames=slice(0, used)), out).items():
        methods[name] = load_completer(weights)
    rules = protocol["hkbu"]
    ((trial, filled, tallies),) = tally_trials([scored], config, methods, [])
    truth, frames = trial.truth.xyz, annotated_frames(trial)
    errors = {}
    for name, poses in filled.items():
        scores = score(poses, trial.given, trial.truth, trial.actors, fps=trial.clip.fps)
        errors[name] = {"mpjpe": block_sums([{"clip": trial.clip.id, "cameras": trial.cameras} | scores], "mpjpe")}
    if TUNED in filled:
        limbs = better_limbs(rules, filled[TUNED].xyz, filled[AGAINST].xyz, truth, SHELF14)
        tallies[BETTER] = limb_tally(trial, *limbs, correct_limbs(truth, truth, SHELF14)[1])
    columns, kinds = [], {}
    for group, limbs in GROUPS.items():
        columns.append(TableColumn(group, group))
        kinds[group] = [limb_names(SHELF14).index(limb) for limb in limbs]
    columns.append(TableColumn("average", f"average ({'+'.join(map(str, frames))} frames)", lead=True))
    columns.append(TableColumn("mpjpe", "MPJPE", "mm", lead=True))
    kinds["average"] = None
    rows = []
    for name, tally in tallies.items():
        cells = {key: pooled([tally], kinds=chosen) for key, chosen in kinds.items()}
        rows.append(MeasuredRow(name, cells | errors.get(name, {}), **_remarks(name)))
    missing = "there are no simulated clips to train on: give extra_data=[...]"
    rows += [MeasuredRow(name, missing=missing) for name in (PRETRAINED, TUNED, BETTER) if name not in tallies]
    shelf = clip.provenance.get("format") == "shelf"
    notes = [
        f"{TUNED}: also trained on the first {used} frames of this recording. These and the next {apart} frames are "
        "not scored in any row. Published rows are therefore not compared. The paper fine-tunes on frames that it does "
        "not evaluate; this data has no other frames.",
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


def _trained(config: TableConfig, tuning: Clip, out: Path) -> dict[str, Path]:
    """Return the folders of the models, pretrained on simulated clips and then tuned; none without such clips."""
    if not config.extra_data:
        return {}
    simulated = list(_captured(config))
    steps, epoch = _STEPS[config.size], min(_STEPS[config.size], 200)
    first = TrainConfig(skeleton=_SKELETON, learning=LearningConfig(steps=steps, epoch=epoch), seed=config.seed)
    folder = train(first, simulated, out / "models" / "table_4_pretrained")
    cameras = len(tuning.rig)
    views = [count for count in range(cameras, cameras - 3, -1) if count >= 2]
    second = replace(
        first, init=str(folder), extra_data=config.extra_data, examples=ExamplesConfig(views=views, replay=_REPLAY),
        learning=LearningConfig(steps=_TUNING_STEPS, epoch=_TUNING_STEPS),
    )  # fmt: skip
    tuned = train(second, [tuning], out / "models" / "table_4_tuned", extra_clips=simulated)
    return {PRETRAINED: folder, TUNED: tuned}


def _captured(config: TableConfig) -> Iterator[Clip]:
    for clip in progress(load_sets(config.extra_data), "capturing"):
        yield clip if clip.poses else replace(clip, poses=capture(clip, config.capture))
