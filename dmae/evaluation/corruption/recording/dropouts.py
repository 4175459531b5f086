"""Cameras that give no detections for a while."""

import numpy as np

from dmae.data.clip import Clip
from dmae.evaluation.corruption.detections import undetected
from dmae.evaluation.corruption.events import share_of_time
from dmae.evaluation.corruption.registry import corruption

_TIMES = (1.0, 0.1)
"""s; correlation times of the dropouts, mixed half and half."""


@corruption("dropouts", order=31, unit="%", levels=(10, 20, 40, 60), small=(20, 40), most=100)
def dropouts(clip: Clip, level: float, *, rng: np.random.Generator) -> Clip:
    """Cameras that deliver nothing, % of the time, in bursts, each on its own."""
    lost = share_of_time(clip, (len(clip.rig),), level, _TIMES, rng=rng)
    return undetected(clip, lost[..., None, None])
