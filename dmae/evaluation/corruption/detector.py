"""The nearest other detection of each detection in the image."""

import numpy as np

from dmae.data.clip import Clip
from dmae.evaluation.corruption.corrupt import (
    heights,
    limb_of_joint,
    people_of_detections,
    redetected,
    share_of_time,
    undetected,
)
from dmae.evaluation.corruption.registry import corruption
from dmae.numerics.statistics import bursts, multiscale_noise


def nearest_other(xy: np.ndarray) -> np.ndarray:
    """Return the index (F, V, D) of the nearest other detection in the image; its own index if there is no other.

    Args:
        xy: (F, V, D, J, 2) px.
    """
    middle = _middle(xy)
    distance = np.linalg.norm(middle[:, :, :, None] - middle[:, :, None], axis=-1)
    here = np.arange(xy.shape[2])
    distance[:, :, here, here] = np.inf
    distance = np.where(np.isnan(distance), np.inf, distance)
    if not xy.shape[2]:
        return np.zeros(xy.shape[:3], int)
    return np.where(np.isfinite(distance.min(-1)), distance.argmin(-1), here)


def _middle(xy: np.ndarray) -> np.ndarray:
    """Return the middle (F, V, D, 2) of the box around each detection, px; NaN where there is none."""
    known = ~np.isnan(xy)
    low, high = np.where(known, xy, np.inf).min(-2), np.where(known, xy, -np.inf).max(-2)
    any_known = known.any(-2)
    return np.where(any_known, (np.where(any_known, low, 0) + np.where(any_known, high, 0)) / 2, np.nan)


# Joints that the detector misses.

_TIMES = (0.5, 0.1)
"""s; correlation times of the misses, mixed half and half."""


@corruption("misses", order=20, unit="%", levels=(10, 20, 40, 60), small=(20, 40), most=100)
def misses(clip: Clip, level: float, *, rng: np.random.Generator) -> Clip:
    """Joints that the detector misses, % of the detected joints, in bursts, in each view on its own."""
    persons = people_of_detections(clip)
    shape = (len(clip.rig), clip.poses.xyz.shape[1] + 1, len(clip.detections.skeleton))
    missed = share_of_time(clip, shape, level, _TIMES, rng=rng)
    return undetected(clip, np.take_along_axis(missed, persons[..., None], 2))


# Joints that are detected with an offset.


@corruption("jitter", order=21, unit="% of height", levels=(0.5, 1, 2, 4), small=(1, 3))
def jitter(clip: Clip, level: float, *, rng: np.random.Generator) -> Clip:
    """Noise of the detected joints, standard deviation along each axis as % of the person's height in the image.

    It is Gaussian, and independent from frame to frame.
    """
    found = clip.detections
    scale = heights(found.xy)[..., None, None] * level / 100
    return redetected(clip, found.xy + scale * rng.standard_normal(found.xy.shape), found.score)


# Detections with left and right exchanged.

_side_swaps_TIMES = (0.5, 0.1)
"""s; correlation times of the swaps, mixed half and half."""


@corruption("side_swaps", order=22, unit="%", levels=(5, 10, 20, 40), small=(10, 40), most=100)
def side_swaps(clip: Clip, level: float, *, rng: np.random.Generator) -> Clip:
    """Left and right of a person confused by the detector, % of the time, in bursts, in each view on its own."""
    persons = people_of_detections(clip)
    swapped = share_of_time(clip, (len(clip.rig), clip.poses.xyz.shape[1] + 1), level, _side_swaps_TIMES, rng=rng)
    swapped = np.take_along_axis(swapped, persons, 2)[..., None]
    found, mirror = clip.detections, list(clip.detections.skeleton.mirror)
    xy = np.where(swapped[..., None], found.xy[..., mirror, :], found.xy)
    return redetected(clip, xy, np.where(swapped, found.score[..., mirror], found.score))


# Limbs that are detected on another person.

_person_swaps_TIMES = (0.5, 0.1)
"""s; correlation times of the swaps, mixed half and half."""


@corruption("person_swaps", order=23, unit="%", levels=(5, 10, 20, 40), small=(10, 40), most=100, people=2)
def person_swaps(clip: Clip, level: float, *, rng: np.random.Generator) -> Clip:
    """Limbs detected on the nearest other person in the image, % of the time, in bursts, in each view on its own."""
    persons, limb = people_of_detections(clip), limb_of_joint(clip.detections.skeleton)
    shape = (len(clip.rig), clip.poses.xyz.shape[1] + 1, limb.max(initial=-1) + 1)
    swapped = share_of_time(clip, shape, level, _person_swaps_TIMES, rng=rng)
    swapped = np.take_along_axis(swapped, persons[..., None], 2)[..., limb]
    found, other = clip.detections, nearest_other(clip.detections.xy)
    xy = np.where(swapped[..., None], np.take_along_axis(found.xy, other[..., None, None], 2), found.xy)
    score = np.where(swapped, np.take_along_axis(found.score, other[..., None], 2), found.score)
    return redetected(clip, xy, score)


# Detections of people where there are none.

_ghosts_TIMES = [3.0, 0.3]
"""s; correlation times of a ghost's presence, mixed half and half."""
_DUTY = 0.25
"""Share of the time in which a ghost is detected."""
_PLACES = 64
"""Number of ghosts that are drawn for each view. The first ones are used, so that a higher level only adds ghosts. The
number is also the largest level."""
_JITTER = 0.01
"""Standard deviation of a ghost's joints, as a share of its height."""


@corruption("ghosts", order=24, unit="ghosts", levels=(0.5, 1, 2, 4), small=(1, 4), most=16)
def ghosts(clip: Clip, level: float, *, rng: np.random.Generator) -> Clip:
    """People detected where there are none, mean number of them in an image.

    Each has the shape and confidences of a detection of the clip, at a fixed place, and is there a quarter of the time.
    """
    found, number = clip.detections, int(np.ceil(level / _DUTY))
    shape = (len(clip), len(clip.rig), _PLACES)
    there = multiscale_noise(shape, clip.fps, _ghosts_TIMES, rng=rng)[:, :, :number]
    there = bursts(level / number, there)
    drawn, place, scale = rng.random(shape[1:]), rng.random((*shape[1:], 2)), rng.uniform(0.5, 1, shape[1:])
    xy = np.full((*there.shape, *found.xy.shape[3:]), np.nan)
    score = np.full(xy.shape[:-1], np.nan)
    wobble = rng.standard_normal((*shape, 1, 2))[:, :, :number]
    for view in range(shape[1]):
        frames, detections = np.nonzero(found.observed[:, view].sum(-1) > len(found.skeleton) // 2)
        if not len(frames):
            continue
        one = (drawn[view, :number] * len(frames)).astype(int)
        joints = found.xy[frames[one], view, detections[one]] * scale[view, :number, None, None]
        middle = np.nanmean(joints, 1, keepdims=True)
        still = joints - middle + place[view, :number, None] * clip.rig.size[view]
        xy[:, view] = still + _JITTER * heights(still)[:, None, None] * wobble[:, view]
        score[:, view] = found.score[frames[one], view, detections[one]]
    score = np.where(there[..., None], score, np.nan)
    return redetected(clip, np.concatenate([found.xy, xy], 2), np.concatenate([found.score, score], 2))


# Two people who become one detection.

_merges_TIMES = (0.5, 0.1)
"""s; correlation times of the merges, mixed half and half."""


@corruption("merges", order=25, unit="%", levels=(10, 20, 40, 60), small=(20, 40), most=100, people=2)
def merges(clip: Clip, level: float, *, rng: np.random.Generator) -> Clip:
    """People detected as one with the nearest other person in the image, % of the time, in bursts.

    Some limbs of the one detection are those of the other person; the other detection is lost.
    """
    found, limb = clip.detections, limb_of_joint(clip.detections.skeleton)
    shape = (len(clip.rig), clip.poses.xyz.shape[1] + 1)
    persons, other = people_of_detections(clip), nearest_other(found.xy)
    merged = share_of_time(clip, shape, level, _merges_TIMES, rng=rng)
    taken = share_of_time(clip, (*shape, limb.max(initial=-1) + 1), 50, _merges_TIMES, rng=rng)
    merged = np.take_along_axis(merged, persons, 2) & (other != np.arange(persons.shape[2]))
    taken = np.take_along_axis(taken, persons[..., None], 2)[..., limb] & merged[..., None]
    xy = np.where(taken[..., None], np.take_along_axis(found.xy, other[..., None, None], 2), found.xy)
    score = np.where(taken, np.take_along_axis(found.score, other[..., None], 2), found.score)
    lost = np.zeros(persons.shape, bool)
    for detection in range(persons.shape[2]):  # If two people are each merged with the other, one of them remains.
        joined = merged[:, :, detection] & ~lost[:, :, detection]
        frame, view = np.nonzero(joined)
        lost[frame, view, other[frame, view, detection]] = True
    return redetected(clip, xy, np.where(lost[..., None], np.nan, score))
