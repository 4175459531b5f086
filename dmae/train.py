"""Learning to complete: D-MAE pretrained on poses, true or captured, of which a part is hidden."""

import hashlib
import json
import math
from collections.abc import Iterable
from dataclasses import asdict, dataclass, field
from datetime import timedelta
from enum import StrEnum
from pathlib import Path

import lightning
import numpy as np
import torch
from lightning.pytorch.callbacks import ModelCheckpoint, Timer
from lightning.pytorch.loggers import TensorBoardLogger
from torch import Tensor
from torch.utils.data import DataLoader

from dmae.calibrate import fit_factors
from dmae.callbacks import Average, Bar, quiet
from dmae.clip import Clip
from dmae.complete import Completer
from dmae.data import DataConfig
from dmae.examples import (
    AugmentConfig,
    Examples,
    Recipe,
    Recording,
    TrainingBatches,
    as_measured,
    record,
    validation_batches,
)
from dmae.hiding import HidingConfig
from dmae.metrics import GAPS
from dmae.model import DMAE, ModelConfig, Prediction
from dmae.progress import progress
from dmae.rng import Stream, generator
from dmae.skeleton import Skeleton, get_skeleton
from dmae.store import read_json, write_atomic
from dmae.weights import save_model
from dmae.windows import rest_pose

_SCALE_WEIGHT = 0.01
"""Of the loss by which the model learns how large its errors are, beside those errors in m."""


class Loss(StrEnum):
    """What is averaged over hidden joints."""

    mse = "mse"
    """Squared distance, as in the paper."""
    euclidean = "euclidean"
    """Distance."""


@dataclass(frozen=True)
class TrainConfig:
    """How a model is made."""

    data: DataConfig = field(default_factory=DataConfig)
    also: list[str] = field(default_factory=list)
    """Further data sets of clips to learn from."""
    unseen: list[str] = field(default_factory=list)
    """Data sets to validate and calibrate on, of motion that is in none of the others; without them clips are held
    back (`validation`), and stated uncertainty holds for motion like that of the training."""
    model: ModelConfig = field(default_factory=ModelConfig)
    hiding: HidingConfig = field(default_factory=HidingConfig)
    augment: AugmentConfig = field(default_factory=AugmentConfig)
    skeleton: str = "body25"
    loss: Loss = Loss.euclidean
    shown_weight: float = 0.0
    """Weight of the loss on joints that were shown, with `augment.noise`; without it the model cannot denoise."""
    steps: int = 6000
    max_minutes: float | None = None
    """Stop earlier after this time; the learning rate then falls with the time."""
    epoch: int = 200
    """Steps between two validations, after which training can be resumed."""
    batch: int = 16
    lr: float = 2e-3
    warmup: float = 0.05
    """Share of the training over which the learning rate rises; then it falls as a cosine."""
    weight_decay: float = 0.05
    clip: float = 1.0
    """Largest norm of a gradient."""
    average: float = 0.99
    """Decay of the moving average of the weights, which is what is kept."""
    validation: float = 0.1
    """Share of the clips that are held back; at least one if there are two."""
    workers: int = 0
    seed: int = 0
    out: str = "runs/model"

    def __post_init__(self):
        for name in ("steps", "epoch", "batch"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name}: expected at least 1, found {getattr(self, name)}")
        if not 0 <= self.validation < 1 or not 0 <= self.average < 1:
            raise ValueError(f"expected validation and average in [0, 1), found {self.validation} and {self.average}")


def train(config: TrainConfig, clips: Iterable[Clip], out: Path, unseen: Iterable[Clip] = ()) -> Path:
    """Train a model, or carry on where training stopped.

    Leaves `weights.safetensors` and `model.json` (see `dmae.weights`), TensorBoard's logs, and a checkpoint
    from which the same command resumes; with `steps` alone the result is the same to the bit, on the same
    machine, as if it had never stopped. Sets torch's global seed.

    Args:
        clips: Clips with truth, in any skeleton that `dmae.mapping.convert` can turn into the wanted one.
            Those with `poses` are learned from as captured: with their holes and errors, and more holes.
        out: Folder.
        unseen: Clips to validate and calibrate on; by default some of `clips` are held back.

    Returns:
        The folder.

    Raises:
        ValueError: a clip has no truth, there is nothing to learn from, or the folder holds a model that was
            made, or begun, under another configuration or from other clips, or two clips have one id.
    """
    out = Path(out)
    skeleton = get_skeleton(config.skeleton)
    recordings = _read(clips, skeleton, config.model.fps)
    if not recordings:
        raise ValueError(f"{config.data.path}: nothing to learn from, no clip has a person in it")
    held_back = {f"unseen {name}": found for name, found in _read(unseen, skeleton, config.model.fps).items()}
    _claim(out, config, recordings | held_back)
    if (out / "model.json").is_file():
        return out

    if not held_back:
        held_back = {name: recordings.pop(name) for name in _held_back(list(recordings), config)}
    training = list(recordings.values())
    rest = rest_pose(np.concatenate([found.truth.xyz.reshape(-1, len(skeleton), 3) for found in training]), skeleton)
    recipe = Recipe(config.model, rest, config.hiding, config.augment)
    validation = validation_batches(list(held_back.values()), recipe, seed=config.seed, batch=256)

    torch.manual_seed(config.seed)
    model = DMAE(config.model, len(skeleton))
    model.rest.copy_(torch.from_numpy(rest))
    limit = None if config.max_minutes is None else timedelta(minutes=config.max_minutes)
    timer = Timer(limit, interval="step", verbose=False)
    learner = Learner(model, config, training, recipe, validation, timer)
    checkpoint = ModelCheckpoint(out, "checkpoint", every_n_epochs=1, enable_version_counter=False)
    with quiet():
        trainer = lightning.Trainer(
            max_steps=config.steps,
            max_epochs=-1,
            gradient_clip_val=config.clip,
            callbacks=[timer, checkpoint, Average(config.average), Bar()],
            logger=TensorBoardLogger(out, name="", version="tensorboard"),
            default_root_dir=out,
            log_every_n_steps=min(10, config.epoch),
            num_sanity_val_steps=0,
            limit_val_batches=1.0 if validation else 0,
            reload_dataloaders_every_n_epochs=1,
            enable_progress_bar=False,
            enable_model_summary=False,
        )
        begun = out / "checkpoint.ckpt"
        trainer.fit(learner, ckpt_path=begun if begun.is_file() else None, weights_only=True)
        scores = trainer.validate(learner, verbose=False)[0] if validation else {}
    if trainer.is_global_zero:
        stated = Completer(learner.model.eval(), skeleton, learner.device, factors=(1.0,) * len(GAPS))
        measured = as_measured(list(held_back.values()), recipe, seed=config.seed)
        facts = {
            "calibration": fit_factors(stated, measured, config.model.fps),
            "denoises": config.shown_weight > 0,
            "clips": len(training),
            "validation_clips": list(held_back),
            "steps": trainer.global_step,
            **scores,
        }
        save_model(learner.model, skeleton, out, facts)
    return out


def _read(clips: Iterable[Clip], skeleton: Skeleton, fps: float) -> dict[str, Recording]:
    """What there is to learn from, by the names of the clips; those without people are left out."""
    found = {}
    for clip in progress(clips, "reading"):
        if clip.id in found:
            raise ValueError(f"two clips are called {clip.id!r}; a model's record names what it learned from")
        found[clip.id] = record(clip, skeleton, fps)
    return {name: recording for name, recording in found.items() if not np.isnan(recording.truth.xyz).all()}


def _held_back(names: list[str], config: TrainConfig) -> list[str]:
    """The clips to validate on: whole clips, so that no motion is on both sides."""
    if len(names) < 2 or config.validation == 0:
        return []
    count = min(max(1, round(config.validation * len(names))), len(names) - 1)
    return sorted(
        generator(config.seed, len(names), Stream.VALIDATION).choice(sorted(names), count, replace=False).tolist()
    )


def _claim(out: Path, config: TrainConfig, recordings: dict[str, Recording]) -> None:
    """Write down what this folder's model is made of, or compare with what is written there."""
    wanted = json.loads(json.dumps(asdict(config)))
    for name in ("out", "data", "also", "unseen", "workers"):
        del wanted[name]
    wanted["clips"] = {name: _digest(found) for name, found in recordings.items()}
    path = out / "training.json"
    if not path.is_file():
        write_atomic(path, json.dumps(wanted, indent=1))
        return
    found = read_json(path)
    differing = sorted(key for key in wanted | found if wanted.get(key) != found.get(key))
    if differing:
        raise ValueError(
            f"{out}: holds a model trained, or begun, otherwise: {path.name} differs in {', '.join(differing)}. "
            "Choose another folder, or remove this one"
        )


def _digest(recording: Recording) -> str:
    arrays = [poses.xyz for poses in (recording.truth, recording.captured) if poses]
    return hashlib.sha256(b"".join(array.tobytes() for array in arrays)).hexdigest()


class Learner(lightning.LightningModule):
    """The model and how it is taught."""

    def __init__(
        self,
        model: DMAE,
        config: TrainConfig,
        recordings: list[Recording],
        recipe: Recipe,
        validation: list[Examples],
        timer: Timer,
    ):
        super().__init__()
        self.model, self.train_config, self.timer = model, config, timer
        self.recordings, self.recipe, self.validation = recordings, recipe, validation

    def fraction(self) -> float:
        """How much of the training is done, by steps or by time, in [0, 1]."""
        config = self.train_config
        share = self.trainer.global_step / config.steps
        if config.max_minutes is not None:
            share = max(share, self.timer.time_elapsed() / (60 * config.max_minutes))
        return min(share, 1.0)

    def _rate(self, _: int) -> float:
        done = self.fraction()
        return min(1.0, (done + 1e-3) / max(self.train_config.warmup, 1e-3)) * 0.5 * (1 + math.cos(math.pi * done))

    def configure_optimizers(self):
        config = self.train_config
        optimizer = torch.optim.AdamW(
            self.model.parameters(), config.lr, betas=(0.9, 0.95), weight_decay=config.weight_decay
        )
        schedule = torch.optim.lr_scheduler.LambdaLR(optimizer, self._rate)
        return {"optimizer": optimizer, "lr_scheduler": {"scheduler": schedule, "interval": "step"}}

    def on_train_epoch_start(self):
        # Dropout in a resumed epoch is what it would have been.
        torch.manual_seed(generator(self.train_config.seed, self.current_epoch, Stream.HIDING).integers(2**63))

    def train_dataloader(self) -> DataLoader:
        config, epoch = self.train_config, self.trainer.current_epoch
        batches = TrainingBatches(
            self.recordings, self.recipe, seed=config.seed, epoch=epoch, steps=config.epoch, batch=config.batch
        )
        return DataLoader(batches, batch_size=None, num_workers=config.workers)

    def val_dataloader(self) -> DataLoader:
        return DataLoader(self.validation, batch_size=None)

    def training_step(self, batch: Examples, _: int) -> Tensor:
        predicted = self.model(*batch.windows)
        loss = self._loss(predicted, batch.truth, batch.hidden)
        if self.train_config.shown_weight:
            loss = loss + self.train_config.shown_weight * self._loss(predicted, batch.truth, batch.shown)
        self.log("train_loss", loss)
        return loss

    def _loss(self, predicted: Prediction, truth: Tensor, counted: Tensor) -> Tensor:
        squared = (predicted.xyz - truth).square().sum(-1)
        # The gradient of a root is infinite at zero: a hundredth of a millimetre is near enough.
        distance = (squared + 1e-10).sqrt()
        value = squared if self.train_config.loss == Loss.mse else distance
        # The negative log likelihood of the scale; its weight is small beside the norm that gradients are clipped to.
        surprise = distance.detach() * (-predicted.log_scale).exp() + 3 * predicted.log_scale
        value = value + _SCALE_WEIGHT * surprise
        return (value * counted).sum() / counted.sum().clamp(min=1)

    def validation_step(self, batch: Examples, _: int) -> None:
        for name, predicted in (("model", self.model(*batch.windows).xyz), ("interpolation", batch.windows.base)):
            distance = torch.linalg.norm(predicted - batch.truth, dim=-1)[batch.hidden]
            if len(distance):
                self.log(f"hidden_{name}_mm", 1000 * distance.mean(), batch_size=len(distance), sync_dist=True)
