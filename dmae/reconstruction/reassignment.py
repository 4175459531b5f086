"""Reassignment, the second pass: each joint takes the detections nearest to its own path."""

from math import prod

import numpy as np

from dmae.data.skeleton import Skeleton
from dmae.files.mapped import column_blocks, frame_blocks
from dmae.numerics.paths import linear, neighbours
from dmae.reconstruction.compiled.reprojection import nearest_detections
from dmae.reconstruction.evidence import Evidence
from dmae.reconstruction.pruning import prune


def expected_paths(xyz: np.ndarray, skeleton: Skeleton, fps: float, max_gap_s: float) -> np.ndarray:
    """Return the expected places of joints, (F, P, J, 3) m: pruned, with straight lines through short gaps.

    Args:
        xyz: (F, P, J, 3) m, NaN where absent.
        max_gap_s: Longest gap that is bridged, s.
    """
    pruned = prune(xyz, skeleton, fps)
    # The paths are changed in place, as they are independent of each other.
    paths = pruned.reshape(len(pruned), prod(pruned.shape[1:-1]), 3)
    for columns, known in column_blocks(paths):
        before, after = neighbours(~np.isnan(known[..., 0]))
        bridged = (before >= 0) & (after < len(known)) & (after - before <= int(max_gap_s * fps))
        expected = np.where(bridged[..., None], linear(known), np.nan)
        for part in frame_blocks(paths):
            paths[part, columns] = expected[part]
    return pruned


def reassign(evidence: Evidence, assigned: np.ndarray, paths: np.ndarray, max_distance: float) -> np.ndarray:
    """Return, for joints with a path, the nearest detections that are not nearer to another person.

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
    rig, reassigned = evidence.rig, assigned.copy()
    paths = np.asarray(paths, np.float64)
    nearest_detections(rig.projections, rig.focal, evidence.xy[: len(paths)], paths, max_distance, reassigned)
    return reassigned
