"""Training: D-MAE learns to predict joints that are masked in true or captured poses.

In this order: calibration of predicted uncertainty, checkpoints, the time limit, what Lightning trains and how, and
the whole of a training.
"""

import hashlib
import io
import json
import logging
import math
import os
import re
import sys
import time
import warnings
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict
from functools import cached_property, partial
from pathlib import Path
from typing import Any, TypeVar

import lightning
import numpy as np
import torch
from lightning.pytorch.callbacks import ModelCheckpoint, Timer, WeightAveraging
from lightning.pytorch.loggers import TensorBoardLogger
from lightning.pytorch.plugins.io import TorchCheckpointIO
from lightning.pytorch.strategies import DDPStrategy
from torch import Tensor
from torch.utils.data import DataLoader, Dataset

from dmae.completion.complete import CLASSES, Completer, Factors, gap_classes
from dmae.completion.config import Loss, Precision, TrainConfig
from dmae.completion.fusion import namesakes
from dmae.completion.network import DMAE, Prediction
from dmae.completion.paper import PaperBatches, PaperRows, paper_rows, paper_validation
from dmae.completion.pose_prior import pose_covariance
from dmae.completion.training_data import (
    Examples,
    PosePair,
    Recipe,
    TrainingBatches,
    TrainingSet,
    calibration_poses,
    read_training_set,
    source_of,
    split,
    validation_batches,
)
from dmae.completion.weights import OF_PEOPLE, check_finite, find_shipped, load_model, save_model, weights_folder
from dmae.completion.windows import rest_pose
from dmae.data.clip import Clip, Poses3D
from dmae.data.json_values import flat
from dmae.data.resume import claim_folder
from dmae.data.rng import Stream, generator
from dmae.data.skeleton import BODY25, Skeleton, encode, get_skeleton
from dmae.data.store import write_atomic
from dmae.files.contents import read_bytes
from dmae.files.structured import read_json
from dmae.metrics.position import PCK_THRESHOLD, REGION_PROBABILITY, REGION_RADIUS
from dmae.progress import progress
from dmae.reporting.tables import counted, listed

_FEWEST = 200  # Joints of a class of gaps from which its own factor is fitted


def fit_factors(complete: Completer, held_back: Iterable[tuple[Poses3D, Poses3D]], fps: float) -> Factors | None:
    """Fit the factors with which regions of 90 % hold 90 % of the truth, by length of gap.

    Args:
        complete: With factors of 1: the standard deviation of completed joints is the predicted scale.
        held_back: Measured poses and their truth, at the model's rate; not used in training.

    Returns:
        As for `calibrated`; classes with few joints take the factor of all. None if there are few in all.
    """
    found = []
    for measured, truth in held_back:
        done = complete(measured, fps)
        deviation = np.sqrt(done.cov[..., 0, 0].astype(np.float64))
        ratio = np.linalg.norm(done.xyz.astype(np.float64) - truth.xyz, axis=-1) / deviation
        lengths, noisy = complete.uncertainty_inputs(measured, fps)
        columns = np.broadcast_arrays(ratio, gap_classes(lengths), noisy > 0.5)
        found.append(np.stack([column[np.isfinite(ratio)] for column in columns]))
    ratio, number, noisy = np.concatenate(found or [np.empty((3, 0))], 1)

    def factor(*groups: np.ndarray) -> float:
        enough = next(group for group in groups if group.sum() >= _FEWEST)
        return float(np.quantile(ratio[enough], REGION_PROBABILITY) / REGION_RADIUS)

    if len(ratio) < _FEWEST:
        return None
    everything = np.ones(len(ratio), bool)

    def of(kind: np.ndarray) -> tuple[float, ...]:
        return tuple(factor((number == i) & kind, number == i, kind, everything) for i in range(CLASSES))

    return of(noisy == 0), of(noisy == 1)


# Checkpoints of training: each with its checksum, and the one before it kept.

CHECKPOINT = "checkpoint.ckpt"
_BEFORE = "checkpoint_before.ckpt"
_MARK = b"dmae checkpoint "
_DIGEST = 64  # Hexadecimal digits of a SHA-256


class CheckedCheckpoints(TorchCheckpointIO):
    """Write checkpoints that hold their checksum: a line with it, then what torch writes.

    The previous checkpoint is kept as well, in case the newest is damaged.
    """

    def save_checkpoint(self, checkpoint: dict[str, Any], path: str | Path, storage_options: Any = None) -> None:
        path, buffer = Path(path), io.BytesIO()
        torch.save(checkpoint, buffer)
        data = buffer.getvalue()
        if path.is_file():
            path.replace(path.with_name(_BEFORE))
        write_atomic(path, _MARK + hashlib.sha256(data).hexdigest().encode() + b"\n" + data)

    def load_checkpoint(self, path: str | Path, map_location: Any = None, weights_only: bool | None = None) -> dict:
        """Raises ValueError where the file is not as it was written."""
        content = _content(Path(path))
        try:
            state = torch.load(io.BytesIO(content), map_location=map_location, weights_only=True)
        # Torch's reader raises errors of many undocumented types. Nothing in the file is run.
        except Exception as error:
            raise ValueError(f"{path}: expected a checkpoint of dmae train, {str(error).partition('.')[0]}") from error
        tensors = state.get("state_dict", {}) if isinstance(state, dict) else None
        if not isinstance(tensors, dict) or not all(isinstance(tensor, torch.Tensor) for tensor in tensors.values()):
            raise ValueError(f"{path}: expected a checkpoint of dmae train, found no weights in it")
        check_finite(tensors, f"{path} is of no use, remove it")
        return state


def newest_checkpoint(folder: Path) -> Path | None:
    """Return the newest checkpoint that is as it was written; None where training has not come to one yet.

    Raises ValueError if there are checkpoints, and all of them are damaged.
    """
    found = [folder / name for name in (CHECKPOINT, _BEFORE) if (folder / name).is_file()]
    errors = []
    for path in found:
        try:
            _content(path)
        except ValueError as error:
            errors.append(error)
            continue
        for damage in errors:
            print(f"{damage}; training continues from {path.name}, the one before it", file=sys.stderr)
        return path
    if errors:
        names = " and ".join(path.name for path in found)
        raise ValueError(f"{errors[0]}. Remove {names} from {folder} to train from the beginning")
    return None


def _content(path: Path) -> bytes:
    data = read_bytes(path)
    head, content = data[: len(_MARK) + _DIGEST + 1], data[len(_MARK) + _DIGEST + 1 :]
    if head != _MARK + hashlib.sha256(content).hexdigest().encode() + b"\n":
        raise ValueError(f"{path}: does not match its checksum; it is damaged, or of an earlier version of dmae")
    return content


# The time limit of a training, which includes everything that the user waits for.

T = TypeVar("T")

_MOST_CLOSING = 0.35  # Share of the whole time that may be reserved for what follows training
_MOST_PREPARING = 0.2  # Share of the time left that making the examples of an epoch may take


class TimeLimit:
    """The time by which a command has to end; without minutes, never.

    Args:
        minutes: How long it may take; None for no limit.
        since: When it began, by `time.monotonic`; None for now.
    """

    def __init__(self, minutes: float | None, since: float | None = None):
        self.seconds = float("inf") if minutes is None else 60 * minutes
        self.end = (time.monotonic() if since is None else since) + self.seconds
        self.closing = 0.0
        """s reserved for what follows training."""
        self.preparing = 0.0
        """s that the examples of the last epoch took to make."""

    @property
    def limited(self) -> bool:
        return self.seconds < float("inf")

    def left(self) -> float:
        """Return the s until the end."""
        return self.end - time.monotonic()

    def training(self, done: float = 0.0) -> float:
        """Return the s left for training; `done` of them were used by the run that this one resumes."""
        return min(self.left(), self.seconds - done) - self.closing

    def reserve(self, *parts: tuple[Callable[[], object], float]) -> None:
        """Reserve time for what follows training, by timing one call of each part; with the number of calls to come."""
        if not self.limited:
            return
        for part, times in parts:
            begun = time.monotonic()
            part()
            self.closing += times * (time.monotonic() - begun)
        self.closing = min(self.closing, _MOST_CLOSING * self.seconds)

    def until(self) -> float:
        """Return the time, by `time.monotonic`, by which the examples of an epoch have to be made."""
        return time.monotonic() + _MOST_PREPARING * max(self.training(), 0) if self.limited else float("inf")

    def while_left(self, items: Iterable[T]) -> Iterator[T]:
        """Yield items while there is time; the first always."""
        for number, item in enumerate(items):
            if number and self.left() <= 0:
                return
            yield item


# The learner: the network, its loss and its schedule, as Lightning trains it.

_WARMUP, _WEIGHT_DECAY = 0.05, 0.05  # Share of the training over which the rate rises; weight decay of AdamW
_SCALE_WEIGHT = 0.01  # Weight of the loss that trains the error scale, relative to errors in m
STEPS = "steps"
"""Metric in which a process that was started reports the number of steps."""
_SHOWN_STEPS = 100  # Number of steps whose mean loss is printed
_SMALLEST_ERROR = 0.003  # m; expected errors much below this have equal weight (`Loss.relative`)


def error_loss(loss: Loss, squared: Tensor, log_scale: Tensor) -> Tensor:
    """Return the loss (...) of squared errors, m^2, given how large they are expected to be.

    Args:
        log_scale: (...) see `dmae.completion.network.Prediction`; three times the scale is the mean error.
    """
    if loss == Loss.mse:
        # In dm^2: gradients in m^2 are not large against the epsilon of Adam.
        return 100 * squared
    # The gradient of a root is infinite at zero; a hundredth of a millimetre is close enough.
    distance = (squared + 1e-10).sqrt()
    return distance * 2 * _SMALLEST_ERROR / (3 * log_scale.exp() + _SMALLEST_ERROR)


class Learner(lightning.LightningModule):
    """The network, its loss and its schedule."""

    def __init__(
        self,
        model: DMAE,
        config: TrainConfig,
        pairs: list[PosePair],
        extra: list[PosePair],
        skeleton: Skeleton,
        recipe: Recipe,
        validation: list[Examples],
        timer: Timer,
        limit: TimeLimit,
    ):
        super().__init__()
        self.model, self.train_config, self.timer, self.limit = model, config, timer, limit
        self.pairs, self.extra, self.recipe, self.validation = pairs, extra, recipe, validation
        self.skeleton, self.said = skeleton, -1
        self.held_back: list[str] = []  # Names of the clips of the validation
        self.last_losses: deque[float] = deque(maxlen=_SHOWN_STEPS)

    def fraction(self) -> float:
        """Return how much of the training is done, by steps or by time, in [0, 1]."""
        share = self.trainer.global_step / self.train_config.learning.steps
        if self.limit.limited:
            elapsed = self.timer.time_elapsed()
            share = max(share, elapsed / max(elapsed + self.limit.training(elapsed), 1e-3))
        return min(share, 1.0)

    def _rate(self, _: int) -> float:
        done = self.fraction()
        if self.limit.limited:
            # Clocks of processes differ, and their weights must not.
            done = self.trainer.strategy.broadcast(done)
        return min(1.0, (done + 1e-3) / _WARMUP) * 0.5 * (1 + math.cos(math.pi * done))

    def configure_optimizers(self):
        config = self.train_config
        optimizer = torch.optim.AdamW(
            self.model.parameters(), config.peak_lr, betas=(0.9, 0.95), weight_decay=_WEIGHT_DECAY
        )
        schedule = torch.optim.lr_scheduler.LambdaLR(optimizer, self._rate)
        return {"optimizer": optimizer, "lr_scheduler": {"scheduler": schedule, "interval": "step"}}

    def on_train_start(self) -> None:
        """Begin the project's progress bar, by the share of the training that is done."""
        if self.trainer.global_step and self.trainer.is_global_zero:
            print(f"continuing at step {self.trainer.global_step}", file=sys.stderr, flush=True)
        if self.held_back and self.trainer.is_global_zero:
            clips = f"{counted(len(self.held_back), 'clip')}: {listed(self.held_back, 3)}"
            print(f"validation is on {clips}", file=sys.stderr, flush=True)
        self._ticks = progress(range(100), "training, %") if self.trainer.is_global_zero else iter(())
        self._shown = 0

    def on_train_epoch_start(self):
        # Dropout in a resumed epoch is what it would have been.
        torch.manual_seed(generator(self.train_config.seed, self.current_epoch, Stream.MASKING).integers(2**63))

    def on_train_batch_end(self, *_) -> None:
        while self._shown < int(100 * self.fraction()):
            next(self._ticks, None)
            self._shown += 1
        self._stop_in_time(0.0)

    def on_train_epoch_end(self) -> None:
        if not self.validation and self.trainer.is_global_zero:
            without = "no clip is held back for validation; validation_data=[...] gives some"
            self._print_loss("" if self.current_epoch else without)
        # The examples of the next epoch take as long to make.
        self._stop_in_time(self.limit.preparing)

    def _stop_in_time(self, needed: float) -> None:
        """Stop when less than the seconds that are needed are left for training."""
        if self.limit.limited:
            over = self.limit.training(self.timer.time_elapsed()) <= needed
            self.trainer.should_stop = self.trainer.strategy.broadcast(over) or self.trainer.should_stop

    def on_train_end(self) -> None:
        for _ in self._ticks:
            pass

    def on_fit_end(self) -> None:
        # The process that was started reads it here.
        self.trainer.callback_metrics[STEPS] = torch.tensor(self.trainer.global_step)

    def train_dataloader(self) -> DataLoader:
        config, begun, epoch = self.train_config, time.monotonic(), self.trainer.current_epoch
        replay, steps, batch = config.examples.replay or 0.0, config.learning.epoch, config.learning.batch
        share = slice(self.trainer.global_rank, None, self.trainer.world_size)
        if config.model.residual:
            batches: Dataset = TrainingBatches(
                [(1 - replay, self.pairs), (replay, self.extra)], self.recipe, seed=config.seed, epoch=epoch,
                steps=steps, batch=batch, share=share, taken=config.learning.steps - epoch * steps,
                until=self.limit.until(),
            )  # fmt: skip
        else:
            pools = list(zip((1 - replay, replay), self._paper_rows, strict=True))
            batches = PaperBatches(
                pools, self.skeleton, self.recipe, seed=config.seed, epoch=epoch, steps=steps, batch=batch, share=share
            )
        self.limit.preparing = time.monotonic() - begun
        return DataLoader(batches, batch_size=None, num_workers=config.examples.workers)

    @cached_property
    def _paper_rows(self) -> list[PaperRows]:
        return [paper_rows(pairs, self.recipe.model.frames) for pairs in (self.pairs, self.extra)]

    def val_dataloader(self) -> DataLoader:
        return DataLoader(self.validation, batch_size=None)  # type: ignore[arg-type]  # a list serves

    def training_step(self, batch: Examples, _: int) -> Tensor:
        predicted, weight = self._predict(batch), self.train_config.learning.observed_weight
        loss = self._loss(predicted, batch.truth, batch.hidden)
        self.last_losses.append(float(loss.detach()))
        if weight:
            loss = loss + weight * self._loss(predicted, batch.truth, batch.observed)
        if not torch.isfinite(loss):
            raise ValueError(
                f"step {self.trainer.global_step}: the loss is {float(loss.detach())}, so training stopped and wrote "
                f"no weights. Give a smaller learning.lr than {self.train_config.peak_lr:g}, in another folder, or "
                "look for the clip with coordinates that are far off"
            )
        self.log("train_loss", loss, sync_dist=True)
        return loss

    def on_save_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        checkpoint["last_losses"] = [*self.last_losses]

    def on_load_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        self.last_losses.extend(checkpoint["last_losses"])

    def _predict(self, batch: Examples) -> Prediction:
        # The default network is trained on observed joints, too.
        wanted = None if self.train_config.learning.observed_weight else batch.hidden
        return Prediction(*(part.float() for part in self.model(*batch.windows, wanted=wanted)))

    def _loss(self, predicted: Prediction, truth: Tensor, wanted: Tensor) -> Tensor:
        squared = (predicted.xyz - truth).square().sum(-1)
        value = error_loss(self.train_config.learning.loss, squared, predicted.log_scale.detach())
        distance = (squared.detach() + 1e-10).sqrt()
        # The negative log likelihood of the scale; its weight is small relative to the norm that clips gradients.
        likelihood = distance * (-predicted.log_scale).exp() + 3 * predicted.log_scale
        value = value + _SCALE_WEIGHT * likelihood
        # The mean over the joints of all processes: their gradients are averaged.
        total = self.trainer.strategy.reduce(wanted.sum().float(), reduce_op="sum").clamp(min=1)
        return (value * wanted).sum() * self.trainer.world_size / total

    def validation_step(self, batch: Examples, _: int) -> None:
        for name, predicted in (("model", self._predict(batch).xyz), ("interpolation", batch.windows.base)):
            distance = torch.linalg.norm(predicted - batch.truth, dim=-1)[batch.hidden]
            if len(distance):
                self.log(f"hidden_{name}_mm", 1000 * distance.mean(), batch_size=len(distance), sync_dist=True)
                near = 100 * (distance <= PCK_THRESHOLD).float().mean()
                self.log(f"hidden_{name}_recall", near, batch_size=len(distance), sync_dist=True)

    def on_validation_epoch_end(self) -> None:
        """Print how far the training is: the mean loss of the last hundred steps, and what validation found."""
        found = {name: float(value) for name, value in self.trainer.callback_metrics.items()}
        if not self.trainer.is_global_zero or self.said == self.trainer.global_step:
            return
        self.said = self.trainer.global_step
        validation = ""
        if "hidden_model_mm" in found:
            validation = (
                f"validation: unmeasured joints {found['hidden_model_mm']:.1f} mm, "
                f"{found['hidden_model_recall']:.2f} % within {100 * PCK_THRESHOLD:.0f} cm (interpolation "
                f"{found['hidden_interpolation_mm']:.1f} mm, {found['hidden_interpolation_recall']:.2f} %)"
            )
        self._print_loss(validation)

    def _print_loss(self, more: str) -> None:
        line = f"step {self.trainer.global_step}: loss {np.mean(self.last_losses):.4g}"
        print("; ".join(filter(None, (line, more))), file=sys.stderr, flush=True)


# How Lightning trains here: averaged weights, several processes, few messages.


class AverageWeights(WeightAveraging):
    """Exponential moving average of the weights, over few steps at first."""

    def __init__(self, decay: float):
        super().__init__(avg_fn=partial(_blend, decay), use_buffers=False)

    def on_fit_end(self, trainer, learner):
        # Lightning does this at the end of training, which a run resumed after the last step does not reach.
        self._copy_average_to_current(learner)


def _blend(decay: float, average: Tensor, current: Tensor, count: int | Tensor) -> Tensor:
    return average.lerp(current, 1 - min(decay, (1 + float(count)) / (10 + float(count))))


@contextmanager
def quiet_lightning():
    """Suppress Lightning's tips and summaries; its other warnings stay."""
    logger = logging.getLogger("lightning.pytorch")
    level = logger.level
    logger.setLevel(logging.WARNING)
    try:
        with warnings.catch_warnings():
            ignore_warnings()
            yield
    finally:
        logger.setLevel(level)


def ignore_warnings() -> None:
    """Suppress warnings of Lightning that are about its own code, or about what is intended."""
    warnings.filterwarnings("ignore", ".*does not have many workers.*")
    # Lightning calls a deprecated function of torch.
    warnings.filterwarnings("ignore", ".*LeafSpec.*", FutureWarning)
    warnings.filterwarnings("ignore", ".*Checkpoint directory .* exists and is not empty.*")


def strategy_of(devices: int) -> DDPStrategy | str:
    """Return Lightning's strategy for this number of processes."""
    if devices == 1:
        return "auto"
    # Torch warns where all parameters are used. They are not where codes are left out.
    os.environ.setdefault("TORCH_CPP_LOG_LEVEL", "ERROR")
    # Processes are spawned: torch's threads do not survive a fork.
    return _QuietProcesses(start_method="spawn", find_unused_parameters=True)


class _QuietProcesses(DDPStrategy):
    """Processes that are as quiet as the one that started them."""

    def setup_environment(self) -> None:
        for name in ("lightning.pytorch", "lightning.fabric"):
            logging.getLogger(name).setLevel(logging.WARNING)
        ignore_warnings()
        super().setup_environment()


@contextmanager
def errors_of_processes():
    """Raise a ValueError of one of the processes as such."""
    try:
        yield
    except torch.multiprocessing.ProcessRaisedException as error:
        found = re.findall(r"^ValueError: (.+)", str(error), re.MULTILINE)
        if not found:
            raise
        raise ValueError(found[-1]) from None


# The whole of a training.

_PRECISION: dict[Precision, Any] = {Precision.single: "32-true", Precision.bf16: "bf16-mixed"}
_QUIET: dict[str, Any] = {"enable_progress_bar": False, "enable_model_summary": False}
_ONES = ((1.0,) * CLASSES,) * 2  # Factors of uncertainty that change nothing


def train(
    config: TrainConfig,
    clips: Iterable[Clip],
    out: Path,
    validation_clips: Iterable[Clip] = (),
    extra_clips: Iterable[Clip] = (),
    *,
    since: float | None = None,
) -> Path:
    """Train a model, or resume where training stopped.

    Writes `weights.safetensors` and `model.json` (see `dmae.completion.weights`), TensorBoard's logs, and a checkpoint
    from which the same command resumes. Without `max_minutes` the result is the same to the bit, on the same machine,
    as if it had never stopped. Sets torch's global seed.

    Args:
        clips: Clips with truth, in any skeleton that `dmae.data.conversion.convert` can turn into the
            wanted one. From those with `poses` a model learns captured poses: with their gaps and errors, and more
            joints masked.
        validation_clips: Clips to validate and calibrate on; by default some of `clips` are held back.
        extra_clips: Further clips, those that `examples.replay` is a share of.
        since: When `config.max_minutes` began, by `time.monotonic`; by default now.

    Returns:
        The folder.

    Raises:
        FileNotFoundError: there is no model in the folder `config.init`.
        ValueError: a clip has no truth, there is nothing to learn from, the model of `config.init` is different, two
            clips have one id, or the folder holds a model of another configuration or of other clips, or checkpoints
            that are damaged; or the loss is not finite, or a clip's truth or poses are infinite.
    """
    out, limit = Path(out), TimeLimit(config.max_minutes, since)
    initial = _load_initial(config)
    skeleton = initial[1] if initial else get_skeleton(config.skeleton or BODY25.name)
    lacking = OF_PEOPLE - set(skeleton.parts[0].joints)
    if skeleton.defined and lacking:
        raise ValueError(
            f"skeleton={config.skeleton}: the network places bodies by hips and shoulders; {skeleton.name!r} lacks "
            f"{', '.join(sorted(lacking))}. Methods that need no training fill any skeleton: fill=gaussian_process"
        )
    weight = config.learning.observed_weight
    if weight and len(skeleton.parts) > 1:
        raise ValueError(f"learning.observed_weight={weight}: {skeleton.name!r} has no observed joint to learn")
    found = read_training_set(clips, extra_clips, validation_clips, skeleton, config)
    _claim(out, config, skeleton, initial and initial[2], found.all)
    if (out / "model.json").is_file():
        steps = read_json(out / "model.json")["steps"]
        print(
            f"{out}: this training is finished, at step {steps}; init={out} trains on from it, into another folder",
            file=sys.stderr,
        )
        return out

    found = split(found, config.examples, seed=config.seed)
    torch.manual_seed(config.seed)
    if initial:
        model, _, record = initial
        model.train()
        rest = model.rest.numpy().astype(np.float64)
    else:
        record = {"calibration": None}
        model, rest = _new_model(config, skeleton, found)
    recipe = Recipe(config.model, rest, config.examples.masking, config.examples.augment)
    held_back = list(found.validation.values())
    if config.model.residual:
        validation = validation_batches(held_back, recipe, seed=config.seed, batch=256)
    else:
        validation = paper_validation(held_back, skeleton, recipe, rest, seed=config.seed, batch=256)
    _reserve_time(limit, model, skeleton, validation, held_back, recipe)
    timer = Timer(None, interval="step", verbose=False)
    pairs, extra = list(found.pairs.values()), list(found.extra.values())
    learner = Learner(model, config, pairs, extra, skeleton, recipe, validation, timer, limit)
    learner.held_back = [*found.validation]
    steps, scores = _fit(learner, config, out)
    if learner.trainer.is_global_zero:
        factors = None
        if config.model.residual:
            stated = Completer(learner.model.eval(), skeleton, factors=_ONES)
            measured = limit.while_left(calibration_poses(held_back, recipe, seed=config.seed))
            factors = fit_factors(stated, measured, config.model.fps)
        facts = {
            "calibration": factors or record["calibration"],
            "denoises": weight > 0,
            "fuses": any(pair.captured for pair in (*pairs, *extra)) and len(skeleton.parts) > 1,
            "init": initial and {"path": config.init, "sha256": record["sha256"]},
            "clips": len(pairs) + len(extra),
            "frames": config.data.frames,
            "validation_clips": list(found.validation),
            "steps": steps,
            **scores,
        }
        save_model(learner.model, skeleton, out, facts)
    return out


def _new_model(config: TrainConfig, skeleton: Skeleton, found: TrainingSet) -> tuple[DMAE, np.ndarray]:
    """Return an untrained model, which knows how bodies of the training set vary, and their rest pose (J, 3), m."""
    model = DMAE(config.model, len(skeleton), None if config.model.residual else namesakes(skeleton))
    pairs = (*found.pairs.values(), *found.extra.values())
    bodies = np.concatenate([pair.truth.xyz.reshape(-1, len(skeleton), 3) for pair in pairs])
    source, *target = skeleton.parts
    if np.isnan(bodies[:, : len(source)]).all():
        raise ValueError(
            f"{source_of(config)}truth on {target[0].name!r} alone does not teach what {source.name!r} looks "
            "like; start from a model (init=...), or add simulated clips (extra_data=[...])"
        )
    rest = rest_pose(bodies, skeleton)
    model.rest.copy_(torch.from_numpy(rest))
    if config.model.residual:
        model.pose_covariance.copy_(torch.from_numpy(pose_covariance(bodies, skeleton, rest)))
    return model, rest


def _fit(learner: Learner, config: TrainConfig, out: Path) -> tuple[int, Mapping[str, float]]:
    """Train the learner, from the checkpoint in the folder if there is one; return its steps and validation scores."""
    learning, checkpoint = config.learning, newest_checkpoint(out)
    with quiet_lightning():
        trainer = lightning.Trainer(
            devices=learning.devices,
            strategy=strategy_of(learning.devices),
            precision=_PRECISION[learning.precision],
            use_distributed_sampler=False,
            max_steps=learning.steps,
            max_epochs=-1,
            gradient_clip_val=learning.max_gradient,
            callbacks=[
                learner.timer,
                ModelCheckpoint(out, Path(CHECKPOINT).stem, every_n_epochs=1, enable_version_counter=False),
                AverageWeights(learning.average),
            ],
            plugins=[CheckedCheckpoints()],
            logger=TensorBoardLogger(out, name="", version="tensorboard"),
            default_root_dir=out,
            log_every_n_steps=min(10, learning.epoch),
            num_sanity_val_steps=0,
            limit_val_batches=1.0 if learner.validation else 0,
            reload_dataloaders_every_n_epochs=1,
            **_QUIET,
        )
        with errors_of_processes():
            trainer.fit(learner, ckpt_path=checkpoint, weights_only=True)
        steps = int(trainer.callback_metrics[STEPS])
        if learning.devices > 1 or learning.precision != Precision.single:
            # The weights are used by one process, in single precision.
            trainer = lightning.Trainer(devices=1, logger=False, **_QUIET)
            learner.said = 0  # The last step was printed
        scores = trainer.validate(learner, verbose=False)[0] if learner.validation else {}
    return steps, scores


def _reserve_time(
    limit: TimeLimit,
    model: DMAE,
    skeleton: Skeleton,
    validation: list[Examples],
    held_back: list[PosePair],
    recipe: Recipe,
) -> None:
    """Reserve time for validation, which is done twice after training, and for calibration, by trying both."""
    if not limit.limited or not validation:
        return
    model.eval()
    parts: list[tuple[Callable[[], object], float]] = [(lambda: model(*validation[0].windows), 2 * len(validation))]
    if model.config.residual:
        stated = Completer(model, skeleton, factors=_ONES)
        measured = [poses for poses, _ in calibration_poses(held_back[:1], recipe, seed=0)]
        parts.append((lambda: stated(measured[-1], recipe.model.fps), len(measured) * len(held_back)))
    with torch.inference_mode():
        limit.reserve(*parts)
    model.train()


def _load_initial(config: TrainConfig) -> tuple[DMAE, Skeleton, dict] | None:
    if config.init is None:
        return None
    if config.init == "shipped":
        if not config.model.residual:
            raise ValueError("init=shipped: these weights are not of the paper's network; give init=paper")
        folder = find_shipped(get_skeleton(config.skeleton or BODY25.name))
    else:
        folder = weights_folder(config.init)
    model, skeleton, record = load_model(folder)
    if config.skeleton is not None and get_skeleton(config.skeleton) != skeleton:
        raise ValueError(f"{config.init}: a model of skeleton {skeleton.name!r}, and skeleton={config.skeleton}")
    wanted, found = (flat(asdict(options), "model.") for options in (config.model, model.config))
    differing = ", ".join(f"{name}={value}" for name, value in found.items() if value != wanted[name])
    if differing:
        raise ValueError(f"{config.init}: a network of other sizes; to start from it, give {differing}")
    return model, skeleton, record


def _claim(out: Path, config: TrainConfig, skeleton: Skeleton, init: dict | None, pairs: dict[str, PosePair]) -> None:
    """Write what this folder's model is made of to `training.json`, or compare with what is written there."""
    wanted = json.loads(json.dumps(asdict(config)))
    for name in ("out", "data", "extra_data", "validation_data", "capture"):
        del wanted[name]
    for name in ("workers", "views", "damaged"):
        del wanted["examples"][name]
    wanted["learning"]["lr"] = config.peak_lr
    del wanted["learning"]["devices"]
    if config.learning.precision == Precision.single:
        # As models made before there was a choice.
        del wanted["learning"]["precision"]
    wanted |= {"skeleton": encode(skeleton), "init": init and init["sha256"]}
    wanted["clips"] = {name: _digest(pair) for name, pair in pairs.items()}
    finished = (out / "model.json").is_file()
    remedy = f"init={out} trains on from the finished model in it, into another folder" if finished else ""
    claim_folder(out / "training.json", wanted, "a model", remedy=remedy)


def _digest(pair: PosePair) -> str:
    arrays = [array for poses in (pair.truth, pair.captured) if poses for array in (poses.xyz, poses.rays)]
    return hashlib.sha256(b"".join(array.tobytes() for array in arrays)).hexdigest()
