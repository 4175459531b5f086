"""How a model is trained. Loads no torch."""

from dataclasses import dataclass, field
from enum import StrEnum

from dmae.completion.network.config import ModelConfig
from dmae.completion.training.augmentation import AugmentConfig
from dmae.completion.training.masking import MaskingConfig
from dmae.formats.reading import DataConfig
from dmae.reconstruction.config import CaptureConfig


class Loss(StrEnum):
    """What is averaged over masked joints."""

    mse = "mse"
    """Squared distance, as in the paper."""
    euclidean = "euclidean"
    """Distance."""
    relative = "relative"
    """Distance relative to the error that the model expects; else the model learns mostly from joints that are hidden
    for long, where it can be off by decimetres."""


class Precision(StrEnum):
    """Numbers that the network computes with."""

    single = "single"
    """32 bits."""
    bf16 = "bf16"
    """16 bits in products of matrices, where a processor or GPU is faster with them; weights have 32."""


@dataclass(frozen=True)
class ExamplesConfig:
    """What examples are made of."""

    masking: MaskingConfig = field(default_factory=MaskingConfig)
    augment: AugmentConfig = field(default_factory=AugmentConfig)
    views: list[int] = field(default_factory=list)
    """Clips without poses are captured with all subsets of that many cameras, one example each; by default only their
    truth is used, or if the skeleton lacks that, what all cameras capture."""
    replay: float | None = None
    """Share of the windows that are taken from `extra_data`, so that a model keeps what it learned before; by default
    all clips are pooled. With it only clips of `extra_data` are held back."""
    held_back: float = 0.1
    """Share of the clips that are held back for validation, at least one if there are two; unused with
    `validation_data`."""
    damaged: bool = False
    """Train even on data sets with files that are missing or were changed."""
    workers: int = 0
    """Processes that make batches for the one that trains; 0: the training process makes them."""

    def __post_init__(self):
        if not 0 <= self.held_back < 1:
            raise ValueError(f"examples.held_back: expected a share in [0, 1), found {self.held_back}")
        if self.replay is not None and not 0 < self.replay < 1:
            raise ValueError(f"examples.replay={self.replay}: expected a share between 0 and 1")


@dataclass(frozen=True)
class LearningConfig:
    """How the network learns from examples."""

    steps: int = 6000
    """Batches to learn from."""
    epoch: int = 200
    """Steps between two validations, after which training can be resumed."""
    batch: int = 16
    """Windows in a batch."""
    loss: Loss = Loss.relative
    observed_weight: float = 0.0
    """Weight of the loss on observed joints, which have errors in captured poses and with `examples.augment.noise`;
    with 0 the model cannot denoise."""
    lr: float | None = None
    """Greatest learning rate; by default 2e-3, and 2e-4 from `init` on."""
    warmup: float = 0.05
    """Share of the training over which the learning rate rises; then it falls as a cosine."""
    weight_decay: float = 0.05
    """Weight decay of AdamW."""
    max_gradient: float = 1.0
    """Norm to which gradients are clipped."""
    average: float = 0.99
    """Decay of the moving average of the weights, which is what is kept."""
    devices: int = 1
    """GPUs that share each batch, or processes where there is no GPU; the result is the same up to rounding."""
    precision: Precision = Precision.single
    """Numbers that the network computes with."""

    def __post_init__(self):
        for name in ("steps", "epoch", "batch", "devices"):
            if getattr(self, name) < 1:
                raise ValueError(f"learning.{name}: expected at least 1, found {getattr(self, name)}")
        if self.devices > self.batch:
            raise ValueError(f"learning.devices={self.devices}: expected at most learning.batch, {self.batch}")
        if not 0 <= self.average < 1:
            raise ValueError(f"learning.average: expected a decay in [0, 1), found {self.average}")


@dataclass(frozen=True)
class TrainConfig:
    """Train a model that completes poses."""

    data: DataConfig = field(default_factory=DataConfig)
    extra_data: list[str] = field(default_factory=list)
    """Folders of further data sets of clips to learn from."""
    validation_data: list[str] = field(default_factory=list)
    """Folders of data sets to validate and calibrate on, with motion that is in none of the others; by default clips
    are held back (`examples.held_back`), and uncertainty is calibrated for motion like that of the training."""
    init: str | None = None
    """Folder of a trained model to start from; `shipped`: the weights that come with the package."""
    skeleton: str | None = None
    """Skeleton of the model; by default that of `init`, or else body25. Two joined by + turn poses of one into those of
    the other, see `dmae.completion.fusion`."""
    capture: CaptureConfig = field(default_factory=CaptureConfig)
    """How clips without poses are captured, see `examples.views`."""
    model: ModelConfig = field(default_factory=ModelConfig)
    examples: ExamplesConfig = field(default_factory=ExamplesConfig)
    learning: LearningConfig = field(default_factory=LearningConfig)
    max_minutes: float | None = None
    """minutes; what the whole command may take, from its start to the model, loading, validation and calibration
    included: training stops in time for them, and the learning rate falls with the time."""
    seed: int = 0
    """Seed of weights, masks and batches."""
    out: str = "runs/model"
    """Folder of the model, its record, its checkpoint and TensorBoard's logs."""

    def __post_init__(self):
        if self.examples.replay is not None and not self.extra_data:
            raise ValueError(
                f"examples.replay={self.examples.replay}: expected extra_data=[...] to take that share of windows from"
            )

    @property
    def peak_lr(self) -> float:
        """The greatest learning rate."""
        return self.learning.lr if self.learning.lr is not None else 2e-4 if self.init else 2e-3
