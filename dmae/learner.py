"""What is learned and how it is taught: the configuration of a training, and the steps of it."""

import math
from dataclasses import dataclass, field
from enum import StrEnum

import lightning
import torch
from lightning.pytorch.callbacks import Timer
from torch import Tensor
from torch.utils.data import DataLoader

from dmae.capture import CaptureConfig
from dmae.data import DataConfig
from dmae.examples import AugmentConfig, Examples, Recipe, Recording, TrainingBatches
from dmae.hiding import HidingConfig
from dmae.model import DMAE, ModelConfig, Prediction
from dmae.rng import Stream, generator

_SCALE_WEIGHT = 0.01
"""Of the loss by which the model learns how large its errors are, beside those errors in m."""

_FINE = 0.003
"""m; expected errors much below this all count alike (`Loss.relative`)."""


class Loss(StrEnum):
    """What is averaged over hidden joints."""

    mse = "mse"
    """Squared distance, as in the paper."""
    euclidean = "euclidean"
    """Distance."""
    relative = "relative"
    """Distance, counting the less the larger the model expects it to be: or else it learns from joints hidden for long
    alone, where it can be off by decimetres."""


@dataclass(frozen=True)
class TrainConfig:
    """How a model is made."""

    data: DataConfig = field(default_factory=DataConfig)
    also: list[str] = field(default_factory=list)
    """Further data sets of clips to learn from."""
    unseen: list[str] = field(default_factory=list)
    """Data sets to validate and calibrate on, of motion that is in none of the others; without them clips are held
    back (`validation`), and stated uncertainty holds for motion like that of the training."""
    replay: float | None = None
    """Share of the windows that are of `also`, so that what a model knew is not forgotten; by default all clips are
    learned from alike. With it clips are held back of those alone."""
    init: str | None = None
    """Begin with the weights of this folder, which `dmae train` wrote."""
    views: list[int] = field(default_factory=list)
    """Of clips without poses: capture with all subsets of so many cameras, and learn from each; by default their truth
    is learned from alone, or if a skeleton lacks that, what all cameras capture."""
    capture: CaptureConfig = field(default_factory=CaptureConfig)
    """How those are captured."""
    model: ModelConfig = field(default_factory=ModelConfig)
    hiding: HidingConfig = field(default_factory=HidingConfig)
    augment: AugmentConfig = field(default_factory=AugmentConfig)
    skeleton: str | None = None
    """By default that of `init`, or else body25; two side by side to turn poses of one into those of the other, see
    `dmae.fusion`."""
    loss: Loss = Loss.relative
    shown_weight: float = 0.0
    """Weight of the loss on joints that were shown, with `augment.noise`; without it the model cannot denoise."""
    steps: int = 6000
    max_minutes: float | None = None
    """Stop earlier after this time; the learning rate then falls with the time."""
    epoch: int = 200
    """Steps between two validations, after which training can be resumed."""
    batch: int = 16
    lr: float | None = None
    """By default 2e-3, and from `init` on a tenth of it."""
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
        if self.replay is not None and not (0 < self.replay < 1 and self.also):
            raise ValueError(f"replay={self.replay}: expected a share between 0 and 1, and also=[...] to draw it from")

    @property
    def peak(self) -> float:
        """The greatest learning rate."""
        return self.lr if self.lr is not None else 2e-4 if self.init else 2e-3


def penalty(loss: Loss, squared: Tensor, log_scale: Tensor) -> Tensor:
    """What errors cost, (...), of which the squares are given, m^2, and how large they are expected to be.

    Args:
        log_scale: (...) see `dmae.model.Prediction`; three times the scale is the mean error.
    """
    if loss == Loss.mse:
        return squared
    # The gradient of a root is infinite at zero: a hundredth of a millimetre is near enough.
    distance = (squared + 1e-10).sqrt()
    return distance if loss == Loss.euclidean else distance * 2 * _FINE / (3 * log_scale.exp() + _FINE)


class Learner(lightning.LightningModule):
    """The model and how it is taught."""

    def __init__(
        self,
        model: DMAE,
        config: TrainConfig,
        recordings: list[Recording],
        replayed: list[Recording],
        recipe: Recipe,
        validation: list[Examples],
        timer: Timer,
    ):
        super().__init__()
        self.model, self.train_config, self.timer = model, config, timer
        self.recordings, self.replayed, self.recipe, self.validation = recordings, replayed, recipe, validation

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
            self.model.parameters(), config.peak, betas=(0.9, 0.95), weight_decay=config.weight_decay
        )
        schedule = torch.optim.lr_scheduler.LambdaLR(optimizer, self._rate)
        return {"optimizer": optimizer, "lr_scheduler": {"scheduler": schedule, "interval": "step"}}

    def on_train_epoch_start(self):
        # Dropout in a resumed epoch is what it would have been.
        torch.manual_seed(generator(self.train_config.seed, self.current_epoch, Stream.HIDING).integers(2**63))

    def train_dataloader(self) -> DataLoader:
        config, epoch = self.train_config, self.trainer.current_epoch
        batches = TrainingBatches(
            self.recordings,
            self.recipe,
            seed=config.seed,
            epoch=epoch,
            steps=config.epoch,
            batch=config.batch,
            replayed=self.replayed,
            replay=config.replay or 0.0,
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
        value = penalty(self.train_config.loss, squared, predicted.log_scale.detach())
        distance = (squared.detach() + 1e-10).sqrt()
        # The negative log likelihood of the scale; its weight is small beside the norm that gradients are clipped to.
        surprise = distance * (-predicted.log_scale).exp() + 3 * predicted.log_scale
        value = value + _SCALE_WEIGHT * surprise
        return (value * counted).sum() / counted.sum().clamp(min=1)

    def validation_step(self, batch: Examples, _: int) -> None:
        for name, predicted in (("model", self.model(*batch.windows).xyz), ("interpolation", batch.windows.base)):
            distance = torch.linalg.norm(predicted - batch.truth, dim=-1)[batch.hidden]
            if len(distance):
                self.log(f"hidden_{name}_mm", 1000 * distance.mean(), batch_size=len(distance), sync_dist=True)
