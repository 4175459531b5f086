"""People with gaps, and an untrained completer that fills them quickly."""

from dataclasses import replace

import numpy as np
import torch

from dmae.completion.complete import Completer
from dmae.completion.config import MaskingConfig
from dmae.completion.network import DMAE
from dmae.completion.training_data import mask_bursts
from dmae.completion.windows import rest_pose
from dmae.data.clip import Poses3D
from dmae.data.conversion import convert
from dmae.data.skeleton import SHELF14
from tests.support.circling_people import circling_people
from tests.support.training import TINY_NETWORK

FPS = 25.0


def untrained(residual: bool = True, denoise: bool = False, factors: tuple[float, ...] | None = None) -> Completer:
    """Return a completer with a network that corrects every joint."""
    with torch.random.fork_rng():
        torch.manual_seed(0)
        model = DMAE(replace(TINY_NETWORK, frames=9, residual=residual, align_heading=residual), len(SHELF14)).eval()
        torch.nn.init.normal_(model.head.weight, std=0.01)
        torch.nn.init.normal_(model.scale_head[-1].weight, std=0.1)
    truth = convert(circling_people(50, 3, rng=np.random.default_rng(9)), SHELF14)
    model.rest.copy_(torch.from_numpy(rest_pose(truth.xyz, SHELF14)))
    return Completer(model, SHELF14, denoise, factors)


def circling(seed: int, frames: int = 60, persons: int = 3) -> Poses3D:
    return convert(circling_people(frames, persons, rng=np.random.default_rng(seed)), SHELF14)


def with_holes(truth: Poses3D, seed: int) -> Poses3D:
    rng = np.random.default_rng(seed)
    hidden = mask_bursts(*truth.xyz.shape[:2], truth.skeleton, FPS, MaskingConfig(longest=20), rng=rng)
    return Poses3D(truth.skeleton, np.where(hidden[..., None], np.nan, truth.xyz))
