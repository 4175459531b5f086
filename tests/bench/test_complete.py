"""Speed of completion and of training, compared with a plain transformer."""

import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
import yaml
from torch import Tensor, nn

from dmae.completion.complete import load_completer
from dmae.completion.config import AugmentConfig, MaskingConfig, ModelConfig
from dmae.completion.network import DMAE, Prediction
from dmae.completion.training_data import Examples, PosePair, Recipe, TrainingBatches
from dmae.completion.weights import find_shipped
from dmae.completion.windows import rest_pose
from dmae.data.clip import Clip, Poses3D, Source
from dmae.data.skeleton import BODY25
from dmae.data.typed import decode
from dmae.online.completion import complete_online
from dmae.reconstruction.config import CaptureConfig
from dmae.reconstruction.pipeline import capture
from tests.support.circling_people import circling_people
from tests.support.detected_people import detected_clip, walk

pytestmark = pytest.mark.bench

PAPER = yaml.safe_load((Path(__file__).parents[2] / "configs/model/paper.yaml").read_text())


def interleaved(*functions, times: int) -> list[float]:
    """s, the shortest run of each; taking turns, so that whatever else the machine does slows all alike."""
    spent = [[] for _ in functions]
    for _ in range(times):
        for function, found in zip(functions, spent, strict=True):
            start = time.perf_counter()
            function()
            found.append(time.perf_counter() - start)
    return [min(found) for found in spent]


def four_people() -> tuple[Clip, Poses3D]:
    """Seen by five cameras that miss half of the joints: a quarter of them have to be completed."""
    ways = [((-1.5, 0), (1.5, 0.2)), ((1.5, -0.3), (-1.5, 0.7)), ((0, -1.5), (0.4, 1.5)), ((1, 1.8), (-1, 1.6))]
    clip = detected_clip(np.stack([walk(*way, 1 - 0.03 * i, i) for i, way in enumerate(ways)], 1), views=5, miss=0.5)
    poses = capture(clip, CaptureConfig())
    assert poses.xyz.shape[1] == 4
    return clip, poses


def test_completing_four_people_from_five_cameras():
    clip, poses = four_people()
    completer = load_completer(find_shipped(BODY25), "cpu")
    assert (completer(poses, clip.fps).source == Source.COMPLETED).mean() > 0.1
    captured, completed, online = interleaved(
        lambda: capture(clip, CaptureConfig()),
        lambda: completer(poses, clip.fps),
        lambda: complete_online(completer, poses, clip.fps),
        times=3,
    )
    frames = len(clip)
    print(
        f"\n4 people, 5 views: completed {frames / completed:.0f} frames/s, captured and completed "
        f"{frames / (captured + completed):.0f}, completed online {frames / online:.0f}"
    )


class Plain(nn.Module):
    """The paper's network as one would write it first, of PyTorch's own layers: the encoder is given every token, those
    hidden as mask tokens that no other attends to. Its heads are as narrow as PyTorch makes them, half of the paper's;
    like ours it drops nothing within attention, which PyTorch has no fast way to do on a CPU."""

    def __init__(self, like: DMAE):
        super().__init__()
        config = like.config
        self.like, self.token = like, nn.Parameter(torch.zeros(config.encoder.dim))
        self.encoder, self.decoder = (
            nn.TransformerEncoder(
                nn.TransformerEncoderLayer(
                    dim,
                    config.encoder.heads,
                    config.encoder.mlp * dim // config.encoder.dim,
                    config.dropout,
                    "gelu",
                    batch_first=True,
                    norm_first=True,
                ),
                depth,
                nn.LayerNorm(dim),
                enable_nested_tensor=False,
            )
            for dim, depth in ((config.encoder.dim, config.encoder.depth), (config.decoder.dim, config.decoder.depth))
        )
        for layer in (*self.encoder.layers, *self.decoder.layers):
            layer.self_attn.dropout = 0.0

    def forward(self, x: Tensor, observed: Tensor, *_: Tensor) -> Prediction:
        like, seen = self.like, observed.flatten(1)
        tokens = torch.where(seen[..., None], like.embed(like.signal(x.flatten(1, 2))), self.token)
        # Attention needs one key.
        nobody = ~seen & seen.any(1, keepdim=True)
        tokens = self.encoder(tokens + like.encoder_context(), src_key_padding_mask=nobody)
        tokens = torch.where(seen[..., None], like.narrow(tokens), like.mask_token) + like.decoder_context()
        tokens = self.decoder(tokens)
        return Prediction(like.head(tokens).view_as(x), like.scale_head(tokens.detach()).view_as(x[..., 0]))


def taught(model: nn.Module, batches: list[Examples]):
    """A function that takes a step on each batch, as `dmae train` does."""
    optimizer = torch.optim.AdamW(model.parameters(), 1.5e-4, betas=(0.9, 0.95), weight_decay=0.05)

    def steps():
        for batch in batches:
            predicted = model(*batch.windows)
            error = (predicted.xyz - batch.truth).square().sum(-1)
            surprise = error.detach().sqrt() * (-predicted.log_scale).exp() + 3 * predicted.log_scale
            loss = ((error + 0.01 * surprise) * batch.hidden).sum() / batch.hidden.sum().clamp(min=1)
            optimizer.zero_grad()
            loss.backward()
            nn.utils.clip_grad_norm_(model.parameters(), 1.0)
            optimizer.step()

    return steps


@pytest.mark.parametrize("device", ["cpu", "cuda"])
def test_teaching_the_paper_s_network_beside_a_plain_transformer(device):
    if device == "cuda" and not torch.cuda.is_available():
        pytest.skip("no GPU")
    config = decode(ModelConfig, PAPER["model"])
    truth = circling_people(250, 4, rng=np.random.default_rng(0))
    rest = rest_pose(truth.xyz, BODY25)
    recipe = Recipe(
        config, rest, MaskingConfig(**PAPER["examples"]["masking"]), AugmentConfig(**PAPER["examples"]["augment"])
    )
    count, size = (1, 16) if device == "cpu" else (20, 256)
    batches = TrainingBatches([(1.0, [PosePair(truth)])], recipe, seed=0, epoch=0, steps=count, batch=size)
    batches = [
        Examples(type(batch.windows)(*(part.to(device) for part in batch.windows)), *(t.to(device) for t in batch[1:]))
        for batch in batches
    ]
    shown = float(np.mean([batch.windows.observed.float().mean().item() for batch in batches]))

    def synchronised(steps):
        def run():
            steps()
            if device == "cuda":
                torch.cuda.synchronize()

        return run

    ours = DMAE(config, len(BODY25)).to(device)
    plain = Plain(DMAE(replace(config), len(BODY25))).to(device)
    for unused in (plain.like.encoder, plain.like.decoder, plain.like.encoder_norm, plain.like.decoder_norm):
        unused.requires_grad_(False)
    first, second = interleaved(synchronised(taught(ours, batches)), synchronised(taught(plain, batches)), times=5)
    print(
        f"\npaper's network on {device}, {size} windows, {shown:.0%} of the tokens shown: {count / first:.2f} steps/s, "
        f"{second / first:.2f} x a plain nn.TransformerEncoder's {count / second:.2f}"
    )
