"""People with holes, and a completer that fills them in no time."""

from dataclasses import replace

import numpy as np
import torch

from dmae.clip import Poses3D
from dmae.complete import Completer
from dmae.hiding import HidingConfig, hide_bursts
from dmae.mapping import convert
from dmae.model import DMAE, ModelConfig
from dmae.skeleton import SHELF14
from dmae.windows import rest_pose

from .strollers import strollers

FPS = 25.0
SMALL = ModelConfig(frames=9, dim=16, depth=1, heads=2, head_dim=8, mlp=32, decoder_dim=8, signal_codes=8)


def untrained(residual: bool = True, denoise: bool = False, factors: tuple[float, ...] | None = None) -> Completer:
    """A completer whose network adds something everywhere."""
    with torch.random.fork_rng():
        torch.manual_seed(0)
        model = DMAE(replace(SMALL, residual=residual, turn_to_front=residual), len(SHELF14)).eval()
        torch.nn.init.normal_(model.head.weight, std=0.01)
        torch.nn.init.normal_(model.scale_head[-1].weight, std=0.1)
    truth = convert(strollers(50, 3, rng=np.random.default_rng(9)), SHELF14)
    model.rest.copy_(torch.from_numpy(rest_pose(truth.xyz, SHELF14)))
    return Completer(model, SHELF14, torch.device("cpu"), denoise, factors)


def strolling(seed: int, frames: int = 60, persons: int = 3) -> Poses3D:
    return convert(strollers(frames, persons, rng=np.random.default_rng(seed)), SHELF14)


def with_holes(truth: Poses3D, seed: int) -> Poses3D:
    rng = np.random.default_rng(seed)
    hidden = hide_bursts(*truth.xyz.shape[:2], truth.skeleton, FPS, HidingConfig(longest=20), rng=rng)
    return Poses3D(truth.skeleton, np.where(hidden[..., None], np.nan, truth.xyz))
