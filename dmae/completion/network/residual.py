"""The default network: D-MAE that predicts corrections of interpolated joints.

Shapes: B windows, T frames, J joints, N = T * J tokens, C channels.
"""

import math

import torch
from torch import Tensor, nn

from dmae.completion.network.config import FEATURES, ModelConfig
from dmae.completion.network.layers import Chosen, Prediction
from dmae.completion.network.paper import DMAE

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
