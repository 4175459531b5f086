"""What can be set of a network and of its training. Imports no torch."""

from dataclasses import dataclass, field
from enum import StrEnum

from dmae.data.typed import Configuration
from dmae.formats.config import DataConfig
from dmae.reconstruction.config import CaptureConfig

FEATURES = {
    "gap": ("gap", slice(None)),
    "ray": ("ray", slice(None)),
    "held": ("candidate_offset", slice(4)),
    "bone_length": ("candidate_offset", slice(4, 6)),
    "jitter": ("noise_level", slice(3)),
    "bone_stretch": ("noise_level", slice(3, 6)),
}
"""Input features of the default network: the field of `dmae.completion.windows.Windows` that holds each, and its place
on the axis that follows the joints."""


@dataclass(frozen=True)
class EncoderConfig(Configuration):
    """The encoder of observed tokens."""

    dim: int = 96
    """Channels of a token, even."""
    depth: int = 1
    """Transformer layers."""
    heads: int = 4
    """Attention heads of a layer, in the decoder as well."""
    head_dim: int = 24
    """Channels of a head."""
    mlp: int = 192
    """Channels of a layer's hidden fully connected layer."""


@dataclass(frozen=True)
class DecoderConfig(Configuration):
    """The decoder of all tokens. Heads and hidden layers are as wide as the encoder's times `dim` / `encoder.dim`."""

    dim: int = 96
    """Channels of a token, even."""
    depth: int = 1
    """Transformer layers."""


@dataclass(frozen=True)
class CodesConfig(Configuration):
    """The Fourier codes of coordinates (signal) and of joint and time (context)."""

    signal: int = 64
    """Rows of the Gaussian matrix of the signal code."""
    signal_sigma: float = 1.0
    """1/m; standard deviation of that matrix."""
    time_sigma: float = 3.0
    """Standard deviation of the matrix of the time code; time runs over [0, 1] in a window."""
    joint_sigma: float = 30.0
    """Standard deviation of the matrix of the joint code; the joint's index runs over [0, 1]."""
    no_time: bool = False
    """Ablation: leave out the code of time, in the encoder, as the released code does."""
    no_joint: bool = False
    """Ablation: leave out the code of the joint, in the encoder, as the released code does."""


@dataclass(frozen=True)
class ModelConfig(Configuration):
    """What the network looks like. `configs/model/paper.yaml` is the paper's."""

    frames: int = 15
    """Frames of a window (T)."""
    fps: float = 25.0
    """Frames per second of a window; poses at other rates are resampled."""
    encoder: EncoderConfig = field(default_factory=EncoderConfig)
    decoder: DecoderConfig = field(default_factory=DecoderConfig)
    codes: CodesConfig = field(default_factory=CodesConfig)
    dropout: float = 0.0
    """Share of activations dropped in training."""
    key_init: float = 1.7
    """Attention's keys start as this multiple of its queries, so that a token first attends to tokens with codes like
    its own: the same joint at near times. 0: they start at random."""
    residual: bool = True
    """Predict corrections of interpolated joints, from interpolated joints and input features (not in the paper); else
    predict coordinates, as the paper does."""
    align_heading: bool = True
    """Rotate each window so that the person of its middle frame faces +x; else it keeps its heading in the world."""
    ablate: list[str] = field(default_factory=list, metadata={"choices": tuple(FEATURES)})
    """Ablation: input features set to zero, of `gap`, `ray`, `held`, `bone_length`, `jitter` and `bone_stretch`."""

    def __post_init__(self):
        super().__post_init__()
        if unknown := set(self.ablate) - FEATURES.keys():
            raise ValueError(f"model.ablate: expected some of {list(FEATURES)}, found {sorted(unknown)}")
        encoder, decoder, codes = self.encoder, self.decoder, self.codes
        limits = {
            "frames": (self.frames, 1, 1000),
            "encoder.dim": (encoder.dim, 1, 16384),
            "encoder.depth": (encoder.depth, 1, 64),
            "encoder.heads": (encoder.heads, 1, 256),
            "encoder.head_dim": (encoder.head_dim, 1, 4096),
            "encoder.mlp": (encoder.mlp, 1, 65536),
            "decoder.dim": (decoder.dim, 1, 16384),
            "decoder.depth": (decoder.depth, 1, 64),
            "codes.signal": (codes.signal, 1, 65536),
            "codes.signal_sigma": (codes.signal_sigma, 0, 1e6),
            "codes.time_sigma": (codes.time_sigma, 0, 1e6),
            "codes.joint_sigma": (codes.joint_sigma, 0, 1e6),
            "key_init": (self.key_init, -1e3, 1e3),
            "dropout": (self.dropout, 0, 0.999),
            "fps": (self.fps, 0.01, 1e5),
        }
        for name, (value, least, most) in limits.items():
            if not least <= value <= most:
                raise ValueError(f"model.{name}: expected a number from {least:g} to {most:g}, found {value!r:.40}")
        for name, dim in (("encoder.dim", encoder.dim), ("decoder.dim", decoder.dim)):
            if dim % 2:
                raise ValueError(f"model.{name}: expected an even number (sines and cosines), found {dim}")


# How a model is trained.


class Loss(StrEnum):
    """What is averaged over masked joints."""

    mse = "mse"
    """Squared distance, as in the paper, in dm^2."""
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
class MaskingConfig(Configuration):
    """Which of the known joints are hidden from the encoder in training."""

    scattered: float = 0.05
    """Share of the recordings masked at random by joint and by frame, as in the paper; the others are masked in
    bursts."""
    joints: float = 0.5
    """Share of the joints masked in scattered masking."""
    frames: float = 0.5
    """Share of the frames masked whole in scattered masking."""
    released: float = 0.0
    """Share of the batches of the paper's network that are masked as in its released code, which masks joints of those
    frames alone."""
    bursts: float = 2.0
    """Bursts per second and person."""
    longest: int = 60
    """Frames at 25/s of the longest burst; lengths are log-uniform from 2."""
    absence: int = 15
    """Frames at 25/s of the longest burst in which the whole person is masked."""

    def __post_init__(self):
        super().__post_init__()
        for name in ("scattered", "joints", "frames", "released"):
            if not 0 <= getattr(self, name) <= 1:
                raise ValueError(f"masking.{name}: expected a share between 0 and 1, found {getattr(self, name)}")
        if self.bursts < 0 or self.longest < 2 or self.absence < 2:
            raise ValueError(f"masking: expected bursts >= 0, longest >= 2 and absence >= 2, found {self}")


@dataclass(frozen=True)
class AugmentConfig(Configuration):
    """How recordings are varied each time they are drawn. Each person is rotated about the vertical by any angle."""

    mirror: float = 0.5
    """Share of the persons with left and right swapped."""
    reverse: float = 0.5
    """Share of the recordings that run backwards."""
    scale: float = 0.1
    """Standard deviation of the logarithm of a person's size."""
    speed: float = 0.2
    """The logarithm of a recording's speed is uniform within this much either way."""
    true_poses: float = 0.3
    """Share of the draws of a captured recording that give its truth instead; else the network gives too little weight
    to joints next to a gap."""
    noise: float = 0.0
    """m; observed joints of true poses have errors with a standard deviation that is, by person, uniform up to this."""


@dataclass(frozen=True)
class ExamplesConfig(Configuration):
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
        super().__post_init__()
        if not 0 <= self.held_back < 1:
            raise ValueError(f"examples.held_back: expected a share in [0, 1), found {self.held_back}")
        if self.replay is not None and not 0 < self.replay < 1:
            raise ValueError(f"examples.replay={self.replay}: expected a share between 0 and 1")


@dataclass(frozen=True)
class LearningConfig(Configuration):
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
    """Greatest learning rate, reached after a twentieth of the training; then it falls as a cosine. By default 2e-3,
    and 2e-4 from `init` on."""
    max_gradient: float = 1.0
    """Norm to which gradients are clipped."""
    average: float = 0.99
    """Decay of the moving average of the weights, which is what is kept."""
    devices: int = 1
    """GPUs that share each batch, or processes where there is no GPU; the result is the same up to rounding."""
    precision: Precision = Precision.single
    """Numbers that the network computes with."""

    def __post_init__(self):
        super().__post_init__()
        for name in ("steps", "epoch", "batch", "devices"):
            if getattr(self, name) < 1:
                raise ValueError(f"learning.{name}: expected at least 1, found {getattr(self, name)}")
        if self.devices > self.batch:
            raise ValueError(f"learning.devices={self.devices}: expected at most learning.batch, {self.batch}")
        if not 0 <= self.average < 1:
            raise ValueError(f"learning.average: expected a decay in [0, 1), found {self.average}")


@dataclass(frozen=True)
class TrainConfig(Configuration):
    """Train a model that completes poses."""

    data: DataConfig = field(default_factory=DataConfig)
    extra_data: list[str] = field(default_factory=list, metadata={"reads": "path"})
    """Folders of further data sets of clips to learn from."""
    validation_data: list[str] = field(default_factory=list, metadata={"reads": "path"})
    """Folders of data sets to validate and calibrate on, with motion that is in none of the others; by default clips
    are held back (`examples.held_back`), and uncertainty is calibrated for motion as in training."""
    init: str | None = field(default=None, metadata={"reads": "model", "words": ("shipped", "paper")})
    """Folder of a trained model to start from; `shipped`: the weights that come with the package; `paper`: the paper's
    network."""
    skeleton: str | None = field(default=None, metadata={"reads": "skeleton"})
    """Skeleton of the model; by default the skeleton of `init`, or else body25. With two joined by +, poses on the
    first become poses on the second, see `dmae.completion.fusion`."""
    capture: CaptureConfig = field(default_factory=CaptureConfig)
    """How clips without poses are captured, see `examples.views`."""
    model: ModelConfig = field(default_factory=ModelConfig)
    examples: ExamplesConfig = field(default_factory=ExamplesConfig)
    learning: LearningConfig = field(default_factory=LearningConfig)
    max_minutes: float | None = None
    """minutes; longest time of the whole command, loading, validation and calibration included: training stops in time
    for them, and the learning rate falls with the time."""
    seed: int = 0
    """Seed of weights, masks and batches."""
    out: str = "runs/model"
    """Folder of the model, its record, its checkpoint and TensorBoard's logs."""

    def __post_init__(self):
        super().__post_init__()
        if self.examples.replay is not None and not self.extra_data:
            raise ValueError(
                f"examples.replay={self.examples.replay}: expected extra_data=[...] to take that share of windows from"
            )

    @property
    def peak_lr(self) -> float:
        """The greatest learning rate."""
        return self.learning.lr if self.learning.lr is not None else 2e-4 if self.init else 2e-3


DELAY = 0.28
"""s; half a window of the default model."""
SMOOTHING = 0.1
"""s; light smoothing that suits people."""


def check_delay(delay: float, online: bool) -> None:
    """Raise ValueError if a delay is given for completion that is not online."""
    if delay != DELAY and not online:
        raise ValueError(f"delay={delay:g}: whole clips have no delay; add online=true, or leave delay out")
