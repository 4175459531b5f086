"""Table 3: interacting people, simulated in place of BU-Mocap, and the gain from transfer learning."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from dmae.completion.pipeline import load_completer
from dmae.completion.training.config import LearningConfig, TrainConfig
from dmae.completion.training.train import train
from dmae.completion.weights import find_shipped, load_model
from dmae.data.clip import Clip
from dmae.data.skeleton import BODY25
from dmae.evaluation.config import EvaluateConfig
from dmae.evaluation.evaluate import load_methods
from dmae.evaluation.paper_tables.config import TableConfig, TableSize
from dmae.evaluation.paper_tables.data_sets import NamedClips, check_truth, halves
from dmae.evaluation.paper_tables.recording import (
    AGAINST,
    METHODS,
    NOISE_NOTE,
    PROTOCOL_NOTE,
    annotated_frames,
    tally_trials,
)
from dmae.evaluation.paper_tables.table import MeasuredRow, TableColumn, paper_table
from dmae.evaluation.paper_tables.tally import Tally, pooled
from dmae.evaluation.scores import score, summary
from dmae.metrics.time_blocks import block_sums
from dmae.progress import progress
from dmae.reconstruction.pipeline import capture

TUNED, ALONE = "dmae, fine-tuned on this data", "dmae, trained only on this data"
_STEPS = {TableSize.small: (60, 200), TableSize.full: (1000, 6000)}
"""Steps of fine-tuning, and of training from scratch."""
_OBSERVED_WEIGHT = 0.2
"""Settings with which the shipped weights were trained."""
_NOTES = (
    "The paper's own recordings of interactions (BU-Mocap) are replaced by simulated ones. Published rows are "
    "therefore not compared. The first half of the clips of each data set is used for training, the second is scored.",
    f"dmae: weights trained on other data. {TUNED}: the same weights, then trained on the first half. {ALONE}: trained "
    "on the first half only.",
    "PCP, recall and precision of joints within 0.2 m, and MPJPE are of all joints; hidden joints are the joints that "
    "capture did not measure. If a row fills fewer of them, its error is over fewer joints.",
)
_COLUMNS = (
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
    methods = load_methods(EvaluateConfig(methods=list(METHODS[config.size]), weights=config.weights))
    for name, weights in _trained(config, learned, out).items():
        methods[name] = load_completer(weights)
    runs: dict[str, list[dict]] = {name: [] for name in methods}
    tallies: dict[str, list[Tally]] = {name: [] for name in methods}
    frames = 0
    for trial, filled, found in tally_trials(scored, config, methods, []):
        frames += sum(annotated_frames(trial))
        for name, poses in filled.items():
            scores = score(poses, trial.given, trial.truth, trial.actors, fps=trial.clip.fps)
            runs[name].append({"clip": trial.clip.id, "cameras": trial.cameras} | scores)
            tallies[name].append(found[name])
    rows = [_row(name, runs[name], tallies[name]) for name in methods]
    return paper_table(
        config, _COLUMNS, rows, against=AGAINST, comparable=None, recording=f"{len(scored)} simulated clips",
        frames={"persons times frames": frames}, footnotes=[*_NOTES, PROTOCOL_NOTE, NOISE_NOTE],
    )  # fmt: skip


def _row(name: str, runs: list[dict], tallies: list[Tally]) -> MeasuredRow:
    mean = summary(runs)["mean"]
    cells = {"pcp": pooled(tallies), "mpjpe": block_sums(runs, "mpjpe"), "hidden": block_sums(runs, "hidden")}
    cells |= {"recall": mean["pck"]["recall"], "precision": mean["pck"]["precision"]}
    return MeasuredRow(name, cells | {"hidden_recall": block_sums(runs, "recall")})


def _trained(config: TableConfig, learned: NamedClips, out: Path) -> dict[str, Path]:
    """Return the folders of the model that is fine-tuned on these clips, and of the model trained only on them."""
    weights = Path(config.weights) if config.weights else find_shipped(BODY25)
    model = load_model(weights)[0].config
    captured = list(_captured(learned, config))
    tuning, steps = _STEPS[config.size]
    start = {"seed": config.seed, "model": model}
    plans = {
        TUNED: TrainConfig(init=str(weights), learning=_learning(tuning), **start),
        ALONE: TrainConfig(learning=_learning(steps), **start),
    }
    folders = {TUNED: out / "models" / "table_3_tuned", ALONE: out / "models" / "table_3_alone"}
    return {name: train(plan, captured, folders[name]) for name, plan in plans.items()}


def _learning(steps: int) -> LearningConfig:
    return LearningConfig(steps=steps, epoch=min(steps, 200), observed_weight=_OBSERVED_WEIGHT)


def _captured(clips: NamedClips, config: TableConfig) -> Iterator[Clip]:
    for clip in progress(clips, "capturing"):
        yield replace(clip, poses=capture(clip, config.capture))
