"""The networks: layers, the paper's masked auto-encoder, and the default network that corrects interpolated joints.

B windows, T frames, J joints, N = T J tokens, n observed tokens, C channels.
"""

import math
from typing import NamedTuple

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from dmae.completion.config import FEATURES, CodesConfig, ModelConfig


class Prediction(NamedTuple):
    """Where joints are, and how large the error of that is expected to be."""

    xyz: Tensor
    """(B, T, J, 3) m."""
    log_scale: Tensor
    """(B, T, J) the logarithm of s in m; the error e has the density exp(-|e| / s) / (8 π s^3)."""


class Chosen(NamedTuple):
    """Some of the tokens of each window, padded to the largest number in the batch."""

    index: Tensor
    """(B, n) of the chosen tokens, in order."""
    valid: Tensor
    """(B, n) False for padding."""

    @classmethod
    def where(cls, mask: Tensor) -> "Chosen":
        """Choose the tokens where `mask` (B, N) is True; at least one, which may be padding."""
        longest = max(1, int(mask.sum(1).max()))
        index = torch.argsort(mask.byte(), dim=1, descending=True, stable=True)[:, :longest]
        return cls(index, mask.gather(1, index))

    def take(self, x: Tensor) -> Tensor:
        """Return the chosen ones (B, n, C) of tokens (B, N, C)."""
        return x.gather(1, self.index[..., None].expand(-1, -1, x.shape[-1]))

    def put(self, x: Tensor, tokens: int) -> Tensor:
        """Return chosen tokens (B, n, C) in their places (B, N, C), zero elsewhere."""
        x = torch.where(self.valid[..., None], x, 0)
        places = x.new_zeros(len(x), tokens, x.shape[-1])
        return places.scatter_add(1, self.index[..., None].expand_as(x), x)


class FourierCode(nn.Module):
    """[cos 2πBx, sin 2πBx] of x (..., D), with a fixed Gaussian matrix B (C/2, D) that is saved with the weights."""

    def __init__(self, inputs: int, channels: int, sigma: float):
        super().__init__()
        self.register_buffer("B", torch.randn(channels // 2, inputs) * sigma)

    def forward(self, x: Tensor) -> Tensor:
        phase = 2 * math.pi * x @ self.B.T
        return torch.cat([phase.cos(), phase.sin()], -1)


class ContextCode(nn.Module):
    """γ(j) + γ(t): the codes of joint and time of each token, (N, C); both indices are scaled to [0, 1]."""

    def __init__(self, config: CodesConfig, frames: int, joints: int, channels: int):
        super().__init__()
        self.joint = None if config.no_joint else FourierCode(1, channels, config.joint_sigma)
        self.time = None if config.no_time else FourierCode(1, channels, config.time_sigma)
        self.register_buffer("t", torch.linspace(0, 1, frames)[:, None, None], persistent=False)
        self.register_buffer("j", torch.linspace(0, 1, joints)[:, None], persistent=False)

    def forward(self) -> Tensor | float:
        code = 0.0
        if self.joint is not None:
            code = code + self.joint(self.j)
        if self.time is not None:
            code = code + self.time(self.t)
        # Of each joint and of each frame the code is computed once, then repeated.
        return code.expand(len(self.t), len(self.j), -1).flatten(0, 1) if isinstance(code, Tensor) else code


class Attention(nn.Module):
    """Multi-head self-attention. With `key_init` keys start as that multiple of the queries."""

    def __init__(self, dim: int, heads: int, head_dim: int, key_init: float):
        super().__init__()
        self.heads = heads
        self.qkv = nn.Linear(dim, 3 * heads * head_dim, bias=False)
        if key_init:
            with torch.no_grad():
                queries, keys, _ = self.qkv.weight.chunk(3)
                keys.copy_(key_init * queries)
        self.out = nn.Linear(heads * head_dim, dim)

    def forward(self, x: Tensor, valid: Tensor | None, wanted: Chosen | None = None) -> Tensor:
        """Return (B, n, C), or (B, m, C) for the m tokens that are `wanted`.

        Args:
            x: (B, n, C)
            valid: (B, n) True for the tokens that may be attended to, None for all.
        """
        if wanted is None:
            q, k, v = (self._by_head(part) for part in self.qkv(x).chunk(3, -1))
        else:
            queries, others = self.qkv.weight.split([self.qkv.out_features // 3, 2 * self.qkv.out_features // 3])
            q = self._by_head(F.linear(wanted.take(x), queries))
            k, v = (self._by_head(part) for part in F.linear(x, others).chunk(2, -1))
        mask = None if valid is None else valid[:, None, None, :]
        y = F.scaled_dot_product_attention(q, k, v, attn_mask=mask)
        return self.out(y.transpose(1, 2).flatten(2))

    def _by_head(self, x: Tensor) -> Tensor:
        """Return (B, n, C) as (B, heads, n, head_dim)."""
        return x.unflatten(-1, (self.heads, -1)).transpose(1, 2)


class Block(nn.Module):
    """Pre-norm transformer layer."""

    def __init__(self, dim: int, heads: int, head_dim: int, mlp: int, dropout: float, key_init: float):
        super().__init__()
        self.attention_norm = nn.LayerNorm(dim)
        self.attention = Attention(dim, heads, head_dim, key_init)
        self.mlp_norm = nn.LayerNorm(dim)
        self.mlp = nn.Sequential(nn.Linear(dim, mlp), nn.GELU(), nn.Dropout(dropout), nn.Linear(mlp, dim))
        self.dropout = nn.Dropout(dropout)

    def forward(self, x: Tensor, valid: Tensor | None = None, wanted: Chosen | None = None) -> Tensor:
        """Return the tokens after this layer, (B, n, C), or those `wanted` (B, m, C); see `Attention.forward`."""
        found = self.attention(self.attention_norm(x), valid, wanted)
        x = (x if wanted is None else wanted.take(x)) + self.dropout(found)
        return x + self.dropout(self.mlp(self.mlp_norm(x)))


# D-MAE: a masked auto-encoder over single joints at single times (Jiang, Chen & Guo, ACM MM 2022).

_ERROR_SCALE = 0.03
"""m; scale of errors that training starts from."""


class DMAE(nn.Module):
    """The paper's network: predicts the coordinates of all joints in a window from those observed.

    A token is one joint at one time. The encoder is given the signal codes of the observed tokens only, plus context
    codes. The decoder, half as wide in the paper, is given encoded tokens where joints are observed, a shared mask
    token elsewhere, and context codes again. A head predicts coordinates; another, which is not in the paper, the scale
    of their error.

    The observed tokens are gathered to the largest number in the batch and padded: attention is quadratic in the
    tokens, and leaving hidden ones in as excluded keys costs 1.4 times the whole step at a quarter hidden, 1.9 times at
    60 %.
    """

    observed_features = 0
    """Numbers that an observed token carries with its signal code; `outputs` and `scale_features` are those of the
    head, and those that the scale head is given in addition to decoded tokens."""
    outputs = 3
    scale_features = 0

    def __init__(self, config: ModelConfig, joints: int):
        super().__init__()
        self.config = config
        encoder, decoder = config.encoder, config.decoder
        self.register_buffer("rest", torch.zeros(joints, 3))
        """m; mean pose of the training data, see `dmae.completion.windows.rest_pose`."""
        self.signal = FourierCode(3, 2 * config.codes.signal, config.codes.signal_sigma)
        self.embed = nn.Linear(2 * config.codes.signal + self.observed_features, encoder.dim)
        self.encoder_context = ContextCode(config.codes, config.frames, joints, encoder.dim)
        self.encoder = nn.ModuleList(
            Block(encoder.dim, encoder.heads, encoder.head_dim, encoder.mlp, config.dropout, config.key_init)
            for _ in range(encoder.depth)
        )
        self.encoder_norm = nn.LayerNorm(encoder.dim)

        self.narrow = nn.Linear(encoder.dim, decoder.dim)
        self.mask_token = nn.Parameter(torch.randn(decoder.dim) * 0.02)
        self.decoder_context = ContextCode(config.codes, config.frames, joints, decoder.dim)
        ratio = decoder.dim / encoder.dim
        head_dim, mlp = max(1, round(encoder.head_dim * ratio)), max(1, round(encoder.mlp * ratio))
        self.decoder = nn.ModuleList(
            Block(decoder.dim, encoder.heads, head_dim, mlp, config.dropout, config.key_init)
            for _ in range(decoder.depth)
        )
        self.decoder_norm = nn.LayerNorm(decoder.dim)
        self.head = nn.Linear(decoder.dim, self.outputs)
        self.scale_head = nn.Sequential(nn.Linear(decoder.dim + self.scale_features, 64), nn.GELU(), nn.Linear(64, 1))
        nn.init.zeros_(self.scale_head[-1].weight)
        nn.init.constant_(self.scale_head[-1].bias, math.log(_ERROR_SCALE))

    def forward(self, x: Tensor, observed: Tensor, *_: Tensor, wanted: Tensor | None = None) -> Prediction:
        """Predict joints; further fields of `dmae.completion.windows.Windows` are not read.

        Args:
            x: (B, T, J, 3) m; not read where `observed` is False.
            observed: (B, T, J) True where the encoder may look.
            wanted: (B, T, J) True for the joints to be predicted, others become zero; None for all.
        """
        chosen = None if wanted is None else Chosen.where(wanted.flatten(1))
        encoded = self.encode(self.signal(x.flatten(1, 2)), observed.flatten(1))
        tokens = self.decode(encoded, self.mask_token.expand_as(encoded), observed.flatten(1), chosen)
        # Detached: learning the scale of errors cost accuracy where the two shared features.
        return self.prediction(self.head(tokens), self.scale_head(tokens.detach()), observed, chosen)

    @staticmethod
    def prediction(xyz: Tensor, log_scale: Tensor, observed: Tensor, chosen: Chosen | None) -> Prediction:
        """Return predictions of the chosen tokens, (B, n, 3) and (B, n, 1), by frame and joint, as `observed` is."""
        if chosen is not None:
            xyz, log_scale = (chosen.put(part, observed[0].numel()) for part in (xyz, log_scale))
        return Prediction(xyz.unflatten(1, observed.shape[1:]), log_scale.view(observed.shape))

    def encode(self, signal: Tensor, observed: Tensor) -> Tensor:
        """Return the encoded observed tokens in their places, (B, N, C) of the decoder, zero elsewhere.

        Args:
            signal: (B, N, C), what observed tokens carry.
            observed: (B, N)
        """
        chosen = Chosen.where(observed)
        index, valid = chosen
        # In a window without any observed token attention needs one key; its result is dropped.
        keys = None if bool(valid.all()) else valid | ~valid.any(1, keepdim=True)
        tokens = self.embed(chosen.take(signal))
        context = self.encoder_context()
        tokens = tokens + (context[index] if isinstance(context, Tensor) else context)
        for block in self.encoder:
            tokens = block(tokens, keys)
        return chosen.put(self.narrow(self.encoder_norm(tokens)), observed.shape[1])

    def decode(self, encoded: Tensor, hidden: Tensor, observed: Tensor, chosen: Chosen | None = None) -> Tensor:
        """Return decoded tokens (B, N, C), or those chosen (B, n, C).

        The decoder is given encoded tokens (B, N, C) where observed (B, N), else `hidden` (B, N, C).
        """
        tokens = torch.where(observed[..., None], encoded, hidden) + self.decoder_context()
        for block in self.decoder[:-1]:
            tokens = block(tokens)
        # After the last layer no other token needs those that are not asked for.
        return self.decoder_norm(self.decoder[-1](tokens, wanted=chosen))


# The default network: D-MAE that predicts corrections of interpolated joints.

_POSE_SCALE = 0.3
"""m; how far joints typically are from the rest pose."""

_OFFSET_SCALE = (*4 * (0.3,), *2 * (0.06,))
"""m; how large candidate offsets typically are."""

_FIELDS = ("gap", "ray", "candidate_offset", "noise_level")
"""Of `dmae.completion.windows.Windows`, those that hold input features."""

_HIDDEN_FEATURES = 2 + 3 + 6 * 3 + 6
"""Numbers of gap, ray, candidate offsets and noise level."""

_SCALE_FEATURES = 2 + 6 + 6 + 1
"""Numbers of gap, noise level and lengths of candidate offsets, and whether there is a ray."""

_OBSERVED_NOISE = [0, 1, 3, 4]
"""Of the noise level, what an observed joint is given; the last and the next value coincide there."""

_SMALLEST = 0.01
"""m; added to the lengths of candidate offsets before their logarithm is taken."""

_LARGEST_LOG_SCALE = 5.0
"""Limit of the logarithm of the residual scale."""


class ResidualDMAE(DMAE):
    """The paper's network with three changes.

    - It predicts what to add to interpolated joints (`base`): a residual, and a distance along the ray, both multiplied
      by a residual scale that depends on the gap, the noise level and the candidate offsets.
    - Hidden tokens carry the interpolated joint and its input features in addition to the mask token.
    - Coordinates are relative to the rest pose, and are given in addition to their signal code.
    """

    observed_features = 3 + len(_OBSERVED_NOISE)
    outputs = 4
    scale_features = _SCALE_FEATURES

    def __init__(self, config: ModelConfig, joints: int):
        super().__init__(config, joints)
        self.register_buffer("offset_scale", torch.tensor(_OFFSET_SCALE), persistent=False)
        self.embed_hidden = nn.Linear(2 * config.codes.signal + 3 + _HIDDEN_FEATURES, config.decoder.dim)
        # How much to add depends on how long and how far a joint is hidden, and on how noisy the poses are.
        self.residual_scale = nn.Sequential(nn.Linear(_SCALE_FEATURES, 32), nn.GELU(), nn.Linear(32, 1))
        # Training starts from the interpolation.
        for last in (self.head, self.residual_scale[-1]):
            nn.init.zeros_(last.weight)
            nn.init.zeros_(last.bias)

    def forward(
        self,
        x: Tensor,
        observed: Tensor,
        base: Tensor,
        gap: Tensor,
        ray: Tensor,
        candidate_offset: Tensor,
        noise_level: Tensor,
        wanted: Tensor | None = None,
    ) -> Prediction:
        """Predict joints; the arguments but the last are the fields of `dmae.completion.windows.Windows`.

        Args:
            x: (B, T, J, 3) m; not read where `observed` is False.
            observed: (B, T, J) True where the encoder may look.
            base: (B, T, J, 3) m, interpolated joints.
            gap: (B, T, J, 2) frames since and until the joint was observed.
            ray: (B, T, J, 3) direction of the one camera that detected the joint; zero where there is none.
            candidate_offset: (B, T, J, 6, 3) m, from `base` to other places where the joint may be.
            noise_level: (B, T, J, 6) logarithms of jitter and bone stretch.
            wanted: (B, T, J) True for the joints to be predicted, others become zero; None for all.
        """
        chosen = None if wanted is None else Chosen.where(wanted.flatten(1))
        gap, ray, candidate_offset, noise_level = self._ablated(gap, ray, candidate_offset, noise_level)
        signal = torch.cat([self._coordinates(x), noise_level[..., _OBSERVED_NOISE].flatten(1, 2)], -1)
        encoded = self.encode(signal, observed.flatten(1))

        duration = torch.log1p(gap) / math.log(1000)
        offsets = (candidate_offset / self.offset_scale[:, None]).clamp(-5, 5).flatten(3)
        features = (part.flatten(1, 2) for part in (duration, ray, offsets, noise_level))
        hidden = self.mask_token.expand_as(encoded)
        hidden = hidden + self.embed_hidden(torch.cat([self._coordinates(base), *features], -1))
        tokens = self.decode(encoded, hidden, observed.flatten(1), chosen)

        def of_chosen(part: Tensor) -> Tensor:
            part = part.flatten(1, 2)
            return part if chosen is None else chosen.take(part)

        distance = torch.log(torch.linalg.norm(candidate_offset, dim=-1) + _SMALLEST)
        features = of_chosen(torch.cat([duration, noise_level, distance, ray.abs().amax(-1, keepdim=True)], -1))
        base, ray, known = map(of_chosen, (base, ray, observed[..., None]))
        scale = self.residual_scale(features).clamp(-_LARGEST_LOG_SCALE, _LARGEST_LOG_SCALE).exp()
        predicted = self.head(tokens)
        xyz = base + torch.where(known, 1, scale) * (predicted[..., :3] + predicted[..., 3:] * ray)
        # Detached: learning the scale of errors cost accuracy where the two shared features.
        log_scale = self.scale_head(torch.cat([tokens.detach(), features], -1))
        return self.prediction(xyz, log_scale, observed, chosen)

    def _ablated(self, *features: Tensor) -> list[Tensor]:
        """Return the fields of input features with those named in `ablate` set to zero."""
        fields = dict(zip(_FIELDS, features, strict=True))
        for name in self.config.ablate:
            field, part = FEATURES[name]
            fields[field] = fields[field].clone()
            fields[field][:, :, :, part] = 0
        return list(fields.values())

    def _coordinates(self, x: Tensor) -> Tensor:
        """Return joints (B, T, J, 3) relative to the rest pose, and their signal code, (B, N, C)."""
        offset = (x - self.rest).flatten(1, 2)
        return torch.cat([offset / _POSE_SCALE, self.signal(offset)], -1)


def build_network(config: ModelConfig, joints: int) -> DMAE:
    """Return an untrained network for a number of joints: the paper's, or the default one if `config.residual`."""
    return (ResidualDMAE if config.residual else DMAE)(config, joints)
