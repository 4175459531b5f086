"""Clips with fewer cameras."""

from dataclasses import replace

import numpy as np

from dmae.data.clip import Clip
from dmae.evaluation.corruption.registry import corruption


@corruption(
    "cameras", order=90, unit="cameras fewer", levels=(1, 2, 3), small=(1, 2, 3), fewer_cameras=True, whole=True
)
def cameras(clip: Clip, level: float, *, rng: np.random.Generator) -> Clip:
    """Cameras left out, drawn at random: of five, one fewer is four."""
    kept = np.sort(rng.permutation(len(clip.rig))[int(level) :])
    return replace(clip.select(views=kept.tolist()), poses=clip.poses)
