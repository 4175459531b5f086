"""Clips with figures that a detector sees where no person is."""

from dataclasses import replace

import numpy as np

from dmae.data.clip import Clip, Detections2D
from dmae.data.skeleton import BODY25
from tests.support.detected_people import detected_clip, walk


def two_people(frames: int) -> np.ndarray:
    """(F, 2, 25, 3) two people who pass each other."""
    ways = [((-1.5, 0), (1.5, 0.2), 1, 0), ((0, -1.5), (0.4, 1.5), 0.9, 1.6)]
    return np.stack([walk(*way) for way in ways], 1)[:frames]


def haunted_clip(ghosts: int, frames: int, fixed: bool, seed: int = 1, people: np.ndarray | None = None) -> Clip:
    """Return people in five views, with `ghosts` ghosts in each view that are as sharp and confident as people.

    Each ghost is the projection of a body somewhere in a room of 6 m. The bodies are independent between views. Fixed
    ghosts stay for the whole clip; other ghosts are new in each frame. People (F, P, 25, 3) are by default two who pass
    each other.
    """
    clip, rng = detected_clip(two_people(frames) if people is None else people, 5), np.random.default_rng(seed)
    shape = (1 if fixed else frames, 5, ghosts)
    body = walk((0, 0), (0, 0), frames=1)[0] * rng.uniform(0.8, 1.1, (*shape, 1, 1))
    body = body + rng.normal(0, 0.05, body.shape)
    cos, sin = np.cos(angle := rng.uniform(-np.pi, np.pi, shape)), np.sin(angle)
    turn = np.stack([np.stack([cos, -sin], -1), np.stack([sin, cos], -1)], -2)
    body[..., :2] = body[..., :2] @ turn.swapaxes(-1, -2) + rng.uniform(-3, 3, (*shape, 1, 2))
    xy = np.stack([clip.rig.project(body[:, view])[0][:, view] for view in range(5)], 1)
    xy = xy + rng.normal(0, 2, (frames, *xy.shape[1:]))
    xy[~clip.rig.inside(xy) | (rng.random(xy.shape[:-1]) < 0.15)] = np.nan
    score = np.where(np.isnan(xy[..., 0]), np.nan, rng.uniform(0.4, 0.9, xy.shape[:-1]))
    found = clip.detections
    both = Detections2D(BODY25, np.concatenate([found.xy, xy], 2), np.concatenate([found.score, score], 2))
    return replace(clip, detections=both)
