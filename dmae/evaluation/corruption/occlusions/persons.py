"""Joints hidden behind other people."""

import numpy as np

from dmae.data.clip import Clip
from dmae.evaluation.corruption.bodies import clearance_of_others
from dmae.evaluation.corruption.companions import companion
from dmae.evaluation.corruption.detections import undetected_nearest
from dmae.evaluation.corruption.people import by_detection
from dmae.evaluation.corruption.registry import corruption

_DISTANCE = 0.8
"""m; distance of a passer-by from the person."""
_TURN = 8.0
"""s; time in which a passer-by walks once around the person."""


@corruption("persons", order=11, unit="%", levels=(10, 20, 40, 60), small=(20, 40), most=100)
def persons(clip: Clip, level: float, *, rng: np.random.Generator) -> Clip:
    """Joints hidden behind other people, % of the detected joints.

    The other people are those of the clip, and for each person a passer-by who walks around at 0.8 m. All are as thick
    as it takes to hide that share of the joints. What a body hides is not detected, nor are passers-by.
    """
    people, skeleton = clip.poses.xyz.astype(np.float64), clip.poses.skeleton
    count = people.shape[1]
    angle = 2 * np.pi * (rng.random(count) + np.arange(len(clip))[:, None] / (clip.fps * _TURN))
    around = [companion(people, person, _DISTANCE, angle[:, person], 0) for person in range(count)]
    everyone = np.concatenate([people, *(body[:, None] for body in around)], 1)
    margin = clearance_of_others((clip.true_rig or clip.rig).centers, everyone, skeleton)[:, :, :count]
    return undetected_nearest(clip, by_detection(clip, margin), level)
