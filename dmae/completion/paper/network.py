"""D-MAE as its paper has it (Jiang, Chen and Guo, A Dual-Masked Auto-Encoder for Robust Motion Capture, ACM MM 2022).

In the order of the paper: the codes, the encoder of observed tokens, the decoder with its mask token, the two masks,
the loss. Nothing here is shared with the package's own network. A token is one joint at one time. Shapes: B windows,
T frames, J joints, N = T J tokens, n observed tokens, C channels.

What differs from the paper, and why:

- Time and joint are scaled to [0, 1] before they are coded, with standard deviations of their own. With integers and a
  standard deviation of 1, as in the released code, neighbouring frames have unrelated codes.
- The matrices of the codes are saved with the weights. The released code draws them again from a seed.
- The decoder has half of the channels and half of the layers, as the paper says. The released one has as many layers.
- Windows are centred on the mean of the observed hips, else of all observed joints. The paper's mid hip may be missing.
- Windows in which nothing is observed predict nothing.
- The learning rate is that of the released code, 1.5e-4 with a warm-up to 1e-5; the paper states 1e-5.
"""

import math

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from dmae.completion.paper.config import PaperNetwork, PaperSchedule


class GaussianFourierCode(nn.Module):
    """γ(x) = [cos 2πBx, sin 2πBx] of x (..., D), with a fixed Gaussian matrix B (C / 2, D)."""

    def __init__(self, inputs: int, channels: int, sigma: float):
        super().__init__()
        self.register_buffer("B", torch.randn(channels // 2, inputs) * sigma)

    def forward(self, x: Tensor) -> Tensor:
        phase = 2 * math.pi * x @ self.B.T
        return torch.cat([phase.cos(), phase.sin()], -1)


class JointTimeCode(nn.Module):
    """γc(j) + γc(t), the context code of each token, (N, C)."""

    def __init__(self, network: PaperNetwork, joints: int, channels: int):
        super().__init__()
        self.joint = GaussianFourierCode(1, channels, network.joint_sigma)
        self.time = GaussianFourierCode(1, channels, network.time_sigma)
        times, numbers = torch.linspace(0, 1, network.frames), torch.linspace(0, 1, joints)
        self.register_buffer("t", times.repeat_interleave(joints)[:, None], persistent=False)
        self.register_buffer("j", numbers.repeat(network.frames)[:, None], persistent=False)

    def forward(self) -> Tensor:
        return self.joint(self.j) + self.time(self.t)


class Layer(nn.Module):
    """A transformer layer: attention over tokens, then a perceptron, both after a norm and added."""

    def __init__(self, dim: int, heads: int, head_dim: int, mlp: int, dropout: float):
        super().__init__()
        self.heads, self.dropout = heads, nn.Dropout(dropout)
        self.first, self.second = nn.LayerNorm(dim), nn.LayerNorm(dim)
        self.qkv = nn.Linear(dim, 3 * heads * head_dim, bias=False)
        self.out = nn.Linear(heads * head_dim, dim)
        self.mlp = nn.Sequential(nn.Linear(dim, mlp), nn.GELU(), nn.Dropout(dropout), nn.Linear(mlp, dim))

    def forward(self, x: Tensor, keys: Tensor | None = None) -> Tensor:
        """x (B, n, C); `keys` (B, n) True for the tokens that are attended to, None for all."""
        batch, count, _ = x.shape
        q, k, v = self.qkv(self.first(x)).view(batch, count, 3, self.heads, -1).permute(2, 0, 3, 1, 4)
        mask = None if keys is None else keys[:, None, None, :]
        attended = F.scaled_dot_product_attention(q, k, v, attn_mask=mask).transpose(1, 2).reshape(batch, count, -1)
        x = x + self.dropout(self.out(attended))
        return x + self.dropout(self.mlp(self.second(x)))


class PaperDMAE(nn.Module):
    """Predicts the coordinates of all joints in a window from those observed.

    Args:
        network: Sizes.
        joints: Of the source and the target skeleton together, so that a pretrained network has codes for joints that
            fine-tuning adds.
    """

    def __init__(self, network: PaperNetwork, joints: int):
        super().__init__()
        self.network, self.joints = network, joints
        dim, half = network.dim, network.dim // 2
        self.signal = GaussianFourierCode(3, dim, network.signal_sigma)
        self.embed = nn.Linear(dim, dim)
        self.encoder_context = JointTimeCode(network, joints, dim)
        self.encoder = nn.ModuleList(
            Layer(dim, network.heads, network.head_dim, network.mlp, network.dropout) for _ in range(network.depth)
        )
        self.encoder_norm = nn.LayerNorm(dim)
        self.narrow = nn.Linear(dim, half)
        self.mask_token = nn.Parameter(torch.randn(half) * 0.02)
        self.decoder_context = JointTimeCode(network, joints, half)
        self.decoder = nn.ModuleList(
            Layer(half, network.heads, network.head_dim // 2, network.mlp // 2, network.dropout)
            for _ in range(network.depth // 2)
        )
        self.decoder_norm = nn.LayerNorm(half)
        self.head = nn.Linear(half, 3)

    def forward(self, x: Tensor, observed: Tensor, asked: int | None = None) -> Tensor:
        """Return the coordinates of every joint, (B, T, J, 3) m.

        Args:
            x: (B, T, J, 3) m; not read where `observed` is False.
            observed: (B, T, J) True where the encoder may look.
            asked: Number of joints, from the first, that have tokens in the decoder, as in pretraining; None for all.
        """
        shape, seen = observed.shape, observed.flatten(1)
        # Only observed tokens are encoded: they are gathered, to the largest number in the batch.
        most = max(1, int(seen.sum(1).max()))
        index = torch.argsort(seen.byte(), dim=1, descending=True, stable=True)[:, :most]
        valid = seen.gather(1, index)
        keys = None if bool(valid.all()) else valid | ~valid.any(1, keepdim=True)
        places = x.flatten(1, 2).gather(1, index[..., None].expand(-1, -1, 3))
        tokens = self.embed(self.signal(torch.where(valid[..., None], places, 0))) + self.encoder_context()[index]
        for layer in self.encoder:
            tokens = layer(tokens, keys)
        tokens = torch.where(valid[..., None], self.narrow(self.encoder_norm(tokens)), 0)
        # The decoder has all tokens: encoded ones where joints are observed, the mask token elsewhere.
        encoded = tokens.new_zeros(*seen.shape, tokens.shape[-1])
        encoded = encoded.scatter_add(1, index[..., None].expand_as(tokens), tokens)
        tokens = torch.where(seen[..., None], encoded, self.mask_token) + self.decoder_context()
        if asked is not None:
            tokens = tokens.unflatten(1, shape[1:])[:, :, :asked].flatten(1, 2)
        for layer in self.decoder:
            tokens = layer(tokens)
        return self.head(self.decoder_norm(tokens)).unflatten(1, (shape[1], -1))


def dual_masks(shape: tuple[int, int, int], schedule: PaperSchedule, generator: torch.Generator) -> Tensor:
    """Return (B, T, J) True where a token is masked: a share of the joints, and all joints of a share of the frames."""
    joints = torch.rand(shape, generator=generator) < schedule.mask_joints
    return joints | (torch.rand((*shape[:2], 1), generator=generator) < schedule.mask_frames)


def masked_mse(predicted: Tensor, truth: Tensor, counted: Tensor) -> Tensor:
    """Return the mean squared error of the counted tokens, m^2; (B, T, J, 3) and (B, T, J)."""
    squared = (predicted - truth).square().sum(-1)
    return (squared * counted).sum() / counted.sum().clamp(min=1)


def learning_rate(step: int, steps: int, schedule: PaperSchedule) -> float:
    """Return the learning rate of a step: a linear rise, then a cosine to `least_lr`."""
    rise = max(1, round(schedule.warmup * steps))
    if step < rise:
        return schedule.lr * (step + 1) / rise
    done = (step - rise) / max(1, steps - rise)
    return schedule.least_lr + (schedule.lr - schedule.least_lr) * 0.5 * (1 + math.cos(math.pi * min(done, 1)))
