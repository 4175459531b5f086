"""How Lightning trains here: averaged weights, the progress bar, the time limit, several processes, few messages."""

import logging
import os
import re
import warnings
from contextlib import contextmanager
from functools import partial

import torch
from lightning.pytorch.callbacks import Callback, WeightAveraging
from lightning.pytorch.strategies import DDPStrategy
from torch import Tensor

from dmae.completion.training.time_limit import TimeLimit
from dmae.progress import progress

STEPS = "steps"
"""Metric in which the process that was started reports the number of steps."""


class AverageWeights(WeightAveraging):
    """Exponential moving average of the weights, over few steps at first."""

    def __init__(self, decay: float):
        super().__init__(avg_fn=partial(_blend, decay), use_buffers=False)


def _blend(decay: float, average: Tensor, current: Tensor, count: int | Tensor) -> Tensor:
    return average.lerp(current, 1 - min(decay, (1 + float(count)) / (10 + float(count))))


class ShowProgress(Callback):
    """The project's progress bar, by the share of the training that is done."""

    def on_train_start(self, trainer, learner):
        self.ticks = progress(range(1000), "training") if trainer.is_global_zero else iter(())
        self.shown = 0

    def on_train_batch_end(self, trainer, learner, *_):
        while self.shown < int(1000 * learner.fraction()):
            next(self.ticks, None)
            self.shown += 1

    def on_train_end(self, trainer, learner):
        self.on_train_batch_end(trainer, learner)
        for _ in self.ticks:
            pass


class StopInTime(Callback):
    """Stops when the time for training is over, or before an epoch with examples that would take longer to make."""

    def __init__(self, limit: TimeLimit):
        self.limit = limit

    def on_train_batch_end(self, trainer, learner, *_):
        self._stop(trainer, learner, 0.0)

    def on_train_epoch_end(self, trainer, learner):
        self._stop(trainer, learner, self.limit.preparing)

    def _stop(self, trainer, learner, needed: float) -> None:
        if self.limit.limited:
            over = self.limit.training(learner.timer.time_elapsed()) <= needed
            trainer.should_stop = trainer.strategy.broadcast(over) or trainer.should_stop


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
    return DDPStrategy(start_method="spawn", find_unused_parameters=True)


class ReportSteps(Callback):
    """Report the number of steps to the process that started this one, and be as quiet as that."""

    def setup(self, trainer, learner, stage):
        if trainer.world_size > 1:
            ignore_warnings()

    def on_fit_end(self, trainer, learner):
        trainer.callback_metrics[STEPS] = torch.tensor(trainer.global_step)


@contextmanager
def errors_of_processes():
    """Raise a ValueError of one of the processes as such.

    Raises:
        ValueError: as the process raised it.
    """
    try:
        yield
    except torch.multiprocessing.ProcessRaisedException as error:
        found = re.findall(r"^ValueError: (.+)", str(error), re.MULTILINE)
        if not found:
            raise
        raise ValueError(found[-1]) from None
