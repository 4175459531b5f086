"""Clips of procedural people with known truth."""

from functools import cache

import numpy as np

from dmae.data.cameras import CameraRig
from dmae.data.clip import Clip, Detections2D, Poses3D
from dmae.data.skeleton import BODY25
from dmae.metrics.comparison import match, take_matched
from tests.support.clips import looking_at_origin, t_pose

FPS = 25.0
FRAMES = 100


def walk(start: tuple, end: tuple, scale: float = 1.0, heading: float = 0.0, frames: int = FRAMES) -> np.ndarray:
    """(F, 25, 3) a person of a size and heading who walks a straight line with hanging, swinging arms."""
    body = t_pose()
    for side, sign in (("l", 1), ("r", -1)):
        body[BODY25.index(f"{side}_elbow", f"{side}_wrist")] = (0, 0.24 * sign, 1.17), (0.05, 0.25 * sign, 0.92)
    cos, sin = np.cos(heading), np.sin(heading)
    xyz = np.tile(scale * body @ np.array([[cos, sin, 0], [-sin, cos, 0], [0, 0, 1]]), (frames, 1, 1))
    swing = 0.12 * np.sin(2 * np.pi * np.arange(frames) / FPS)[:, None] * (cos, sin, 0)
    xyz[:, BODY25.index("l_wrist")[0]] += swing
    xyz[:, BODY25.index("r_wrist")[0]] -= swing
    xyz[..., :2] += np.linspace(start, end, frames)[:, None]
    return xyz


def detected_clip(
    people: np.ndarray,
    views: int = 4,
    miss: float = 0.1,
    noise: float = 3.0,
    seed: int = 0,
    rig: CameraRig | None = None,
) -> Clip:
    """Detections of people (F, P, 25, 3), NaN where absent: with noise, some missed, in random order."""
    rng = np.random.default_rng(seed)
    rig = rig or looking_at_origin(views)
    xy = rig.project(people)[0]
    xy = xy + rng.normal(0, noise, xy.shape)
    xy[~rig.inside(xy) | (rng.random(xy.shape[:-1]) < miss)] = np.nan
    score = np.where(np.isnan(xy[..., 0]), np.nan, rng.uniform(0.6, 0.95, xy.shape[:-1]))
    order = rng.permuted(np.tile(np.arange(xy.shape[2]), (*xy.shape[:2], 1)), axis=-1)[..., None]
    detections = Detections2D(BODY25, np.take_along_axis(xy, order[..., None], 2), np.take_along_axis(score, order, 2))
    return Clip("made up", FPS, rig, detections, truth=Poses3D(BODY25, people))


def standing(frames: int = 40, persons: int = 1, scale: float = 1.0) -> np.ndarray:
    """(F, P, 25, 3) T-poses a metre apart."""
    xyz = np.tile(scale * t_pose(), (frames, persons, 1, 1))
    xyz[..., 1] += np.arange(persons)[:, None]
    return xyz


def with_body(detections: Detections2D, view: int, body: np.ndarray) -> Detections2D:
    """Return detections with one more in a view, the last: a body (F, J, 2) px, all of its joints known."""
    more = np.full_like(detections.xy[:, :, :1], np.nan)
    more[:, view, 0] = body
    xy = np.concatenate([detections.xy, more], 2)
    score = np.concatenate([detections.score, np.where(np.isnan(more[..., 0]), np.nan, 0.8)], 2)
    return Detections2D(detections.skeleton, xy, score)


@cache
def crossing() -> np.ndarray:
    """(F, 3, 25, 3) three people who cross each other's paths."""
    ways = [((-1.5, 0), (1.5, 0.2), 1, 0), ((1.5, -0.3), (-1.5, 0.7), 1.06, 3), ((0, -1.5), (0.4, 1.5), 0.9, 1.6)]
    return np.stack([walk(*way) for way in ways], 1)


def rows_of(poses: Poses3D, people: np.ndarray) -> list[list[int]]:
    """For each true person, the rows in which it was captured, in the order of time."""
    matches = match(poses.xyz, people)
    changes = [np.flatnonzero(np.diff(row, prepend=-2)) for row in (person[person >= 0] for person in matches.T)]
    return [person[person >= 0][change].tolist() for person, change in zip(matches.T, changes, strict=True)]


def errors(poses: Poses3D, people: np.ndarray) -> np.ndarray:
    """(F, P, J) m; NaN where a joint or its person is absent."""
    return np.linalg.norm(take_matched(poses.xyz, match(poses.xyz, people)) - people, axis=-1)
