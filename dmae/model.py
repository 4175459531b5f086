"""D-MAE: a masked auto-encoder over single joints at single times (Jiang, Chen & Guo, ACM MM 2022).

Shapes: B windows, T frames, J joints, N = T * J tokens, C channels.
"""

import math
from dataclasses import dataclass, field
from typing import NamedTuple

import torch
import torch.nn.functional as F
from torch import Tensor, nn

_SPREAD = 0.3
"""m, about how far joints are from the rest pose."""

_REACH = (*4 * (0.3,), *2 * (0.06,))
"""m, about how far `leads` are."""

_HINTS = 2 + 3 + 18 + 6
"""Numbers of `gap`, `ray`, `leads` and `rough`."""

_TOLD = 2 + 6 + 6 + 1
"""Those of `gap` and `rough`, how far each of `leads` is, and whether there is a ray."""

_TELLS = {
    "gap": ("gap", slice(None)),
    "ray": ("ray", slice(None)),
    "carried": ("leads", slice(4)),
    "mended": ("leads", slice(4, 6)),
    "roughness": ("rough", slice(3)),
    "stretch": ("rough", slice(3, 6)),
}
"""Which tensor tells it, and where along the first axis after that of joints."""

_OWN = [0, 1, 3, 4]
"""Which of `rough` an observed joint is told: beside it there is no other."""

_NEAR = 0.01
"""m; nearer than that is all the same."""

_MOST = 5.0
"""By at most this power of e what is added is more or less than the network's width makes it."""

_SCALE = 0.03
"""m, the scale of errors that training starts from."""


@dataclass(frozen=True)
class ModelConfig:
    """What the network looks like. `configs/model/paper.yaml` is the paper's."""

    frames: int = 15
    """T, frames in a window."""
    fps: float = 25.0
    """Frames per second of a window; poses at other rates are resampled."""
    dim: int = 96
    depth: int = 1
    heads: int = 4
    head_dim: int = 24
    mlp: int = 192
    decoder_dim: int = 96
    decoder_depth: int = 1
    dropout: float = 0.0
    signal_codes: int = 64
    """Rows of the Gaussian matrix of the signal code."""
    signal_sigma: float = 1.0
    """Its standard deviation, 1/m."""
    time_sigma: float = 3.0
    """Standard deviation of the context code of time, which runs over [0, 1] in a window."""
    joint_sigma: float = 30.0
    """Standard deviation of the context code of the joint's index, which runs over [0, 1]."""
    no_time_code: bool = False
    """Ablation."""
    no_joint_code: bool = False
    """Ablation."""
    blind: list[str] = field(default_factory=list)
    """Ablation: what the network is not told, of `gap`, `ray`, `carried`, `mended`, `roughness` and `stretch`."""
    alike: float = 1.7
    """Attention's keys start as this times its queries, so that a token first looks at those with codes like its own,
    the same joint at near times; 0: they start at random."""
    residual: bool = True
    """Not in the paper: predict what to add to interpolated joints, which hidden tokens then carry, instead of
    coordinates; and give the network joints relative to the rest pose, coordinates beside their code."""
    turn_to_front: bool = True
    """Turn each window so that its middle frame faces +x; else it keeps its heading in the world."""

    def __post_init__(self):
        if strange := set(self.blind) - _TELLS.keys():
            raise ValueError(f"model.blind: expected some of {list(_TELLS)}, found {sorted(strange)}")
        for name in ("frames", "depth", "heads", "head_dim", "mlp", "decoder_depth", "signal_codes"):
            if getattr(self, name) < 1:
                raise ValueError(f"model.{name}: expected at least 1, found {getattr(self, name)}")
        for name in ("dim", "decoder_dim"):
            if getattr(self, name) < 2 or getattr(self, name) % 2:
                raise ValueError(
                    f"model.{name}: expected an even number (sines and cosines), found {getattr(self, name)}"
                )


class FourierCode(nn.Module):
    """[cos 2πBx, sin 2πBx] of x (..., D), with a fixed Gaussian matrix B (C/2, D) that is saved with the weights."""

    def __init__(self, inputs: int, channels: int, sigma: float):
        super().__init__()
        self.register_buffer("B", torch.randn(channels // 2, inputs) * sigma)

    def forward(self, x: Tensor) -> Tensor:
        phase = 2 * math.pi * x @ self.B.T
        return torch.cat([phase.cos(), phase.sin()], -1)


class ContextCode(nn.Module):
    """γ(j) + γ(t): which joint and when, (N, C), both indices scaled to [0, 1]."""

    def __init__(self, config: ModelConfig, joints: int, channels: int):
        super().__init__()
        self.joint = None if config.no_joint_code else FourierCode(1, channels, config.joint_sigma)
        self.time = None if config.no_time_code else FourierCode(1, channels, config.time_sigma)
        self.register_buffer(
            "t", torch.linspace(0, 1, config.frames).repeat_interleave(joints)[:, None], persistent=False
        )
        self.register_buffer("j", torch.linspace(0, 1, joints).repeat(config.frames)[:, None], persistent=False)

    def forward(self) -> Tensor | float:
        code = 0.0
        if self.joint is not None:
            code = code + self.joint(self.j)
        if self.time is not None:
            code = code + self.time(self.t)
        return code


class Attention(nn.Module):
    """Multi-head self-attention."""

    def __init__(self, dim: int, heads: int, head_dim: int, alike: float):
        super().__init__()
        self.heads = heads
        self.qkv = nn.Linear(dim, 3 * heads * head_dim, bias=False)
        if alike:
            with torch.no_grad():
                queries, keys, _ = self.qkv.weight.chunk(3)
                keys.copy_(alike * queries)
        self.out = nn.Linear(heads * head_dim, dim)

    def forward(self, x: Tensor, real: Tensor | None) -> Tensor:
        """x (B, n, C); `real` (B, n) True for the tokens that may be attended to, None for all."""
        batch, count, _ = x.shape
        q, k, v = self.qkv(x).view(batch, count, 3, self.heads, -1).permute(2, 0, 3, 1, 4)  # (B, heads, n, head_dim)
        keys = None if real is None else real[:, None, None, :]
        y = F.scaled_dot_product_attention(q, k, v, attn_mask=keys)
        return self.out(y.transpose(1, 2).reshape(batch, count, -1))


class Block(nn.Module):
    """Pre-norm transformer layer."""

    def __init__(self, dim: int, heads: int, head_dim: int, mlp: int, dropout: float, alike: float):
        super().__init__()
        self.attention_norm = nn.LayerNorm(dim)
        self.attention = Attention(dim, heads, head_dim, alike)
        self.mlp_norm = nn.LayerNorm(dim)
        self.mlp = nn.Sequential(nn.Linear(dim, mlp), nn.GELU(), nn.Dropout(dropout), nn.Linear(mlp, dim))
        self.dropout = nn.Dropout(dropout)

    def forward(self, x: Tensor, real: Tensor | None = None) -> Tensor:
        x = x + self.dropout(self.attention(self.attention_norm(x), real))
        return x + self.dropout(self.mlp(self.mlp_norm(x)))


class Prediction(NamedTuple):
    """Where joints are, and how sure that is."""

    xyz: Tensor
    """(B, T, J, 3) m."""
    log_scale: Tensor
    """(B, T, J) the logarithm of s in m, the error e having the density exp(-|e| / s) / (8 π s^3)."""


class DMAE(nn.Module):
    """Completes windows of joints.

    The encoder is given the observed tokens only, gathered to the largest number in the batch and padded:
    attention is quadratic in the tokens, and leaving hidden ones in as excluded keys costs 1.4 times the
    whole step at a quarter hidden, 1.9 times at 60 %. The decoder, narrower and shallower, is given
    encoded tokens where joints are observed, the shared mask token elsewhere, and the context codes again.
    """

    def __init__(self, config: ModelConfig, joints: int):
        super().__init__()
        c = self.config = config
        self.register_buffer("rest", torch.zeros(joints, 3))
        """m; mean pose of the training data, see `dmae.windows.rest_pose`."""
        self.signal = FourierCode(3, 2 * c.signal_codes, c.signal_sigma)
        signal = 2 * c.signal_codes + (3 if c.residual else 0)
        self.embed = nn.Linear(signal + (len(_OWN) if c.residual else 0), c.dim)
        self.encoder_context = ContextCode(c, joints, c.dim)
        self.encoder = nn.ModuleList(
            Block(c.dim, c.heads, c.head_dim, c.mlp, c.dropout, c.alike) for _ in range(c.depth)
        )
        self.encoder_norm = nn.LayerNorm(c.dim)

        self.narrow = nn.Linear(c.dim, c.decoder_dim)
        self.mask_token = nn.Parameter(torch.randn(c.decoder_dim) * 0.02)
        self.decoder_context = ContextCode(c, joints, c.decoder_dim)
        share = c.decoder_dim / c.dim
        head_dim, mlp = max(1, round(c.head_dim * share)), max(1, round(c.mlp * share))
        self.decoder = nn.ModuleList(
            Block(c.decoder_dim, c.heads, head_dim, mlp, c.dropout, c.alike) for _ in range(c.decoder_depth)
        )
        self.decoder_norm = nn.LayerNorm(c.decoder_dim)
        self.head = nn.Linear(c.decoder_dim, 4 if c.residual else 3)
        told = _TOLD if c.residual else 0
        self.scale_head = nn.Sequential(nn.Linear(c.decoder_dim + told, 64), nn.GELU(), nn.Linear(64, 1))
        nn.init.zeros_(self.scale_head[-1].weight)
        nn.init.constant_(self.scale_head[-1].bias, math.log(_SCALE))
        if c.residual:
            self.register_buffer("reach", torch.tensor(_REACH), persistent=False)
            self.embed_base = nn.Linear(signal + _HINTS, c.decoder_dim)
            # How much there is to add depends on how long and how far a joint is hidden, and on how rough paths are.
            self.amount = nn.Sequential(nn.Linear(_TOLD, 32), nn.GELU(), nn.Linear(32, 1))
            # Training starts from the interpolation.
            for last in (self.head, self.amount[-1]):
                nn.init.zeros_(last.weight)
                nn.init.zeros_(last.bias)

    def forward(
        self, x: Tensor, observed: Tensor, base: Tensor, gap: Tensor, ray: Tensor, leads: Tensor, rough: Tensor
    ) -> Prediction:
        """Predict every joint of every frame; the fields of `dmae.windows.Windows`.

        Args:
            x: (B, T, J, 3) m; what stands where `observed` is False is not read.
            observed: (B, T, J) True where the encoder may look.
            base: (B, T, J, 3) m, interpolated joints; read only by a residual model, as is what follows.
            gap: (B, T, J, 2) frames since and until the joint was observed.
            ray: (B, T, J, 3) direction along which `base` is all that one camera tells; zero where none does.
            leads: (B, T, J, 6, 3) m, from `base` to where else the joint may be, see `dmae.windows.Windows`.
            rough: (B, T, J, 6) see `dmae.hints.roughness` and `dmae.hints.stretch`.
        """
        told = {"gap": gap, "ray": ray, "leads": leads, "rough": rough}
        for name in self.config.blind:
            tensor, part = _TELLS[name]
            told[tensor] = told[tensor].clone()
            told[tensor][:, :, :, part] = 0
        gap, ray, leads, rough = told.values()
        seen = observed.flatten(1)  # (B, N)
        signal = self._signal(x)
        if self.config.residual:
            signal = torch.cat([signal, rough[..., _OWN].flatten(1, 2)], -1)
        encoded, index, real = self._encode(signal, seen)

        hidden = self.mask_token.expand(*seen.shape, -1)  # (B, N, C)
        if self.config.residual:
            far = torch.log1p(gap.flatten(1, 2)) / math.log(1000)
            near = (leads / self.reach[:, None]).clamp(-5, 5).flatten(3)
            hints = (self._signal(base), far, *(hint.flatten(1, 2) for hint in (ray, near, rough)))
            hidden = hidden + self.embed_base(torch.cat(hints, -1))
        encoded = torch.where(real[..., None], encoded, 0)
        shown = torch.zeros_like(hidden).scatter_add(1, index[..., None].expand_as(encoded), encoded)
        tokens = torch.where(seen[..., None], shown, hidden) + self.decoder_context()
        for block in self.decoder:
            tokens = block(tokens)
        tokens = self.decoder_norm(tokens)
        predicted = self.head(tokens).unflatten(1, base.shape[1:3])
        # Detached: learning how sure it is cost the network accuracy where the two shared features.
        features = tokens.detach()
        if self.config.residual:
            distance = torch.log(torch.linalg.norm(leads, dim=-1) + _NEAR).flatten(1, 2)
            told = torch.cat([far, rough.flatten(1, 2), distance, ray.abs().amax(-1).flatten(1)[..., None]], -1)
            amount = self.amount(told).clamp(-_MOST, _MOST).exp().unflatten(1, base.shape[1:3])
            amount = torch.where(observed[..., None], 1, amount)
            # The fourth number is how much farther along the ray.
            predicted = base + amount * (predicted[..., :3] + predicted[..., 3:] * ray)
            features = torch.cat([features, told], -1)
        log_scale = self.scale_head(features).view_as(base[..., 0])
        return Prediction(predicted, log_scale)

    def _signal(self, x: Tensor) -> Tensor:
        """The signal code (B, N, C) of joints (B, T, J, 3)."""
        if not self.config.residual:
            return self.signal(x.flatten(1, 2))
        offset = (x - self.rest).flatten(1, 2)
        return torch.cat([offset / _SPREAD, self.signal(offset)], -1)

    def _encode(self, signal: Tensor, seen: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Encoded observed tokens (B, n, C), which they are (B, n), and which of them are not padding (B, n)."""
        longest = max(1, int(seen.sum(1).max()))
        index = torch.argsort(seen.byte(), dim=1, descending=True, stable=True)[:, :longest]
        real = seen.gather(1, index)
        # In a window without any observed token attention needs one key; what comes of it is dropped.
        keys = None if bool(real.all()) else real | ~real.any(1, keepdim=True)
        tokens = self.embed(signal.gather(1, index[..., None].expand(-1, -1, signal.shape[-1])))
        context = self.encoder_context()
        tokens = tokens + (context[index] if isinstance(context, Tensor) else context)
        for block in self.encoder:
            tokens = block(tokens, keys)
        return self.narrow(self.encoder_norm(tokens)), index, real
