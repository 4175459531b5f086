"""Joints hidden behind the person's own body."""

import numpy as np

from dmae.data.clip import Clip
from dmae.evaluation.corruption.bodies import clearance_of_self
from dmae.evaluation.corruption.detections import undetected_nearest
from dmae.evaluation.corruption.people import by_detection
from dmae.evaluation.corruption.registry import corruption


@corruption("own_body", order=12, unit="%", levels=(10, 20, 40, 60), small=(20, 40), most=100)
def own_body(clip: Clip, level: float, *, rng: np.random.Generator) -> Clip:
    """Joints hidden behind the person's own body, % of the detected joints.

    Limbs and trunk are as thick as it takes to hide that share of the joints. What they hide is not detected. Nothing
    is drawn at random.
    """
    centres, people = (clip.true_rig or clip.rig).centers, clip.poses.xyz.astype(np.float64)
    return undetected_nearest(clip, by_detection(clip, clearance_of_self(centres, people, clip.poses.skeleton)), level)
