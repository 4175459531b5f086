"""Assign the detections of a recording to people with known poses."""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from dmae.data.clip import Clip, Poses3D

MATCHED = 0.2
"""A detection matches a person if the median distance of their joints is below this many heights of the person."""
FRAGMENT = 0.15
"""An unmatched detection within this many heights of a person's joints is a fragment of that person."""
_MIN_JOINTS = 4
"""Detections with fewer joints are noise. Persons with fewer joints in an image are not matched there."""


@dataclass(frozen=True)
class Match:
    """The assignment of D detections to P persons, in V views.

    Attributes:
        xy: (F, V, P, J, 2) joints of the reference, px; NaN where unknown or outside the image.
        height: (F, V, P) height of the person, px; NaN where too few joints are in the image.
        found: (F, V, P, J, 2) detected joints of each person, px; NaN where missed.
        score: (F, V, P, J) confidences of the detected joints; NaN where missed.
        matched: (F, V, P) True where a person in the image has a detection.
        left_over: (F, V, D) True for detections without a person.
        near: (F, V, D) True for detections without a person that are near a person.
    """

    xy: np.ndarray
    height: np.ndarray
    found: np.ndarray
    score: np.ndarray
    matched: np.ndarray
    left_over: np.ndarray
    near: np.ndarray


def match_detections(clip: Clip, reference: Poses3D) -> Match:
    """Assign to each person of the reference at most one detection of each view, by the median distance of joints."""
    seen, score = clip.detections.xy.astype(np.float64), clip.detections.score
    xy, _ = clip.rig.project(reference.xyz)
    # The height is computed from all known joints of a person. The detector cannot find joints outside the image.
    known = ~np.isnan(xy[..., 1])
    high, low = np.where(known, xy[..., 1], -np.inf).max(-1), np.where(known, xy[..., 1], np.inf).min(-1)
    xy = np.where(clip.rig.inside(xy)[..., None], xy, np.nan)
    there = (~np.isnan(xy[..., 0])).sum(-1) >= max(_MIN_JOINTS, len(clip.detections.skeleton) // 2)
    height = np.where(there & (high - low > 1), high - low, np.nan)
    frames, views, people = height.shape
    found = np.full(xy.shape, np.nan)
    found_score = np.full(xy.shape[:-1], np.nan)
    matched = np.zeros(height.shape, bool)
    left_over = (~np.isnan(score)).sum(-1) >= _MIN_JOINTS
    near = np.zeros(left_over.shape, bool)
    for frame in range(frames):
        off = np.linalg.norm(xy[frame, :, :, None] - seen[frame, :, None], axis=-1) / height[frame, :, :, None, None]
        for view in range(views):
            distance = _median(off[view])
            cost = np.where(distance < MATCHED, distance, 1e3)
            for person, detection in zip(*linear_sum_assignment(cost), strict=True):
                if cost[person, detection] < MATCHED:
                    matched[frame, view, person] = True
                    found[frame, view, person] = seen[frame, view, detection]
                    found_score[frame, view, person] = score[frame, view, detection]
                    left_over[frame, view, detection] = False
            if people:
                near[frame, view] = (distance < FRAGMENT).any(0)
    found = np.where(np.isnan(xy), np.nan, found)
    return Match(xy, height, found, np.where(np.isnan(found[..., 0]), np.nan, found_score), matched, left_over, near)


def _median(distances: np.ndarray) -> np.ndarray:
    """Return the medians (...) of the known values in (..., J); infinite if fewer than three are known."""
    ordered, count = np.sort(distances, -1), (~np.isnan(distances)).sum(-1)
    middle = np.take_along_axis(ordered, np.maximum(count - 1, 0)[..., None] // 2, -1)[..., 0]
    return np.where(count >= 3, middle, np.inf)
