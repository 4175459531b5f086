"""Training in several processes, each with a share of every batch: the sums are those of one process."""

import os
import re
from contextlib import contextmanager

import torch
from lightning.pytorch.callbacks import Callback
from lightning.pytorch.strategies import DDPStrategy

from dmae.completion.training.callbacks import ignore_warnings

STEPS = "steps"
"""Metric in which the process that was started reports the number of steps."""


def strategy_of(devices: int) -> DDPStrategy | str:
    """Return how Lightning runs so many processes."""
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

    def on_train_end(self, trainer, learner):
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
