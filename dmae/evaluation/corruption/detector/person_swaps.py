"""Limbs that are detected on another person."""

import numpy as np

from dmae.data.clip import Clip
from dmae.evaluation.corruption.body_limbs import limb_of_joint
from dmae.evaluation.corruption.detections import redetected
from dmae.evaluation.corruption.events import share_of_time
from dmae.evaluation.corruption.neighbours import nearest_other
from dmae.evaluation.corruption.people import people_of_detections
from dmae.evaluation.corruption.registry import corruption

_TIMES = (0.5, 0.1)
"""s; correlation times of the swaps, mixed half and half."""


@corruption("person_swaps", order=23, unit="%", levels=(5, 10, 20, 40), small=(10, 40), most=100, people=2)
def person_swaps(clip: Clip, level: float, *, rng: np.random.Generator) -> Clip:
    """Limbs detected on the nearest other person in the image, % of the time, in bursts, in each view on its own."""
    persons, limb = people_of_detections(clip), limb_of_joint(clip.detections.skeleton)
    shape = (len(clip.rig), clip.poses.xyz.shape[1] + 1, limb.max(initial=-1) + 1)
    swapped = share_of_time(clip, shape, level, _TIMES, rng=rng)
    swapped = np.take_along_axis(swapped, persons[..., None], 2)[..., limb]
    found, other = clip.detections, nearest_other(clip.detections.xy)
    xy = np.where(swapped[..., None], np.take_along_axis(found.xy, other[..., None, None], 2), found.xy)
    score = np.where(swapped, np.take_along_axis(found.score, other[..., None], 2), found.score)
    return redetected(clip, xy, score)
