"""Limbs that no camera sees for a while."""

import numpy as np

from dmae.data.clip import Clip
from dmae.evaluation.corruption.body_limbs import limb_of_joint
from dmae.evaluation.corruption.detections import undetected
from dmae.evaluation.corruption.events import share_of_time
from dmae.evaluation.corruption.people import by_detection
from dmae.evaluation.corruption.registry import corruption

_TIMES = (1.0, 0.2)
"""s; correlation times of the bursts, mixed half and half."""


@corruption("bursts", order=14, unit="%", levels=(10, 20, 40, 60), small=(20, 40), most=100)
def bursts(clip: Clip, level: float, *, rng: np.random.Generator) -> Clip:
    """Limbs that no camera detects, % of the time, in bursts of tenths of a second to seconds.

    An arm, a leg, the head or the trunk of a person is missed by all cameras at the same time.
    """
    limb = limb_of_joint(clip.poses.skeleton)
    shape = (clip.poses.xyz.shape[1], limb.max(initial=-1) + 1)
    events = share_of_time(clip, shape, level, _TIMES, rng=rng)[..., limb]
    everywhere = np.broadcast_to(events[:, None], (len(clip), len(clip.rig), *events.shape[1:]))
    return undetected(clip, by_detection(clip, everywhere, False))
