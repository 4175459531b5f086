"""D-MAE, a masked auto-encoder over single joints at single times (Jiang, Chen and Guo, ACM MM 2022, section 3.2).

In the order of the paper: the codes, a transformer layer, then the network: an encoder of the observed tokens, a
decoder of all tokens, a head. Masks and loss are in `dmae.completion.training_data` and `dmae.completion.training`.

B windows, T frames, J joints, N = T J tokens, n observed tokens, C channels.

What differs from the paper, and why:

- Time and joint are scaled to [0, 1] before they are coded, with standard deviations of their own. With integers and a
  standard deviation of 1, as in the released code, neighbouring frames have unrelated codes.
- The matrices of the codes are saved with the weights. The released code draws them again from a seed.
- In pose fusion a joint of the target has the code of the source's joint of the same name: what pretraining learned of
  a wrist holds for both.
- Keys of attention start as a multiple of the queries (`key_init`), so that a token first attends to tokens with codes
  like its own. Started at random, the network has twice the error after the same time.
- The decoder has half of the channels and of the layers, as the paper says. The released one has as many layers.
- The mean height of each joint is added to what the head returns.
- A second head predicts the scale of the error. It learns from detached tokens, so that it changes nothing else.

The default network is the same class with `residual`: it predicts what to add to interpolated joints, see `DMAE`.
"""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

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

    places: Tensor
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
        return x.gather(1, self.places[..., None].expand(-1, -1, x.shape[-1]))

    def put(self, x: Tensor, tokens: int) -> Tensor:
        """Return chosen tokens (B, n, C) in their places (B, N, C), zero elsewhere."""
        x = torch.where(self.valid[..., None], x, 0)
        return x.new_zeros(len(x), tokens, x.shape[-1]).scatter_add(1, self.places[..., None].expand_as(x), x)


class FourierCode(nn.Module):
    """[cos 2πBx, sin 2πBx] of x (..., D), with a fixed Gaussian matrix B (C/2, D) that is saved with the weights."""

    B: Tensor

    def __init__(self, inputs: int, channels: int, sigma: float):
        super().__init__()
        self.register_buffer("B", torch.randn(channels // 2, inputs) * sigma)

    def forward(self, x: Tensor) -> Tensor:
        phase = 2 * math.pi * x @ self.B.T
        return torch.cat([phase.cos(), phase.sin()], -1)


class ContextCode(nn.Module):
    """γ(j) + γ(t): the codes of joint and time of each token; both indices are scaled to [0, 1]."""

    t: Tensor
    j: Tensor

    def __init__(self, config: CodesConfig, frames: int, places: Tensor, channels: int, with_all: bool = False):
        super().__init__()
        self.joint = FourierCode(1, channels, config.joint_sigma) if with_all or not config.no_joint else None
        self.time = FourierCode(1, channels, config.time_sigma) if with_all or not config.no_time else None
        self.register_buffer("t", torch.linspace(0, 1, frames)[:, None, None], persistent=False)
        self.register_buffer("j", places[:, None], persistent=False)

    def forward(self, joints: int) -> Tensor | float:
        """Return the codes (N, C) of the tokens of the first joints."""
        code: Tensor | float = 0.0
        if self.joint is not None:
            code = code + self.joint(self.j[:joints])
        if self.time is not None:
            code = code + self.time(self.t)
        # Of each joint and of each frame the code is computed once, then repeated.
        return code.expand(len(self.t), joints, -1).flatten(0, 1) if isinstance(code, Tensor) else code


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


# The network.

_ERROR_SCALE = 0.03  # m; scale of errors that training starts from

# What the default network has in addition.

_POSE_SCALE = 0.3  # m; how far joints typically are from the rest pose
_OFFSET_SCALE = (*4 * (0.3,), *2 * (0.06,))  # m; how large candidate offsets typically are
_FIELDS = ("gap", "ray", "candidate_offset", "noise_level")
"""Of `dmae.completion.windows.Windows`, those that hold input features."""
_HIDDEN_FEATURES = 2 + 3 + 6 * 3 + 6  # Numbers of gap, ray, candidate offsets and noise level
_SCALE_FEATURES = 2 + 6 + 6 + 1
"""Numbers of gap, noise level and lengths of candidate offsets, and whether there is a ray."""
_OBSERVED_NOISE = [0, 1, 3, 4]
"""Of the noise level, what an observed joint is given; the last and the next value coincide there."""
_SMALLEST = 0.01  # m; added to the lengths of candidate offsets before their logarithm is taken
_LARGEST_LOG_SCALE = 5.0  # Limit of the logarithm of the residual scale


class DMAE(nn.Module):
    """Predicts the coordinates of all joints in a window from those observed.

    A token is one joint at one time. The encoder is given the signal codes of the observed tokens only, plus context
    codes. The decoder, half as wide and as deep, is given encoded tokens where joints are observed, a shared mask token
    elsewhere, and context codes again. A head predicts coordinates,

        e = Enc({W γ(x) + γ(j) + γ(t) : observed}),  x̂ = h + Head(Dec(o e + (1 - o) m + γ(j) + γ(t))),

    with the mask token m and the mean heights h of the joints.

    With `residual` there are three additions:

    - It predicts what to add to interpolated joints b: a residual δ and a distance λ along the ray r of the one camera
      that detected the joint, both multiplied by a residual scale α of the gap, the noise level and the candidate
      offsets: x̂ = b + α (δ + λ r).
    - Hidden tokens carry the interpolated joint and its input features in addition to the mask token.
    - Coordinates are relative to the rest pose, and are given in addition to their signal code.

    The observed tokens are gathered to the largest number in the batch and padded, as attention is quadratic in tokens.
    """

    rest: Tensor
    """m; mean pose of the training data, see `dmae.completion.windows.rest_pose`."""
    pose_covariance: Tensor
    """m^2; covariance of poses about it, see `dmae.completion.pose_prior.pose_covariance`."""
    offset_scale: Tensor

    def __init__(self, config: ModelConfig, joints: int, namesakes: Sequence[int] | None = None):
        """
        Args:
            namesakes: For each joint the one whose code it has, see `dmae.completion.fusion.namesakes`; by default its
                own.
        """
        super().__init__()
        self.config = config
        places = torch.linspace(0, 1, joints)
        places = places if namesakes is None else places[list(namesakes)]
        encoder, decoder, residual = config.encoder, config.decoder, config.residual
        self.register_buffer("rest", torch.zeros(joints, 3))
        if residual:
            self.register_buffer("pose_covariance", torch.zeros(3 * joints, 3 * joints))
        self.signal = FourierCode(3, 2 * config.codes.signal, config.codes.signal_sigma)
        self.embed = nn.Linear(2 * config.codes.signal + residual * (3 + len(_OBSERVED_NOISE)), encoder.dim)
        self.encoder_context = ContextCode(config.codes, config.frames, places, encoder.dim)
        self.encoder = nn.ModuleList(
            Block(encoder.dim, encoder.heads, encoder.head_dim, encoder.mlp, config.dropout, config.key_init)
            for _ in range(encoder.depth)
        )
        self.encoder_norm = nn.LayerNorm(encoder.dim)

        self.narrow = nn.Linear(encoder.dim, decoder.dim)
        self.mask_token = nn.Parameter(torch.randn(decoder.dim) * 0.02)
        # Without its codes all masked tokens of a frame, or of a joint, would be one; the released code keeps them.
        self.decoder_context = ContextCode(config.codes, config.frames, places, decoder.dim, with_all=True)
        ratio = decoder.dim / encoder.dim
        head_dim, mlp = max(1, round(encoder.head_dim * ratio)), max(1, round(encoder.mlp * ratio))
        self.decoder = nn.ModuleList(
            Block(decoder.dim, encoder.heads, head_dim, mlp, config.dropout, config.key_init)
            for _ in range(decoder.depth)
        )
        self.decoder_norm = nn.LayerNorm(decoder.dim)
        self.head = nn.Linear(decoder.dim, 3 + residual)
        scale_inputs = decoder.dim + residual * _SCALE_FEATURES
        self.scale_head = nn.Sequential(nn.Linear(scale_inputs, 64), nn.GELU(), nn.Linear(64, 1))
        last: Any = self.scale_head[-1]
        nn.init.zeros_(last.weight)
        nn.init.constant_(last.bias, math.log(_ERROR_SCALE))
        if residual:
            self.register_buffer("offset_scale", torch.tensor(_OFFSET_SCALE), persistent=False)
            self.embed_hidden = nn.Linear(2 * config.codes.signal + 3 + _HIDDEN_FEATURES, decoder.dim)
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
        base: Tensor | None = None,
        gap: Tensor | None = None,
        ray: Tensor | None = None,
        candidate_offset: Tensor | None = None,
        noise_level: Tensor | None = None,
        wanted: Tensor | None = None,
    ) -> Prediction:
        """Predict joints; the arguments but the last are the fields of `dmae.completion.windows.Windows`.

        Args:
            x: (B, T, J, 3) m, T as in `config.frames`; not read where `observed` is False, NaN allowed there. J may be
                fewer than all joints: the first ones.
            observed: (B, T, J) bool, True where the encoder may look.
            base: (B, T, J, 3) m, interpolated joints; this and the following only with `residual`.
            gap: (B, T, J, 2) frames since and until the joint was observed.
            ray: (B, T, J, 3) direction of the one camera that detected the joint; zero where there is none.
            candidate_offset: (B, T, J, 6, 3) m, from `base` to other places where the joint may be.
            noise_level: (B, T, J, 6) logarithms of jitter and bone stretch.
            wanted: (B, T, J) True for the joints to be predicted, others become zero; None for all.

        Raises ValueError for windows of another length, too many joints, or features that `residual` lacks.
        """
        frames, most = self.config.frames, len(self.rest)
        if x.shape[:3] != observed.shape or observed.shape[1] != frames or observed.shape[2] > most:
            raise ValueError(
                f"expected x (B, {frames}, J, 3) and observed (B, {frames}, J) with J up to {most}; found "
                f"{tuple(x.shape)} and {tuple(observed.shape)}"
            )
        chosen = None if wanted is None else Chosen.where(wanted.flatten(1))
        x = torch.where(observed[..., None], x, 0)
        if self.config.residual:
            if base is None or gap is None or ray is None or candidate_offset is None or noise_level is None:
                raise ValueError(
                    "the network corrects interpolated joints (`residual`): expected base, gap, ray, candidate_offset "
                    "and noise_level, the fields of `dmae.completion.windows.Windows`"
                )
            gap, ray, candidate_offset, noise_level = self._ablated(gap, ray, candidate_offset, noise_level)
            tokens, xyz, features = self._residual(x, observed, base, gap, ray, candidate_offset, noise_level, chosen)
        else:
            encoded = self.encode(self.signal(x.flatten(1, 2)), observed)
            tokens = self.decode(encoded, self.mask_token, observed, chosen)
            heights = (self.rest[: x.shape[2]] * self.rest.new_tensor((0, 0, 1))).repeat(x.shape[1], 1)
            xyz = self.head(tokens) + (heights if chosen is None else heights[chosen.places])
            features = tokens[..., :0]
        # Detached: learning the scale of errors cost accuracy where the two shared features.
        log_scale = self.scale_head(torch.cat([tokens.detach(), features], -1))
        if chosen is not None:
            xyz, log_scale = (chosen.put(part, observed[0].numel()) for part in (xyz, log_scale))
        return Prediction(xyz.unflatten(1, observed.shape[1:]), log_scale.view(observed.shape))

    def encode(self, signal: Tensor, observed: Tensor) -> Tensor:
        """Return the encoded observed tokens in their places, (B, N, C) of the decoder, zero elsewhere.

        Args:
            signal: (B, N, C), what observed tokens carry.
            observed: (B, T, J)
        """
        chosen = Chosen.where(observed.flatten(1))
        index, valid = chosen
        # In a window without any observed token attention needs one key; its result is dropped.
        keys = None if bool(valid.all()) else valid | ~valid.any(1, keepdim=True)
        tokens = self.embed(chosen.take(signal))
        context = self.encoder_context(observed.shape[2])
        tokens = tokens + (context[index] if isinstance(context, Tensor) else context)
        for block in self.encoder:
            tokens = block(tokens, keys)
        return chosen.put(self.narrow(self.encoder_norm(tokens)), signal.shape[1])

    def decode(self, encoded: Tensor, hidden: Tensor, observed: Tensor, chosen: Chosen | None = None) -> Tensor:
        """Return decoded tokens (B, N, C), or those chosen (B, n, C).

        The decoder is given encoded tokens (B, N, C) where observed (B, T, J), else `hidden` (B, N, C) or (C,).
        """
        tokens = torch.where(observed.flatten(1)[..., None], encoded, hidden)
        tokens = tokens + self.decoder_context(observed.shape[2])
        for block in self.decoder[:-1]:
            tokens = block(tokens)
        # After the last layer no other token needs those that are not asked for.
        return self.decoder_norm(self.decoder[-1](tokens, wanted=chosen))

    def _residual(
        self,
        x: Tensor,
        observed: Tensor,
        base: Tensor,
        gap: Tensor,
        ray: Tensor,
        candidate_offset: Tensor,
        noise_level: Tensor,
        chosen: Chosen | None,
    ) -> tuple[Tensor, Tensor, Tensor]:
        """Return decoded tokens, the corrected joints (B, n, 3) m, and the features that the error's scale is given."""
        signal = torch.cat([self._coordinates(x), noise_level[..., _OBSERVED_NOISE].flatten(1, 2)], -1)
        encoded = self.encode(signal, observed)

        duration = torch.log1p(gap) / math.log(1000)
        offsets = (candidate_offset / self.offset_scale[:, None]).clamp(-5, 5).flatten(3)
        parts = (part.flatten(1, 2) for part in (duration, ray, offsets, noise_level))
        hidden = self.mask_token.expand_as(encoded)
        hidden = hidden + self.embed_hidden(torch.cat([self._coordinates(base), *parts], -1))
        tokens = self.decode(encoded, hidden, observed, chosen)

        def of_chosen(part: Tensor) -> Tensor:
            part = part.flatten(1, 2)
            return part if chosen is None else chosen.take(part)

        distance = torch.log(torch.linalg.norm(candidate_offset, dim=-1) + _SMALLEST)
        features = of_chosen(torch.cat([duration, noise_level, distance, ray.abs().amax(-1, keepdim=True)], -1))
        base, ray, known = map(of_chosen, (base, ray, observed[..., None]))
        scale = self.residual_scale(features).clamp(-_LARGEST_LOG_SCALE, _LARGEST_LOG_SCALE).exp()
        predicted = self.head(tokens)
        return tokens, base + torch.where(known, 1, scale) * (predicted[..., :3] + predicted[..., 3:] * ray), features

    def _ablated(self, *features: Tensor | None) -> list[Any]:
        fields: dict[str, Any] = dict(zip(_FIELDS, features, strict=True))
        for name in self.config.ablate:
            field, part = FEATURES[name]
            fields[field] = fields[field].clone()
            fields[field][:, :, :, part] = 0
        return list(fields.values())

    def _coordinates(self, x: Tensor) -> Tensor:
        """Return joints (B, T, J, 3) relative to the rest pose, and their signal code, (B, N, C)."""
        offset = (x - self.rest).flatten(1, 2)
        return torch.cat([offset / _POSE_SCALE, self.signal(offset)], -1)
