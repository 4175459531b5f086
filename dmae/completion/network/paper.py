"""D-MAE: a masked auto-encoder over single joints at single times (Jiang, Chen & Guo, ACM MM 2022).

Shapes: B windows, T frames, J joints, N = T * J tokens, n observed tokens, C channels.
"""

import math

import torch
from torch import Tensor, nn

from dmae.completion.network.config import ModelConfig
from dmae.completion.network.layers import Block, Chosen, ContextCode, FourierCode, Prediction

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
        """m; mean pose of the training data, see `dmae.completion.normalisation.rest_pose`."""
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
