"""What goes along with training: averaged weights, the project's progress bar, and quiet."""

import logging
import warnings
from contextlib import contextmanager

from lightning.pytorch.callbacks import Callback, WeightAveraging
from torch import Tensor

from dmae.progress import progress


class Average(WeightAveraging):
    """Exponential moving average of the weights, over few steps at first."""

    def __init__(self, decay: float):
        def blend(average: Tensor, current: Tensor, count: int | Tensor) -> Tensor:
            return average.lerp(current, 1 - min(decay, (1 + float(count)) / (10 + float(count))))

        super().__init__(avg_fn=blend, use_buffers=False)


class Bar(Callback):
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


@contextmanager
def quiet():
    """Lightning without its advertisements, tips and inventories; its warnings of real trouble stay."""
    logger = logging.getLogger("lightning.pytorch")
    level = logger.level
    logger.setLevel(logging.WARNING)
    try:
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", ".*does not have many workers.*")
            warnings.filterwarnings("ignore", ".*LeafSpec.*", FutureWarning)  # its own affair with torch
            warnings.filterwarnings("ignore", ".*Checkpoint directory .* exists and is not empty.*")
            yield
    finally:
        logger.setLevel(level)
