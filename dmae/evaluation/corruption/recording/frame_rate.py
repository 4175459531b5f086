"""Fewer frames per second."""

from dataclasses import replace

import numpy as np

from dmae.data.clip import Clip
from dmae.evaluation.corruption.registry import corruption


@corruption("frame_rate", order=91, unit="frames left out", levels=(1, 3, 7, 15), small=(3, 7), whole=True)
def frame_rate(clip: Clip, level: float, *, rng: np.random.Generator) -> Clip:
    """Frames left out after each frame that is kept: 1 halves the frame rate.

    Truth is left out with its frames. Nothing is drawn at random.
    """
    every = int(level) + 1
    return replace(clip.select(frames=slice(None, None, every)), fps=clip.fps / every)
