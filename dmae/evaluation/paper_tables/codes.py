"""Table 5: ablation of the codes of joint and time, in the paper's network and with its masks."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch

from dmae.completion.network.config import CodesConfig, DecoderConfig, EncoderConfig, ModelConfig
from dmae.completion.network.paper import DMAE
from dmae.completion.training.augmentation import AugmentConfig
from dmae.completion.training.config import ExamplesConfig, LearningConfig, Loss, TrainConfig
from dmae.completion.training.examples import Recipe, cut_examples, masked_rows
from dmae.completion.training.masking import MaskingConfig
from dmae.completion.training.pose_pairs import PosePair, pose_pair
from dmae.completion.training.train import train
from dmae.completion.weights import load_model
from dmae.completion.windows import Rows
from dmae.data.clip import Clip
from dmae.data.rng import Stream, generator
from dmae.data.skeleton import BODY25
from dmae.evaluation.paper_tables.config import TableConfig, TableSize
from dmae.evaluation.paper_tables.data_sets import NamedClips, halves
from dmae.evaluation.paper_tables.recording import NOISE_NOTE
from dmae.evaluation.paper_tables.table import MeasuredRow, TableColumn, paper_table
from dmae.evaluation.paper_tables.tally import Tally, pooled
from dmae.metrics.pck import PCK_THRESHOLD
from dmae.metrics.time_blocks import block_members

BOTH, INTERPOLATED = "both codes", "interpolation through the same masks"
VARIANTS = {
    "neither code": CodesConfig(signal=64, no_joint=True, no_time=True),
    "code of time": CodesConfig(signal=64, no_joint=True),
    "code of joints": CodesConfig(signal=64, no_time=True),
    BOTH: CodesConfig(signal=64),
}
_STEPS = {TableSize.small: 300, TableSize.full: 9000}
_NOTES = (
    "The paper's network in a size that a CPU trains in minutes (64 channels, two layers; the paper has 256 and six), "
    "trained and scored on simulated clips, since BU-Mocap is not available and the paper's 1000 epochs are beyond a "
    "CPU. Half of the joints and half of the frames are masked, as in the paper.",
    "The second half of the clips is scored: masked joints within 0.2 m (recall), and their mean error. One training a "
    "row: intervals are about other moments, not about other trainings.",
)
_COLUMNS = (
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
    tallies: dict[str, list[list[Tally]]] = {}
    for name, codes in VARIANTS.items():
        changed = replace(plan, model=replace(plan.model, codes=codes))
        folder = train(changed, clips, out / "models" / f"table_5_{name.replace(' ', '_')}")
        tallies[name] = list(_tallies(load_model(folder)[0], plan, scored, interpolated=False))
    tallies[INTERPOLATED] = list(_tallies(load_model(folder)[0], plan, scored, interpolated=True))
    rows = []
    for name, found in tallies.items():
        recall, error = zip(*found, strict=True)
        rows.append(MeasuredRow(name, {"recall": pooled(recall), "mpjpe": pooled(error, scale=1.0)}))
    return paper_table(
        config, _COLUMNS, rows, against=BOTH, comparable=None, recording=f"{len(scored)} simulated clips", frames={},
        footnotes=[*_NOTES, NOISE_NOTE], rules="joints within 0.2 m",
    )  # fmt: skip


def training_plan(config: TableConfig) -> TrainConfig:
    """Return how each network is trained: as `model=paper`, smaller and faster."""
    steps = _STEPS[config.size]
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


def _tallies(model: DMAE, plan: TrainConfig, clips: NamedClips, *, interpolated: bool) -> Iterator[list[Tally]]:
    """Yield recall and error, mm, of the masked joints of each clip; the masks are the same for every model."""
    recipe = Recipe(plan.model, model.rest.numpy().astype(np.float64), plan.examples.masking, plan.examples.augment)
    for number, clip in enumerate(clips):
        pair = pose_pair(replace(clip, poses=None), BODY25, plan.model.fps)
        rows = masked_rows(pair, recipe, rng=generator(plan.seed, number, Stream.STRESS))
        yield _tally(model, recipe, rows, clip, pair, interpolated)


def _tally(model: DMAE, recipe: Recipe, rows: Rows, clip: Clip, pair: PosePair, interpolated: bool) -> Sequence[Tally]:
    length = len(rows.base) // pair.truth.xyz.shape[1]
    starts = rows.starts[rows.starts % length % recipe.model.frames == 0]
    examples = cut_examples(rows, starts, recipe.model)
    with torch.inference_mode():
        predicted = examples.windows.base if interpolated else model(*examples.windows).xyz
    error = torch.linalg.norm(predicted - examples.truth, dim=-1).numpy()
    hidden = examples.hidden.numpy()
    frames = starts[:, None] % length + np.arange(recipe.model.frames)
    _, member = block_members(frames.ravel(), recipe.model.fps)

    def summed(values: np.ndarray) -> np.ndarray:
        """(1, 1, B) sums of the masked joints of a block."""
        return (member @ np.where(hidden, values, 0.0).sum(-1).ravel())[None, None]

    count = summed(np.ones(error.shape))
    return [Tally(clip.id, (), summed(part), count, count) for part in (error <= PCK_THRESHOLD, 1000 * error)]
