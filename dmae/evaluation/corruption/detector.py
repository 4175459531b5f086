"""Errors of a detector: joints missed or off, sides and people confused, people merged, people where there are none."""

import numpy as np

from dmae.data.clip import Clip
from dmae.evaluation.corruption.corrupt import (
    heights,
    limb_of_joint,
    middle,
    people_of_detections,
    redetected,
    share_of_time,
    taken,
    undetected,
)
from dmae.evaluation.corruption.registry import corruption
from dmae.numerics.statistics import bursts, multiscale_noise

_TIMES = (0.5, 0.1)  # s; correlation times of errors that come in bursts, mixed half and half
_GHOST_TIMES = [3.0, 0.3]  # s; correlation times of a ghost's presence, mixed half and half
_DUTY = 0.25  # Share of the time in which a ghost is detected
_PLACES = 64
"""Number of ghosts that are drawn for each view. The first ones are used, so that a higher level only adds ghosts. The
greatest level is this number times `_DUTY`."""
_JITTER = 0.01  # Standard deviation of a ghost's joints, as a share of its height


@corruption("misses", order=20, unit="%", levels=(10, 20, 40, 60), small=(20, 40), most=100)
def misses(clip: Clip, level: float, *, rng: np.random.Generator) -> Clip:
    """Joints that the detector misses, % of the detected joints, in bursts, in each view on its own."""
    return undetected(clip, _events(clip, people_of_detections(clip), level, len(clip.detections.skeleton), rng=rng))


@corruption("jitter", order=21, unit="% of height", levels=(0.5, 1, 2, 4), small=(1, 3))
def jitter(clip: Clip, level: float, *, rng: np.random.Generator) -> Clip:
    """Noise of the detected joints, standard deviation along each axis as % of the person's height in the image.

    It is Gaussian, and independent from frame to frame.
    """
    found = clip.detections
    scale = heights(found.xy)[..., None, None] * level / 100
    return redetected(clip, found.xy + scale * rng.standard_normal(found.xy.shape), found.score)


@corruption("side_swaps", order=22, unit="%", levels=(5, 10, 20, 40), small=(10, 40), most=100)
def side_swaps(clip: Clip, level: float, *, rng: np.random.Generator) -> Clip:
    """Left and right of a person confused by the detector, % of the time, in bursts, in each view on its own."""
    swapped = _events(clip, people_of_detections(clip), level, rng=rng)[..., None]
    found, mirror = clip.detections, list(clip.detections.skeleton.mirror)
    xy = np.where(swapped[..., None], found.xy[..., mirror, :], found.xy)
    return redetected(clip, xy, np.where(swapped, found.score[..., mirror], found.score))


@corruption("person_swaps", order=23, unit="%", levels=(5, 10, 20, 40), small=(10, 40), most=100, people=2)
def person_swaps(clip: Clip, level: float, *, rng: np.random.Generator) -> Clip:
    """Limbs detected on the nearest other person in the image, % of the time, in bursts, in each view on its own."""
    limb = limb_of_joint(clip.detections.skeleton)
    swapped = _events(clip, people_of_detections(clip), level, limb.max(initial=-1) + 1, rng=rng)[..., limb]
    return redetected(clip, *_with_joints_of(clip, nearest_other(clip.detections.xy), swapped))


@corruption("ghosts", order=24, unit="ghosts", levels=(0.5, 1, 2, 4), small=(1, 4), most=16)
def ghosts(clip: Clip, level: float, *, rng: np.random.Generator) -> Clip:
    """People detected where there are none, mean number of them in an image.

    Each has the shape and confidences of a detection of the clip, at a fixed place, and is there a quarter of the time.
    """
    found, number = clip.detections, int(np.ceil(level / _DUTY))
    shape = (len(clip), len(clip.rig), _PLACES)
    there = bursts(level / number, multiscale_noise(shape, clip.fps, _GHOST_TIMES, rng=rng)[:, :, :number])
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
        still = joints - np.nanmean(joints, 1, keepdims=True) + place[view, :number, None] * clip.rig.size[view]
        xy[:, view] = still + _JITTER * heights(still)[:, None, None] * wobble[:, view]
        score[:, view] = found.score[frames[one], view, detections[one]]
    score = np.where(there[..., None], score, np.nan)
    return redetected(clip, np.concatenate([found.xy, xy], 2), np.concatenate([found.score, score], 2))


@corruption("merges", order=25, unit="%", levels=(10, 20, 40, 60), small=(20, 40), most=100, people=2)
def merges(clip: Clip, level: float, *, rng: np.random.Generator) -> Clip:
    """People detected as one with the nearest other person in the image, % of the time, in bursts.

    Some limbs of the one detection are those of the other person; the other detection is lost.
    """
    limb, persons = limb_of_joint(clip.detections.skeleton), people_of_detections(clip)
    other, detections = nearest_other(clip.detections.xy), range(persons.shape[2])
    merged = _events(clip, persons, level, rng=rng) & (other != np.array(detections, int))
    swapped = _events(clip, persons, 50, limb.max(initial=-1) + 1, rng=rng)[..., limb] & merged[..., None]
    xy, score = _with_joints_of(clip, other, swapped)
    lost = np.zeros(persons.shape, bool)
    for detection in detections:  # If two people are each merged with the other, one of them remains.
        frame, view = np.nonzero(merged[:, :, detection] & ~lost[:, :, detection])
        lost[frame, view, other[frame, view, detection]] = True
    return redetected(clip, xy, np.where(lost[..., None], np.nan, score))


def _events(clip: Clip, persons: np.ndarray, percent: float, *items: int, rng: np.random.Generator) -> np.ndarray:
    """Draw events (F, V, D, *items), True in `percent` of the time, for the persons (F, V, D) that detections show."""
    shape = (len(clip.rig), clip.poses.xyz.shape[1] + 1, *items)
    return taken(share_of_time(clip, shape, percent, _TIMES, rng=rng), persons)


def _with_joints_of(clip: Clip, other: np.ndarray, swapped: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return places and scores with the joints of another detection (F, V, D) where `swapped` (F, V, D, J) is True."""
    xy, score = clip.detections.xy, clip.detections.score
    return np.where(swapped[..., None], taken(xy, other), xy), np.where(swapped, taken(score, other), score)


def nearest_other(xy: np.ndarray) -> np.ndarray:
    """Return the index (F, V, D) of the nearest other detection (F, V, D, J, 2) in the image, px; its own if alone."""
    here = np.arange(xy.shape[2])
    if not len(here):
        return np.zeros(xy.shape[:3], int)
    middles = middle(xy)
    distance = np.linalg.norm(middles[:, :, :, None] - middles[:, :, None], axis=-1)
    distance[:, :, here, here] = np.inf
    distance = np.where(np.isnan(distance), np.inf, distance)
    return np.where(np.isfinite(distance.min(-1)), distance.argmin(-1), here)
