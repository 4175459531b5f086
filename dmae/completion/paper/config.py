"""The sizes and the schedule of the paper's network. Loads no torch."""

from dataclasses import dataclass, field, replace
from enum import StrEnum

from dmae.files.checks import check_rate

_MOST = {"frames": 1000, "dim": 16384, "depth": 64, "heads": 256, "head_dim": 4096, "mlp": 65536}
"""Largest sizes of a network."""
_MOST_SIGMA = 1e6


@dataclass(frozen=True)
class PaperNetwork:
    """The network."""

    frames: int = 15
    """Frames of a window (T)."""
    fps: float = 25.0
    """Frames per second of a window."""
    dim: int = 256
    """Channels of a token in the encoder; the decoder has half."""
    depth: int = 6
    """Layers of the encoder; the decoder has half."""
    heads: int = 8
    """Attention heads."""
    head_dim: int = 64
    """Channels of a head in the encoder; the decoder has half."""
    mlp: int = 512
    """Channels of a layer's hidden layer in the encoder; the decoder has half."""
    signal_sigma: float = 1.0
    """1/m; standard deviation of the matrix of the signal code."""
    time_sigma: float = 3.0
    """Standard deviation of the matrix of the time code; time runs over [0, 1] in a window."""
    joint_sigma: float = 30.0
    """Standard deviation of the matrix of the joint code; the joints of both skeletons run over [0, 1]."""
    dropout: float = 0.1
    """Share of activations dropped in training."""

    def __post_init__(self):
        for name, most in _MOST.items():
            size, least = getattr(self, name), 2 if name == "depth" else 1
            if isinstance(size, bool) or not isinstance(size, int) or not least <= size <= most:
                raise ValueError(f"network.{name}: expected a whole number from {least} to {most}, found {size!r:.40}")
        if self.dim % 4 or self.head_dim % 2 or self.mlp % 2:
            raise ValueError(
                f"network: expected dim in fours, head_dim and mlp even, as the decoder has half of them; found "
                f"dim={self.dim}, head_dim={self.head_dim}, mlp={self.mlp}"
            )
        if not 0 <= self.dropout < 1:
            raise ValueError(f"network.dropout: expected a share below 1, found {self.dropout}")
        check_rate("network.fps", self.fps)
        for name in ("signal_sigma", "time_sigma", "joint_sigma"):
            if not 0 <= getattr(self, name) <= _MOST_SIGMA:
                raise ValueError(f"network.{name}: expected 0 to {_MOST_SIGMA:g}, found {getattr(self, name)!r:.40}")


@dataclass(frozen=True)
class PaperSchedule:
    """How the network learns."""

    steps: int = 0
    """Batches of pretraining; 0: as many as `epochs` say."""
    epochs: int = 1000
    """Passes over the windows in pretraining."""
    tuning_epochs: int = 500
    """Passes over the windows in fine-tuning."""
    batch: int = 32
    """Windows in a batch."""
    lr: float = 1.5e-4
    """Greatest learning rate."""
    least_lr: float = 1e-5
    """Learning rate at the end of the cosine."""
    warmup: float = 0.04
    """Share of the steps over which the learning rate rises."""
    weight_decay: float = 0.05
    """Weight decay of AdamW."""
    mask_joints: float = 0.5
    """Share of the joints masked, drawn again in every frame."""
    mask_frames: float = 0.5
    """Share of the frames masked whole."""

    def __post_init__(self):
        for name in ("epochs", "tuning_epochs", "batch"):
            if getattr(self, name) < 1:
                raise ValueError(f"schedule.{name}: expected at least 1, found {getattr(self, name)}")
        for name in ("mask_joints", "mask_frames", "warmup"):
            if not 0 <= getattr(self, name) < 1:
                raise ValueError(f"schedule.{name}: expected a share below 1, found {getattr(self, name)}")


class PaperSize(StrEnum):
    """How large the network is."""

    full = "full"
    """As in the paper: 1000 epochs, for a GPU."""
    small = "small"
    """Layers and channels that a CPU trains in minutes."""


@dataclass(frozen=True)
class PaperConfig:
    """Network and schedule."""

    network: PaperNetwork = field(default_factory=PaperNetwork)
    schedule: PaperSchedule = field(default_factory=PaperSchedule)
    seed: int = 0
    """Seed of weights, masks and batches."""


FULL = PaperConfig()
"""The paper's sizes and epochs."""
SMALL = PaperConfig(
    PaperNetwork(dim=64, depth=2, heads=4, head_dim=16, mlp=128, dropout=0.0),
    replace(FULL.schedule, steps=3000, tuning_epochs=30, lr=2e-3),
)
"""What a CPU trains in minutes: a quarter of the channels, a third of the layers."""
SIZES = {PaperSize.full: FULL, PaperSize.small: SMALL}
