"""Examples: windows of masked poses, and the truth in them."""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from dmae.completion.network.config import ModelConfig
from dmae.completion.training.augmentation import AugmentConfig, with_noise
from dmae.completion.training.masking import MaskingConfig, mask
from dmae.completion.training.pose_pairs import PosePair
from dmae.completion.windows import Rows, Windows, make_rows
from dmae.data.clip import Poses3D
from dmae.data.conversion import convert

_KEPT_RAYS = 0.5
"""Share of the masked joints that keep their rays."""


@dataclass(frozen=True)
class Recipe:
    """How examples are made of true poses.

    Attributes:
        rest: (J, 3) m, see `dmae.completion.normalisation.rest_pose`.
    """

    model: ModelConfig
    rest: np.ndarray
    masking: MaskingConfig = field(default_factory=MaskingConfig)
    augment: AugmentConfig = field(default_factory=AugmentConfig)


class Examples(NamedTuple):
    """Windows and the truth in them."""

    windows: Windows
    truth: Tensor
    """(B, T, J, 3) m, zero where unknown."""
    hidden: Tensor
    """(B, T, J) True where the truth is known, the person is present, and the joint is not observed."""
    observed: Tensor
    """(B, T, J) True where the truth is known and the joint is observed, errors included."""


def masked_poses(pair: PosePair, recipe: Recipe, *, rng: np.random.Generator) -> Poses3D:
    """Return the captured poses of a pair, or else the true ones with noise, with joints masked."""
    source = pair.truth.skeleton.parts[0]
    measured = pair.captured or with_noise(convert(pair.truth, source), recipe.augment.noise, rng=rng)
    masked = mask(*measured.xyz.shape[:2], source, recipe.model.fps, recipe.masking, rng=rng)
    # A single camera still detects some masked joints, as it does many of those that capture leaves out.
    detected = rng.random((1, *measured.xyz.shape[1:3])) < _KEPT_RAYS
    rays = np.where((masked & ~detected)[..., None, None], np.nan, measured.rays)
    return Poses3D(source, np.where(masked[..., None], np.nan, measured.xyz), rays=rays)


def masked_rows(pair: PosePair, recipe: Recipe, *, rng: np.random.Generator) -> Rows:
    """Return the masked poses of a pair, and the truth, ready to be cut into windows."""
    measured = masked_poses(pair, recipe, rng=rng)
    truth, target = pair.truth.xyz, None
    if pair.truth.skeleton != measured.skeleton:
        target = pair.truth.skeleton.parts[-1]
        truth = np.where(np.arange(truth.shape[2])[:, None] < len(measured.skeleton), np.nan, truth)
    return make_rows(measured, recipe.model.fps, recipe.rest, recipe.model.frames, truth, target)


def cut_examples(rows: Rows, starts: np.ndarray, model: ModelConfig) -> Examples:
    """Return the windows that begin at `starts` and the truth in them."""
    windows, truth, _ = rows.cut(starts, model.frames, model.align_heading)
    known = ~np.isnan(truth).any(-1)
    present = rows.present[starts[:, None] + np.arange(model.frames)]
    known_present = torch.from_numpy(known & present[..., None])
    return Examples(
        windows,
        torch.from_numpy(np.nan_to_num(truth)),
        known_present & ~windows.observed,
        known_present & windows.observed,
    )
