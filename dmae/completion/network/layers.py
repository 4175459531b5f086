"""Layers of the networks: Fourier codes, attention, transformer layers.

Shapes: B windows, T frames, J joints, N = T * J tokens, C channels.
"""

import math
from typing import NamedTuple

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from dmae.completion.network.config import CodesConfig


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
