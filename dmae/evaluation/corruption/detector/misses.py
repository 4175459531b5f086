"""Joints that the detector misses."""

import numpy as np

from dmae.data.clip import Clip
from dmae.evaluation.corruption.detections import undetected
from dmae.evaluation.corruption.events import share_of_time
from dmae.evaluation.corruption.people import people_of_detections
from dmae.evaluation.corruption.registry import corruption

_TIMES = (0.5, 0.1)
"""s; correlation times of the misses, mixed half and half."""


@corruption("misses", order=20, unit="%", levels=(10, 20, 40, 60), small=(20, 40), most=100)
def misses(clip: Clip, level: float, *, rng: np.random.Generator) -> Clip:
    """Joints that the detector misses, % of the detected joints, in bursts, in each view on its own."""
    persons = people_of_detections(clip)
    shape = (len(clip.rig), clip.poses.xyz.shape[1] + 1, len(clip.detections.skeleton))
    missed = share_of_time(clip, shape, level, _TIMES, rng=rng)
    return undetected(clip, np.take_along_axis(missed, persons[..., None], 2))
