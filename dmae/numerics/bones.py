"""Lengths of bones: distances between connected joints."""

from collections.abc import Sequence

import numpy as np

from dmae.data.skeleton import Skeleton
from dmae.files.mapped import by_frames
from dmae.numerics.compiled import compiled
from dmae.numerics.robust import median_over_frames

Bones = Sequence[tuple[int, int]]
"""Pairs of indices (parent, child), as in `Skeleton.bones`."""


def bone_lengths(xyz: np.ndarray, bones: Bones) -> np.ndarray:
    """Return the length of each bone in each frame, (F, P, B) m; NaN where one of its ends is unknown.

    Args:
        xyz: (F, P, J, 3) m.
        bones: B pairs of indices (parent, child).
    """
    lengths = np.empty((*xyz.shape[:2], len(bones)))
    _lengths(np.asarray(xyz, np.float64), np.array(bones, np.int64).reshape(-1, 2), lengths)
    return lengths


@compiled()
def _lengths(xyz, bones, lengths):
    """Write the length of each of `bones` (B, 2) in `xyz` (F, P, J, 3) to `lengths` (F, P, B)."""
    frames, persons, count = lengths.shape
    for f in range(frames):
        for p in range(persons):
            for b in range(count):
                square = 0.0
                for k in range(3):
                    square += (xyz[f, p, bones[b, 1], k] - xyz[f, p, bones[b, 0], k]) ** 2
                lengths[f, p, b] = np.sqrt(square)


def median_bone_lengths(xyz: np.ndarray, bones: Bones) -> np.ndarray:
    """Return the median length of each bone of each person, (P, B) m; NaN if it was never measured.

    Args:
        xyz: (F, P, J, 3) m; NaN where not measured.
        bones: B pairs of indices (parent, child).
    """
    return median_over_frames(bone_lengths(xyz, bones))


def symmetric_bone_lengths(xyz: np.ndarray, skeleton: Skeleton) -> np.ndarray:
    """Return the median length of each rigid bone of each person, (P, B) m; NaN if neither side was measured.

    The median is over the lengths of the bone and of the corresponding bone on the other side.

    Args:
        xyz: (F, P, J, 3) m; NaN where not measured.
        skeleton: Skeleton with B rigid bones.
    """
    bones = skeleton.rigid_bones
    lengths = by_frames(lambda xyz: bone_lengths(xyz, bones), xyz)
    order = {bone: i for i, bone in enumerate(bones)}
    mirror = skeleton.mirror
    partner = [order.get((mirror[a], mirror[b]), i) for i, (a, b) in enumerate(bones)]
    return _pooled_medians(lengths, np.array(partner, np.int64))


@compiled()
def _pooled_medians(lengths, partner):
    """Return medians (P, B) of the known lengths (F, P, B) of bones and of their mirror bones `partner` (B,).

    NaN where no length is known.
    """
    frames, persons, count = lengths.shape
    medians, known = np.full((persons, count), np.nan), np.empty(2 * frames)
    for p in range(persons):
        for b in range(count):
            number = 0
            for side in (b, partner[b]):
                for f in range(frames):
                    if not np.isnan(lengths[f, p, side]):
                        known[number] = lengths[f, p, side]
                        number += 1
            if number:
                medians[p, b] = np.median(known[:number])
    return medians


def parent_bone_lengths(xyz: np.ndarray, bones: Bones) -> np.ndarray:
    """Return the length of the bone between each joint and its parent, (F, P, J) m; NaN where unknown, and for roots.

    Args:
        xyz: (F, P, J, 3) m.
        bones: Pairs of indices (parent, child).
    """
    lengths = np.full(xyz.shape[:-1], np.nan)
    lengths[..., [joint for _, joint in bones]] = bone_lengths(xyz, bones)
    return lengths


def distance_to_bones(points: np.ndarray, xyz: np.ndarray, bones: Bones) -> np.ndarray:
    """Return the distance (N,) from points (N, C) to the nearest bone of a body (J, C); infinite if it has none.

    Bones with an unknown end are left out.
    """
    parents, joints = (xyz[list(ends)] for ends in zip(*bones, strict=True))
    known = np.isfinite(parents).all(-1) & np.isfinite(joints).all(-1)
    start, along = parents[known], (joints - parents)[known]
    from_start = points[:, None] - start
    share = (from_start * along).sum(-1) / np.maximum((along**2).sum(-1), 1e-9)
    distance = np.linalg.norm(from_start - np.clip(share, 0, 1)[..., None] * along, axis=-1)
    return distance.min(-1, initial=np.inf)
