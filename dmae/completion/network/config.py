"""What a network looks like. Loads no torch."""

from dataclasses import dataclass, field

FEATURES = {
    "gap": ("gap", slice(None)),
    "ray": ("ray", slice(None)),
    "held": ("candidate_offset", slice(4)),
    "bone_length": ("candidate_offset", slice(4, 6)),
    "jitter": ("noise_level", slice(3)),
    "bone_stretch": ("noise_level", slice(3, 6)),
}
"""Input features of the default network: the field of `dmae.completion.windows.Windows` that holds each, and its place
along the first axis after that of joints."""


@dataclass(frozen=True)
class EncoderConfig:
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
class DecoderConfig:
    """The decoder of all tokens. Heads and hidden layers are as wide as the encoder's times `dim` / `encoder.dim`."""

    dim: int = 96
    """Channels of a token, even."""
    depth: int = 1
    """Transformer layers."""


@dataclass(frozen=True)
class CodesConfig:
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
    """Ablation: leave out the code of time."""
    no_joint: bool = False
    """Ablation: leave out the code of the joint."""


@dataclass(frozen=True)
class ModelConfig:
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
        if unknown := set(self.ablate) - FEATURES.keys():
            raise ValueError(f"model.ablate: expected some of {list(FEATURES)}, found {sorted(unknown)}")
        sizes = {
            "frames": (self.frames, 1000),
            "encoder.depth": (self.encoder.depth, 64),
            "encoder.heads": (self.encoder.heads, 256),
            "encoder.head_dim": (self.encoder.head_dim, 4096),
            "encoder.mlp": (self.encoder.mlp, 65536),
            "decoder.depth": (self.decoder.depth, 64),
            "codes.signal": (self.codes.signal, 65536),
            "encoder.dim": (self.encoder.dim, 16384),
            "decoder.dim": (self.decoder.dim, 16384),
        }
        for name, (size, most) in sizes.items():
            if not isinstance(size, int) or not 1 <= size <= most:
                raise ValueError(f"model.{name}: expected a whole number from 1 to {most}, found {size!r:.40}")
        for name, dim in (("encoder.dim", self.encoder.dim), ("decoder.dim", self.decoder.dim)):
            if dim % 2:
                raise ValueError(f"model.{name}: expected an even number (sines and cosines), found {dim}")
        codes = {f"codes.{name}": getattr(self.codes, name) for name in ("signal_sigma", "time_sigma", "joint_sigma")}
        ranges = dict.fromkeys(codes, (0, 1e6)) | {"key_init": (-1e3, 1e3), "dropout": (0, 0.999), "fps": (0.01, 1e5)}
        for name, (least, most) in ranges.items():
            value = codes.get(name, getattr(self, name, None))
            if isinstance(value, bool) or not isinstance(value, int | float) or not least <= value <= most:
                raise ValueError(f"model.{name}: expected a number from {least:g} to {most:g}, found {value!r:.40}")
        choices = {"codes.no_time": self.codes.no_time, "codes.no_joint": self.codes.no_joint}
        for name, value in (choices | {"residual": self.residual, "align_heading": self.align_heading}).items():
            if not isinstance(value, bool):
                raise ValueError(f"model.{name}: expected true or false, found {value!r:.40}")


def model_config(options: dict) -> ModelConfig:
    """Return the configuration of nested options, as `dataclasses.asdict` and YAML give them.

    Raises:
        TypeError: there is no such option.
        ValueError: an option has an impossible value.
    """
    parts = {"encoder": EncoderConfig, "decoder": DecoderConfig, "codes": CodesConfig}
    return ModelConfig(**options | {name: kind(**options.get(name, {})) for name, kind in parts.items()})
