"""Two people who become one detection."""

import numpy as np

from dmae.data.clip import Clip
from dmae.evaluation.corruption.body_limbs import limb_of_joint
from dmae.evaluation.corruption.detections import redetected
from dmae.evaluation.corruption.events import share_of_time
from dmae.evaluation.corruption.neighbours import nearest_other
from dmae.evaluation.corruption.people import people_of_detections
from dmae.evaluation.corruption.registry import corruption

_TIMES = (0.5, 0.1)
"""s; correlation times of the merges, mixed half and half."""


@corruption("merges", order=25, unit="%", levels=(10, 20, 40, 60), small=(20, 40), most=100, people=2)
def merges(clip: Clip, level: float, *, rng: np.random.Generator) -> Clip:
    """People detected as one with the nearest other person in the image, % of the time, in bursts.

    Some limbs of the one detection are those of the other person; the other detection is lost.
    """
    found, limb = clip.detections, limb_of_joint(clip.detections.skeleton)
    shape = (len(clip.rig), clip.poses.xyz.shape[1] + 1)
    persons, other = people_of_detections(clip), nearest_other(found.xy)
    merged = share_of_time(clip, shape, level, _TIMES, rng=rng)
    taken = share_of_time(clip, (*shape, limb.max(initial=-1) + 1), 50, _TIMES, rng=rng)
    merged = np.take_along_axis(merged, persons, 2) & (other != np.arange(persons.shape[2]))
    taken = np.take_along_axis(taken, persons[..., None], 2)[..., limb] & merged[..., None]
    xy = np.where(taken[..., None], np.take_along_axis(found.xy, other[..., None, None], 2), found.xy)
    score = np.where(taken, np.take_along_axis(found.score, other[..., None], 2), found.score)
    lost = np.zeros(persons.shape, bool)
    for detection in range(persons.shape[2]):  # If two people are each merged with the other, one of them remains.
        joined = merged[:, :, detection] & ~lost[:, :, detection]
        frame, view = np.nonzero(joined)
        lost[frame, view, other[frame, view, detection]] = True
    return redetected(clip, xy, np.where(lost[..., None], np.nan, score))
