"""Clips to corrupt."""

import numpy as np

from dmae.data.clip import Clip, Detections2D
from dmae.data.labels import DetectionLabels
from dmae.data.skeleton import BODY25
from tests.support.circling_people import circling_people
from tests.support.clips import looking_at_origin


def strollers(
    frames: int = 40, persons: int = 3, views: int = 5, name: str = "strollers", truth: bool = True, fps: float = 25.0
) -> Clip:
    """People who stroll, detected in every view that has them in its image, a pixel off, in shuffled order."""
    rng = np.random.default_rng(3)
    rig, poses = looking_at_origin(views), circling_people(frames, persons, rng=rng, fps=fps)
    xy, _ = rig.project(poses.xyz)
    xy = xy + rng.normal(size=xy.shape)
    score = np.where(rig.inside(xy), rng.uniform(0.5, 1, xy.shape[:-1]), np.nan)
    shown = np.argsort(rng.random(xy.shape[:3]), -1)
    xy, score = (np.take_along_axis(a, shown.reshape(*shown.shape, *(1,) * (a.ndim - 3)), 2) for a in (xy, score))
    xy[np.isnan(score)] = np.nan
    return Clip(
        name,
        fps,
        rig,
        Detections2D(BODY25, xy, score),
        truth=poses if truth else None,
        detection_labels=DetectionLabels(shown),
    )
