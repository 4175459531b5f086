"""Lengths of bones: the distances between joints that the body keeps rigid."""

from collections.abc import Sequence

import numpy as np

from dmae.data.skeleton import Skeleton
from dmae.numerics.robust import median_over_frames

Bones = Sequence[tuple[int, int]]
"""Pairs of parent and joint, as `Skeleton.bones`."""


def bone_lengths(xyz: np.ndarray, bones: Bones) -> np.ndarray:
    """Return the length of each bone at each time, (F, P, B) m; NaN where either end is unknown.

    Args:
        xyz: (F, P, J, 3) m.
    """
    start, end = np.array(bones, int).reshape(-1, 2).T
    return np.linalg.norm(xyz[:, :, end] - xyz[:, :, start], axis=-1)


def median_bone_lengths(xyz: np.ndarray, bones: Bones) -> np.ndarray:
    """Return each person's median length of each bone, (P, B) m; NaN where it was never measured.

    Args:
        xyz: (F, P, J, 3) m, NaN where not measured.
    """
    return median_over_frames(bone_lengths(xyz, bones))


def symmetric_bone_lengths(xyz: np.ndarray, skeleton: Skeleton) -> np.ndarray:
    """Return each person's median length of each rigid bone of a skeleton, left and right pooled, (P, B) m.

    NaN where neither side was measured.

    Args:
        xyz: (F, P, J, 3) m, NaN where not measured.
    """
    bones = skeleton.rigid_bones
    lengths = bone_lengths(xyz, bones)
    order = {bone: i for i, bone in enumerate(bones)}
    mirror = skeleton.mirror
    partner = [order.get((mirror[a], mirror[b]), i) for i, (a, b) in enumerate(bones)]
    return median_over_frames(np.concatenate([lengths, lengths[:, :, partner]]))


def parent_bone_lengths(xyz: np.ndarray, bones: Bones) -> np.ndarray:
    """Return the length of the bone from each joint's parent, (F, P, J) m; NaN where unknown, and for roots.

    Args:
        xyz: (F, P, J, 3) m.
    """
    lengths = np.full(xyz.shape[:-1], np.nan)
    lengths[..., [joint for _, joint in bones]] = bone_lengths(xyz, bones)
    return lengths
