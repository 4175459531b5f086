"""Pruning: drop joints that cannot be right, because they break bones, or jump away and return."""

from math import prod

import numpy as np

from dmae.data.skeleton import Skeleton
from dmae.numerics.bones import bone_lengths, symmetric_bone_lengths

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
    unbroken = np.where(broken(xyz, skeleton)[..., None], np.nan, xyz)
    return np.where(jumps(unbroken, fps, _ACCELERATION / skeleton.scale)[..., None], np.nan, unbroken)


def broken(xyz: np.ndarray, skeleton: Skeleton) -> np.ndarray:
    """Find joints at the ends of bones that do not have their usual length.

    Of the two ends of such a bone, the one with more wrong bones is chosen; of equals, the one with the larger share of
    wrong bones; of equals, the one further from the root.

    Args:
        xyz: (F, P, J, 3) m, NaN where absent.

    Returns:
        (F, P, J) True for the joints to drop.
    """
    bones = skeleton.rigid_bones
    start, end = np.array(bones, int).reshape(-1, 2).T
    length = bone_lengths(xyz, bones)
    usual = symmetric_bone_lengths(xyz, skeleton)
    with np.errstate(invalid="ignore"):
        wrong = np.abs(length - usual) > _STRETCH * usual + _SLACK
    touches = np.zeros((len(start), len(skeleton)))
    touches[np.arange(len(start)), start] = touches[np.arange(len(start)), end] = 1
    count = wrong @ touches
    score = count + 0.5 * count / np.maximum(~np.isnan(length) @ touches, 1)
    at_end = score[:, :, end] >= score[:, :, start]
    dropped = np.zeros(xyz.shape[:3], bool)
    for bone, (a, b) in enumerate(bones):
        dropped[:, :, b] |= wrong[..., bone] & at_end[..., bone]
        dropped[:, :, a] |= wrong[..., bone] & ~at_end[..., bone]
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
    flat = xyz.reshape(len(xyz), prod(xyz.shape[1:-1]), 3)
    found = np.zeros(flat.shape[:2], bool)
    widest = max(round(LONGEST_JUMP * fps), 1)
    for series in range(flat.shape[1]):
        kept = np.flatnonzero(~np.isnan(flat[:, series, 0]))
        while (dropped := _worst_jumps(flat[kept, series], kept / fps, widest, acceleration)).any():
            found[kept[dropped], series] = True
            kept = kept[~dropped]
    return found.reshape(xyz.shape[:-1])


def _worst_jumps(x: np.ndarray, t: np.ndarray, widest: int, acceleration: float) -> np.ndarray:
    """Return (n,) True for the least possible runs of at most `widest` samples (n, 3) at times (n,).

    Of runs near each other only the worst is returned: a jump makes the samples around it look impossible.
    """
    ratios, runs = [], []
    # A jump starts with a step that is too long, so most of the path need not be examined.
    step, dt = np.linalg.norm(np.diff(x, axis=0), axis=-1), np.diff(t)
    leaps = np.flatnonzero(step > _NOISE + acceleration / 2 * dt * dt.min(initial=np.inf))
    for width in range(1, min(widest, len(x) - 2) + 1) if len(leaps) else ():
        before = leaps[leaps + width + 1 < len(x)]
        a, b, ta, tb = x[before], x[before + width + 1], t[before], t[before + width + 1]
        ratio = np.full(len(a), np.inf)
        for k in range(1, width + 1):
            c, tc = x[before + k], t[before + k]
            chord = a + (b - a) * ((tc - ta) / (tb - ta))[:, None]
            allowed = _NOISE + acceleration / 2 * (tc - ta) * (tb - tc)
            deviation = np.linalg.norm(c - np.stack([chord, a, b]), axis=-1).min(0)
            ratio = np.minimum(ratio, deviation / allowed)
        ratios.append(ratio[ratio > 1])
        runs += [(start + 1, start + 1 + width) for start in before[ratio > 1]]
    dropped, touched = np.zeros(len(x), bool), np.zeros(len(x), bool)
    for run in np.argsort(-np.concatenate(ratios)) if runs else ():
        start, end = runs[run]
        if not touched[start:end].any():
            dropped[start:end] = True
            touched[max(start - widest, 0) : end + widest] = True
    return dropped
