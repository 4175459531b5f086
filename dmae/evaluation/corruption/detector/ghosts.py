"""Detections of people where there are none."""

import numpy as np

from dmae.data.clip import Clip
from dmae.evaluation.corruption.detections import heights, redetected
from dmae.evaluation.corruption.registry import corruption
from dmae.numerics.statistics import bursts, multiscale_noise

_TIMES = [3.0, 0.3]
"""s; correlation times of a ghost's presence, mixed half and half."""
_DUTY = 0.25
"""Share of the time in which a ghost is detected."""
_PLACES = 64
"""Number of ghosts that are drawn for each view. The first ones are used, so that a higher level only adds ghosts. The
number is also the largest level."""
_JITTER = 0.01
"""Standard deviation of a ghost's joints, as a share of its height."""


@corruption("ghosts", order=24, unit="ghosts", levels=(0.5, 1, 2, 4), small=(1, 4), most=16)
def ghosts(clip: Clip, level: float, *, rng: np.random.Generator) -> Clip:
    """People detected where there are none, mean number of them in an image.

    Each has the shape and confidences of a detection of the clip, at a fixed place, and is there a quarter of the time.
    """
    found, number = clip.detections, int(np.ceil(level / _DUTY))
    shape = (len(clip), len(clip.rig), _PLACES)
    there = multiscale_noise(shape, clip.fps, _TIMES, rng=rng)[:, :, :number]
    there = bursts(level / number, there)
    drawn, place, scale = rng.random(shape[1:]), rng.random((*shape[1:], 2)), rng.uniform(0.5, 1, shape[1:])
    xy = np.full((*there.shape, *found.xy.shape[3:]), np.nan)
    score = np.full(xy.shape[:-1], np.nan)
    wobble = rng.standard_normal((*shape, 1, 2))[:, :, :number]
    for view in range(shape[1]):
        frames, detections = np.nonzero(found.observed[:, view].sum(-1) > len(found.skeleton) // 2)
        if not len(frames):
            continue
        one = (drawn[view, :number] * len(frames)).astype(int)
        joints = found.xy[frames[one], view, detections[one]] * scale[view, :number, None, None]
        middle = np.nanmean(joints, 1, keepdims=True)
        still = joints - middle + place[view, :number, None] * clip.rig.size[view]
        xy[:, view] = still + _JITTER * heights(still)[:, None, None] * wobble[:, view]
        score[:, view] = found.score[frames[one], view, detections[one]]
    score = np.where(there[..., None], score, np.nan)
    return redetected(clip, np.concatenate([found.xy, xy], 2), np.concatenate([found.score, score], 2))
