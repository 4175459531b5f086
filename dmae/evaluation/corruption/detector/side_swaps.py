"""Detections with left and right exchanged."""

import numpy as np

from dmae.data.clip import Clip
from dmae.evaluation.corruption.detections import redetected
from dmae.evaluation.corruption.events import share_of_time
from dmae.evaluation.corruption.people import people_of_detections
from dmae.evaluation.corruption.registry import corruption

_TIMES = (0.5, 0.1)
"""s; correlation times of the swaps, mixed half and half."""


@corruption("side_swaps", order=22, unit="%", levels=(5, 10, 20, 40), small=(10, 40), most=100)
def side_swaps(clip: Clip, level: float, *, rng: np.random.Generator) -> Clip:
    """Left and right of a person confused by the detector, % of the time, in bursts, in each view on its own."""
    persons = people_of_detections(clip)
    swapped = share_of_time(clip, (len(clip.rig), clip.poses.xyz.shape[1] + 1), level, _TIMES, rng=rng)
    swapped = np.take_along_axis(swapped, persons, 2)[..., None]
    found, mirror = clip.detections, list(clip.detections.skeleton.mirror)
    xy = np.where(swapped[..., None], found.xy[..., mirror, :], found.xy)
    return redetected(clip, xy, np.where(swapped, found.score[..., mirror], found.score))
