"""What is wrong though present: broken bones, joints that jump and return, ghosts, people counted twice."""

from collections.abc import Callable
from itertools import permutations
from math import prod

import numpy as np

from dmae.associate import NONE
from dmae.skeleton import Skeleton

_JUMP = 0.10
"""m; a deviation that noise explains."""
_ACCELERATION = 60.0
"""m/s^2; hands in vigorous motion reach it."""
LONGEST_JUMP = 0.2
"""s."""
_STRETCH, _SLACK = 0.25, 0.05
"""A bone is broken when its length is off by more than this share and this many metres."""
_AGREE = 0.75
"""Share of the joints detected in enough views on which the views agree: of people over 0.9, of chance about a half."""
_TWIN = 0.15
"""m; two whose joints are no further apart than this, by the median, are one."""
_REACH, _PACE = 0.5, 1.5
"""m and m/s: how far people come back from where they left."""
_BUILD = 0.15
"""Relative difference of bone lengths between two people who may be one."""


def bone_lengths(xyz: np.ndarray, skeleton: Skeleton) -> np.ndarray:
    """(P, B) median length of each of `skeleton.bones`, left and right taken together; NaN if never seen, m."""
    start, end = np.array(skeleton.bones).T
    length = np.linalg.norm(xyz[:, :, start] - xyz[:, :, end], axis=-1)
    mirror = np.asarray(skeleton.mirror)
    order = {bone: i for i, bone in enumerate(skeleton.bones)}
    partner = [order.get((mirror[a], mirror[b]), i) for i, (a, b) in enumerate(skeleton.bones)]
    both = np.concatenate([length, length[:, :, partner]])
    medians = np.full(both.shape[1:], np.nan)
    known = ~np.isnan(both).all(0)
    medians[known] = np.nanmedian(both[:, known], 0)
    return medians


def broken(xyz: np.ndarray, skeleton: Skeleton) -> np.ndarray:
    """Joints at the ends of bones that are not as long as they are otherwise in this person.

    Of the two ends of such a bone the one is blamed of whose bones more are wrong, or else the larger
    share; of equals the one further from the root.

    Args:
        xyz: (F, P, J, 3).

    Returns:
        (F, P, J) bool.
    """
    start, end = np.array(skeleton.bones).T
    length = np.linalg.norm(xyz[:, :, start] - xyz[:, :, end], axis=-1)
    usual = bone_lengths(xyz, skeleton)
    with np.errstate(invalid="ignore"):
        wrong = np.abs(length - usual) > _STRETCH * usual + _SLACK
    touches = np.zeros((len(start), len(skeleton)))
    touches[np.arange(len(start)), start] = touches[np.arange(len(start)), end] = 1
    count = wrong @ touches
    guilt = count + 0.5 * count / np.maximum(~np.isnan(length) @ touches, 1)
    at_end = guilt[:, :, end] >= guilt[:, :, start]
    blamed = np.zeros(xyz.shape[:3], bool)
    for bone, (a, b) in enumerate(skeleton.bones):
        blamed[:, :, b] |= wrong[..., bone] & at_end[..., bone]
        blamed[:, :, a] |= wrong[..., bone] & ~at_end[..., bone]
    return blamed


def jumps(xyz: np.ndarray, fps: float) -> np.ndarray:
    """Samples of joints that leave their path and return to it faster than a body can.

    A run of samples is a jump when each lies off the sample before it, the sample after it and the chord
    between them by more than noise and a parabola of the greatest acceleration.

    Args:
        xyz: (F, ..., 3).

    Returns:
        (F, ...) bool.
    """
    flat = xyz.reshape(len(xyz), prod(xyz.shape[1:-1]), 3)
    found = np.zeros(flat.shape[:2], bool)
    widest = max(round(LONGEST_JUMP * fps), 1)
    for series in range(flat.shape[1]):
        kept = np.flatnonzero(~np.isnan(flat[:, series, 0]))
        while (gone := _worst_jumps(flat[kept, series], kept / fps, widest)).any():
            found[kept[gone], series] = True
            kept = kept[~gone]
    return found.reshape(xyz.shape[:-1])


def _worst_jumps(x: np.ndarray, t: np.ndarray, widest: int) -> np.ndarray:
    """(n,) True for the most impossible runs of at most `widest` samples (n, 3) at times (n,).

    Of runs near each other only the worst: a jump makes its surroundings look impossible.
    """
    ratios, runs = [], []
    # A jump starts with a step that is too long: that spares most of the path.
    step, dt = np.linalg.norm(np.diff(x, axis=0), axis=-1), np.diff(t)
    leaps = np.flatnonzero(step > _JUMP + _ACCELERATION / 2 * dt * dt.min(initial=np.inf))
    for width in range(1, min(widest, len(x) - 2) + 1) if len(leaps) else ():
        before = leaps[leaps + width + 1 < len(x)]
        a, b, ta, tb = x[before], x[before + width + 1], t[before], t[before + width + 1]
        ratio = np.full(len(a), np.inf)
        for k in range(1, width + 1):
            c, tc = x[before + k], t[before + k]
            chord = a + (b - a) * ((tc - ta) / (tb - ta))[:, None]
            allowed = _JUMP + _ACCELERATION / 2 * (tc - ta) * (tb - tc)
            off = np.linalg.norm(c - np.stack([chord, a, b]), axis=-1).min(0)
            ratio = np.minimum(ratio, off / allowed)
        ratios.append(ratio[ratio > 1])
        runs += [(start + 1, start + 1 + width) for start in before[ratio > 1]]
    gone, touched = np.zeros(len(x), bool), np.zeros(len(x), bool)
    for run in np.argsort(-np.concatenate(ratios)) if runs else ():
        start, end = runs[run]
        if not touched[start:end].any():
            gone[start:end] = True
            touched[max(start - widest, 0) : end + widest] = True
    return gone


def ghosts(xyz: np.ndarray, fps: float, joints: int, seconds: float) -> np.ndarray:
    """(P,) True for tracks (F, P, J, 3) that have so many joints for less than so many seconds, or half the clip."""
    whole = (~np.isnan(xyz[..., 0])).sum(-1) >= joints
    return whole.sum(0) < min(seconds * fps, len(xyz) / 2)


def by_chance(xyz: np.ndarray, chosen: np.ndarray, views: int) -> np.ndarray:
    """(P,) True for tracks (F, P, J, 3) that are nobody: views see figures of their own that happen to line up.

    Args:
        chosen: (F, P, V, J) detections they are made of, or `NONE`.
        views: A joint detected in so many is expected to be found; of a person nearly all are, of chance few.
    """
    detected = ((chosen != NONE).sum(2) >= views).sum((0, 2))
    return (~np.isnan(xyz[..., 0])).sum((0, 2)) < _AGREE * detected


def same_person(
    xyz: np.ndarray,
    skeleton: Skeleton,
    fps: float,
    rejoin: float,
    differ: Callable[[], np.ndarray] | None = None,
) -> np.ndarray:
    """Which tracks are of one person.

    Doubles are two at one place for as long as both are there. A return is a track that starts after
    another has ended, within `rejoin` seconds and a walk's distance, with bones of the same lengths and
    clothes of the same colour; the nearest returns are taken first, and nobody is in two places.

    Args:
        xyz: (F, P, J, 3), NaN where absent.
        differ: Gives (P, P), whether two tracks differ in their looks, where there are images; asked if it matters.

    Returns:
        (P,) for each track the lowest track number of its person.
    """
    here = ~np.isnan(xyz[..., 0]).all(-1)
    label = np.arange(xyz.shape[1])
    lengths = bone_lengths(xyz, skeleton)
    lived = np.flatnonzero(here.any(0))
    returns = []
    for a, b in permutations(lived, 2):
        both = here[:, a] & here[:, b]
        last, first = np.flatnonzero(here[:, a])[-1], np.flatnonzero(here[:, b])[0]
        if both.any():
            if a < b and _distance(xyz[both, a], xyz[both, b]) < _TWIN:
                _join(label, a, b)
        elif 0 < first - last <= rejoin * fps:
            # Only the way over the floor: what is seen last may be feet, what is seen first a head.
            way = np.linalg.norm(np.nanmedian(xyz[last, a, :, :2], 0) - np.nanmedian(xyz[first, b, :, :2], 0))
            if way < _REACH + _PACE * (first - last) / fps and _same_build(lengths[a], lengths[b]):
                returns.append((way, a, b))
    strange = differ() if differ and returns else np.zeros((len(label), len(label)), bool)
    for _, a, b in sorted(returns):
        if not strange[a, b] and not (here[:, label == label[a]].any(1) & here[:, label == label[b]].any(1)).any():
            _join(label, a, b)
    return label


def _join(label: np.ndarray, a: int, b: int) -> None:
    low, high = sorted((label[a], label[b]))
    label[label == high] = low


def _distance(a: np.ndarray, b: np.ndarray) -> float:
    """Median m between the joints (F, J, 3) of two; infinite where they never have the same."""
    distance = np.linalg.norm(a - b, axis=-1)
    return float(np.nanmedian(distance)) if (~np.isnan(distance)).any() else np.inf


def _same_build(a: np.ndarray, b: np.ndarray) -> bool:
    """Whether bone lengths (B,) differ by little, or nothing is known of both."""
    difference = np.abs(a - b) / np.maximum(a, b)
    return bool(np.isnan(difference).all() or np.nanmedian(difference) < _BUILD)


def merge(chosen: np.ndarray, xyz: np.ndarray, label: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Detections (F, P, V, J) and joints (F, P, J, 3) of people instead of tracks; of doubles the older counts."""
    people = np.unique(label)
    merged, joints = chosen[:, people].copy(), xyz[:, people].copy()
    for track in np.flatnonzero(label != np.arange(len(label))):
        person = np.searchsorted(people, label[track])
        merged[:, person] = np.where(merged[:, person] == NONE, chosen[:, track], merged[:, person])
        joints[:, person] = np.where(np.isnan(joints[:, person]), xyz[:, track], joints[:, person])
    return merged, joints
