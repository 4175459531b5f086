"""Joints that are detected with an offset."""

import numpy as np

from dmae.data.clip import Clip
from dmae.evaluation.corruption.detections import heights, redetected
from dmae.evaluation.corruption.registry import corruption


@corruption("jitter", order=21, unit="% of height", levels=(0.5, 1, 2, 4), small=(1, 3))
def jitter(clip: Clip, level: float, *, rng: np.random.Generator) -> Clip:
    """Noise of the detected joints, standard deviation along each axis as % of the person's height in the image.

    It is Gaussian, and independent from frame to frame.
    """
    found = clip.detections
    scale = heights(found.xy)[..., None, None] * level / 100
    return redetected(clip, found.xy + scale * rng.standard_normal(found.xy.shape), found.score)
