"""Joints outside the image."""

import numpy as np

from dmae.data.clip import Clip
from dmae.evaluation.corruption.detections import undetected_nearest
from dmae.evaluation.corruption.registry import corruption


@corruption("edges", order=13, unit="%", levels=(10, 20, 40, 60), small=(20, 40), most=100)
def edges(clip: Clip, level: float, *, rng: np.random.Generator) -> Clip:
    """Joints outside the image, % of the detected joints.

    The images of all cameras are cut on all four sides, by the same share of their size, until this share of joints is
    outside. Nothing is drawn at random.
    """
    half = clip.rig.size[:, None, None] / 2
    return undetected_nearest(clip, (1 - np.abs(clip.detections.xy - (half - 0.5)) / half).min(-1), level)
