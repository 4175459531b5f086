"""Reassignment, the second pass: each joint takes the detections nearest to its own path."""

import numpy as np

from dmae.data.skeleton import Skeleton
from dmae.numerics.gaps import neighbours
from dmae.numerics.interpolation import linear
from dmae.reconstruction.association import NONE
from dmae.reconstruction.config import DistanceUnit
from dmae.reconstruction.evidence import Evidence
from dmae.reconstruction.pruning import prune

_CHUNK = 16
"""Frames compared at once: some 50 MB for six people in five views."""


def expected_paths(xyz: np.ndarray, skeleton: Skeleton, fps: float, max_gap_s: float) -> np.ndarray:
    """Return where joints are expected, (F, P, J, 3) m: pruned, with straight lines through short gaps.

    Args:
        xyz: (F, P, J, 3) m, NaN where absent.
        max_gap_s: Longest gap that is bridged, s.
    """
    pruned = prune(xyz, skeleton, fps)
    before, after = neighbours(~np.isnan(pruned[..., 0]))
    bridged = (before >= 0) & (after < len(pruned)) & (after - before <= int(max_gap_s * fps))
    return np.where(bridged[..., None], linear(pruned), np.nan)


def reassign(evidence: Evidence, assigned: np.ndarray, paths: np.ndarray, max_distance: float) -> np.ndarray:
    """Return, for joints with a path, the detections nearest to it that are nearest to no other person.

    This corrects detections that were assembled or matched wrongly: the wrist of a neighbour, a forearm that belongs
    to no detected person.

    Args:
        assigned: (F, P, V, J) index of the detection that shows the joint in the view, or `NONE`.
        paths: (F, P, J, 3) m; NaN where a joint has no path and keeps its assignment.
        max_distance: Largest distance of a detection from the path, m.

    Returns:
        (F, P, V, J) indices of detections, or `NONE`.
    """
    if not assigned.size:
        return assigned
    persons = np.arange(paths.shape[1])[:, None]
    reassigned = assigned.copy()
    for start in range(0, len(paths), _CHUNK):
        frames = slice(start, start + _CHUNK)
        distance = evidence.distances(frames, paths[frames], DistanceUnit.metres)
        distance = np.where(distance < max_distance, distance, np.inf)
        nearest = distance.argmin(3)
        owner = np.take_along_axis(distance.argmin(2), nearest, 2)
        found = np.isfinite(distance.min(3)) & (owner == persons)
        best = np.where(found, nearest, NONE).swapaxes(1, 2)
        has_path = ~np.isnan(paths[frames, :, None, :, 0])
        reassigned[frames] = np.where(has_path, best, assigned[frames])
    return reassigned
