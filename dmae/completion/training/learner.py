"""The learner: the network, its loss and its schedule, as Lightning trains it."""

import math
import time
from pathlib import Path

import lightning
import torch
from lightning.pytorch.callbacks import Timer
from safetensors.torch import save_file
from torch import Tensor
from torch.utils.data import DataLoader

from dmae.completion.network.layers import Prediction
from dmae.completion.network.paper import DMAE
from dmae.completion.training.batches import TrainingBatches
from dmae.completion.training.config import Loss, TrainConfig
from dmae.completion.training.examples import Examples, Recipe
from dmae.completion.training.pose_pairs import PosePair
from dmae.completion.training.time_limit import TimeLimit
from dmae.data.rng import Stream, generator

_SCALE_WEIGHT = 0.01
"""Weight of the loss that trains the error scale, relative to errors in m."""

_SMALLEST_ERROR = 0.003
"""m; expected errors much below this have equal weight (`Loss.relative`)."""


def error_loss(loss: Loss, squared: Tensor, log_scale: Tensor) -> Tensor:
    """Return the loss (...) of squared errors, m^2, given how large they are expected to be.

    Args:
        log_scale: (...) see `dmae.completion.network.layers.Prediction`; three times the scale is the mean error.
    """
    if loss == Loss.mse:
        return squared
    # The gradient of a root is infinite at zero; a hundredth of a millimetre is close enough.
    distance = (squared + 1e-10).sqrt()
    if loss == Loss.euclidean:
        return distance
    return distance * 2 * _SMALLEST_ERROR / (3 * log_scale.exp() + _SMALLEST_ERROR)


class Learner(lightning.LightningModule):
    """The network, its loss and its schedule."""

    def __init__(
        self,
        model: DMAE,
        config: TrainConfig,
        pairs: list[PosePair],
        extra: list[PosePair],
        recipe: Recipe,
        validation: list[Examples],
        timer: Timer,
        limit: TimeLimit,
    ):
        super().__init__()
        self.model, self.train_config, self.timer, self.limit = model, config, timer, limit
        self.pairs, self.extra, self.recipe, self.validation = pairs, extra, recipe, validation

    def fraction(self) -> float:
        """Return how much of the training is done, by steps or by time, in [0, 1]."""
        share = self.trainer.global_step / self.train_config.learning.steps
        if self.limit.limited:
            elapsed = self.timer.time_elapsed()
            share = max(share, elapsed / max(elapsed + self.limit.training(elapsed), 1e-3))
        return min(share, 1.0)

    def _rate(self, _: int) -> float:
        done, warmup = self.fraction(), max(self.train_config.learning.warmup, 1e-3)
        if self.limit.limited:
            # Clocks of processes differ, and their weights must not.
            done = self.trainer.strategy.broadcast(done)
        return min(1.0, (done + 1e-3) / warmup) * 0.5 * (1 + math.cos(math.pi * done))

    def configure_optimizers(self):
        config = self.train_config
        optimizer = torch.optim.AdamW(
            self.model.parameters(), config.peak_lr, betas=(0.9, 0.95), weight_decay=config.learning.weight_decay
        )
        schedule = torch.optim.lr_scheduler.LambdaLR(optimizer, self._rate)
        return {"optimizer": optimizer, "lr_scheduler": {"scheduler": schedule, "interval": "step"}}

    def on_train_epoch_start(self):
        # Dropout in a resumed epoch is what it would have been.
        torch.manual_seed(generator(self.train_config.seed, self.current_epoch, Stream.MASKING).integers(2**63))

    def train_dataloader(self) -> DataLoader:
        config, begun = self.train_config, time.monotonic()
        batches = TrainingBatches(
            self.pairs,
            self.recipe,
            seed=config.seed,
            epoch=self.trainer.current_epoch,
            steps=config.learning.epoch,
            batch=config.learning.batch,
            extra=self.extra,
            replay=config.examples.replay or 0.0,
            until=self.limit.until(),
            rank=self.trainer.global_rank,
            ranks=self.trainer.world_size,
        )
        self.limit.preparing = time.monotonic() - begun
        return DataLoader(batches, batch_size=None, num_workers=config.examples.workers)

    def val_dataloader(self) -> DataLoader:
        return DataLoader(self.validation, batch_size=None)

    def training_step(self, batch: Examples, _: int) -> Tensor:
        predicted, weight = self._predict(batch), self.train_config.learning.observed_weight
        loss = self._loss(predicted, batch.truth, batch.hidden)
        if weight:
            loss = loss + weight * self._loss(predicted, batch.truth, batch.observed)
        if not torch.isfinite(loss):
            raise ValueError(self._not_finite(batch, float(loss.detach())))
        self.log("train_loss", loss, sync_dist=True)
        return loss

    def _predict(self, batch: Examples) -> Prediction:
        """Return what the network predicts, in single precision whatever it computes with."""
        return Prediction(*(part.float() for part in self.model(*batch.windows)))

    def _not_finite(self, batch: Examples, loss: float) -> str:
        """Save the batch of a loss that is not finite; return what happened and what to do."""
        path = Path(self.trainer.default_root_dir, "not_finite.safetensors")
        tensors = {"truth": batch.truth, "hidden": batch.hidden, "observed": batch.observed}
        tensors |= {f"windows.{name}": tensor for name, tensor in batch.windows._asdict().items()}
        save_file({name: tensor.contiguous() for name, tensor in tensors.items()}, path)
        return (
            f"step {self.trainer.global_step}: the loss is {loss}, so training stopped and wrote no weights; the batch "
            f"is in {path}. Give a smaller learning.lr than {self.train_config.peak_lr:g}, in another folder, or look "
            "for the clip with coordinates that are far off"
        )

    def _loss(self, predicted: Prediction, truth: Tensor, counted: Tensor) -> Tensor:
        squared = (predicted.xyz - truth).square().sum(-1)
        value = error_loss(self.train_config.learning.loss, squared, predicted.log_scale.detach())
        distance = (squared.detach() + 1e-10).sqrt()
        # The negative log likelihood of the scale; its weight is small relative to the norm that clips gradients.
        likelihood = distance * (-predicted.log_scale).exp() + 3 * predicted.log_scale
        value = value + _SCALE_WEIGHT * likelihood
        # The mean over the joints of all processes: their gradients are averaged.
        total = self.trainer.strategy.reduce(counted.sum().float(), reduce_op="sum").clamp(min=1)
        return (value * counted).sum() * self.trainer.world_size / total

    def validation_step(self, batch: Examples, _: int) -> None:
        for name, predicted in (("model", self._predict(batch).xyz), ("interpolation", batch.windows.base)):
            distance = torch.linalg.norm(predicted - batch.truth, dim=-1)[batch.hidden]
            if len(distance):
                self.log(f"hidden_{name}_mm", 1000 * distance.mean(), batch_size=len(distance), sync_dist=True)
