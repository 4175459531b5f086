"""Pruning: drop joints that cannot be right, because they break bones, or jump away and return."""

from math import prod

import numpy as np

from dmae.data.skeleton import Skeleton
from dmae.files.mapped import column_blocks, empty, frame_blocks
from dmae.numerics.body import bone_lengths, symmetric_bone_lengths
from dmae.reconstruction.compiled.jumps import drop_broken, drop_runs, impossible_runs

LONGEST_JUMP = 0.2
"""s"""
_NOISE = 0.10
"""m; a deviation that noise explains."""
_ACCELERATION = 60.0
"""m/s^2; hands in vigorous motion reach it."""
_STRETCH, _SLACK = 0.25, 0.05
"""A bone is broken when its length is off by more than this share and this many metres."""


def prune(xyz: np.ndarray, skeleton: Skeleton, fps: float) -> np.ndarray:
    """Return joints (F, P, J, 3) with NaN in place of those that break bones or jump."""
    pruned, usual = empty(xyz.shape, np.float64), symmetric_bone_lengths(xyz, skeleton)
    for part in frame_blocks(xyz, pruned):
        pruned[part] = np.where(broken(xyz[part], skeleton, usual)[..., None], np.nan, xyz[part])
    paths = pruned.reshape(len(pruned), prod(pruned.shape[1:-1]), 3)
    for columns, unbroken in column_blocks(paths):
        dropped = jumps(unbroken, fps, _ACCELERATION / skeleton.scale)
        if dropped.any():
            for part in frame_blocks(paths):
                paths[part, columns][dropped[part]] = np.nan
    return pruned


def broken(xyz: np.ndarray, skeleton: Skeleton, usual: np.ndarray | None = None) -> np.ndarray:
    """Find joints at the ends of bones that do not have their usual length.

    Of the two ends of such a bone, the one with more wrong bones is chosen; of equals, the one with the larger share of
    wrong bones; of equals, the one further from the root.

    Args:
        xyz: (F, P, J, 3) m, NaN where absent.
        usual: (P, B) m, usual lengths of the rigid bones; by default those in these frames.

    Returns:
        (F, P, J) True for the joints to drop.
    """
    usual = symmetric_bone_lengths(xyz, skeleton) if usual is None else usual
    dropped = np.zeros(xyz.shape[:3], bool)
    bones = skeleton.rigid_bones
    drop_broken(bone_lengths(xyz, bones), usual, np.array(bones, np.int64).reshape(-1, 2), _STRETCH, _SLACK, dropped)
    return dropped


def jumps(xyz: np.ndarray, fps: float, acceleration: float = _ACCELERATION) -> np.ndarray:
    """Find samples of joints that leave their path and return to it faster than a body can.

    A run of samples is a jump when each of them is off the sample before the run, the sample after it and the chord
    between these two by more than noise and a parabola of the greatest acceleration.

    Args:
        xyz: (F, ..., 3) m, NaN where absent.
        acceleration: m/s^2, the greatest that motion explains.

    Returns:
        (F, ...) True for the samples to drop.
    """
    flat = np.ascontiguousarray(xyz, np.float64).reshape(len(xyz), prod(xyz.shape[1:-1]), 3)
    known, widest = ~np.isnan(flat[..., 0]), max(round(LONGEST_JUMP * fps), 1)
    before, wanted = known.copy(), np.ones(flat.shape[1], bool)
    while wanted.any():
        # Of runs near each other only the worst is dropped: a jump makes the samples around it look impossible.
        runs = impossible_runs(flat, known, wanted, float(fps), widest, _NOISE, acceleration)
        drop_runs(runs[np.lexsort((-runs[:, 0], runs[:, 1]))], known, widest)
        wanted[:] = False
        wanted[runs[:, 1].astype(int)] = True
    return (before & ~known).reshape(xyz.shape[:-1])
