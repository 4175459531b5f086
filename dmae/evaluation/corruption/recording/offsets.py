"""Cameras that are not synchronised."""

import numpy as np

from dmae.data.clip import Clip
from dmae.evaluation.corruption.registry import corruption
from dmae.formats.reading import shift_views


@corruption("offsets", order=32, unit="frames", levels=(2, 4, 8, 16), small=(4, 8), whole=True)
def offsets(clip: Clip, level: float, *, rng: np.random.Generator) -> Clip:
    """Frames by which half of the cameras, drawn at random, are late."""
    late = rng.permutation(len(clip.rig)) < len(clip.rig) // 2
    return shift_views(clip, (late * int(level)).tolist())
