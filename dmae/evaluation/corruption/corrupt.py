"""Corrupt a clip: apply corruptions, each at a level; and what corruptions share: people, detections, events, limbs."""

from collections.abc import Mapping
from dataclasses import replace
from zlib import crc32

import numpy as np

from dmae.data.clip import Clip, Detections2D, Poses3D
from dmae.data.conversion import convert
from dmae.data.rng import Stream
from dmae.data.skeleton import Skeleton
from dmae.evaluation.corruption.registry import find_corruption
from dmae.metrics.comparison import match
from dmae.numerics.filling import fill_body_frame
from dmae.numerics.noise import multiscale_noise
from dmae.numerics.paths import linear
from dmae.reconstruction.config import CaptureConfig
from dmae.reconstruction.pipeline import capture

_GATE = 0.25  # Share of a person's height in the image. A detection with a greater mean distance shows another person.
_FRAMES = 200  # Number of frames that are matched together, to limit memory
_LIMBS = {
    "arm": ("elbow", "wrist", "hand", "thumb", "finger"),
    "leg": ("knee", "ankle", "toe", "heel", "foot"),
    "head": ("nose", "eye", "ear", "mouth", "head"),
}


def corrupt(clip: Clip, levels: Mapping[str, float], *, seed: int = 0, people: Poses3D | None = None) -> Clip:
    """Return the clip with corruptions applied, at a level each by name or `module:function`; itself if all are 0.

    The truth does not change, except that some frames may be removed. Images and poses are removed, because they do not
    belong to the new detections. A corruption draws the same numbers from the seed with and without others. `people`
    are by default `people_of(clip)`.

    Raises ValueError if there is no such corruption or level, or the clip has too few cameras or people for it, or the
    seed is negative.
    """
    found = {find_corruption(name): level for name, level in levels.items()}
    for entry, level in found.items():
        entry.check(level, clip)
    if seed < 0:
        raise ValueError(f"seed={seed}: expected 0 or more")
    active = sorted(((entry, level) for entry, level in found.items() if level), key=lambda each: each[0].order)
    if not active:
        return clip
    corrupted = replace(clip, poses=people or people_of(clip, CaptureConfig()), images=None)
    for entry, level in active:
        key = (int(Stream.STRESS), crc32(clip.id.encode()), crc32(entry.name.encode()))
        rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=key))
        corrupted = entry.function(corrupted, level, rng=rng)
    return replace(corrupted, poses=None)


# The people of a clip, and the detections that show each of them


def people_of(clip: Clip, config: CaptureConfig) -> Poses3D:
    """Return the people of a clip on the skeleton of its detections, with gaps filled linearly in the body's frame.

    They are the truth if it has the skeleton of the detections, otherwise the people that all cameras measure.
    """
    skeleton = clip.detections.skeleton
    truth = clip.truth
    known = truth is not None and skeleton.name in truth.skeleton.name.split("+")
    found = convert(truth, skeleton) if truth is not None and known else capture(clip, config)
    return fill_body_frame(found, clip.fps, linear)


def given_people(clip: Clip) -> Poses3D:
    """Return `clip.poses`, the people that corruptions are given."""
    assert clip.poses is not None
    return clip.poses


def pixels_of_people(clip: Clip) -> np.ndarray:
    """Return the pixels (F, V, P, J, 2) of `clip.poses` in the true cameras."""
    return clip.actual_rig.project(given_people(clip).xyz)[0]


def detections_of_people(clip: Clip) -> np.ndarray:
    """Return the index (F, V, P) of the detection that shows each person of `clip.poses`; -1 for none."""
    projected, found = pixels_of_people(clip), clip.detections.xy
    frames, views, people = projected.shape[:3]
    shown = np.full((frames, views, people), -1)
    for start in range(0, frames, _FRAMES):
        part = slice(start, start + _FRAMES)
        wanted, detected = (xy[part].reshape(-1, *xy.shape[2:]).astype(np.float64) for xy in (projected, found))
        height, scale = heights(wanted), np.ones(len(wanted))
        height[height == 0] = np.nan
        some = np.isfinite(height).any(1)
        scale[some] = np.nanmedian(height[some], 1)
        scale = scale[:, None, None, None]
        shown[part] = match(detected / scale, wanted / scale, _GATE).reshape(-1, views, people)
    return shown


def people_of_detections(clip: Clip) -> np.ndarray:
    """Return the index (F, V, D) of the person that each detection shows; P for a detection of nobody."""
    shown = detections_of_people(clip)
    persons = np.full(clip.detections.score.shape[:3], shown.shape[2])
    frame, view, person = np.nonzero(shown >= 0)
    persons[frame, view, shown[frame, view, person]] = person
    return persons


def by_detection(clip: Clip, values: np.ndarray, missing=np.nan) -> np.ndarray:
    """Return values (F, V, P, ...) of people as (F, V, D, ...) of the detections that show them."""
    spare = np.full((*values.shape[:2], 1, *values.shape[3:]), missing, values.dtype)
    return taken(np.concatenate([values, spare], 2), people_of_detections(clip))


def taken(values: np.ndarray, index: np.ndarray) -> np.ndarray:
    """Return values (F, V, D, ...) of other detections, or of people, whose index (F, V, D) is given for each."""
    return np.take_along_axis(values, index.reshape(*index.shape, *(1,) * (values.ndim - 3)), 2)


# Other detections, or fewer


def middle(points: np.ndarray) -> np.ndarray:
    """Return the middle (..., 2) of the box around the known points (..., J, 2); NaN where none is known."""
    low, high = box(points)
    return (low + high) / 2


def box(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the lowest and highest coordinates (..., 2) of the known points (..., J, 2); NaN where none is known."""
    known = np.where(np.isfinite(points), points, np.nan)
    return np.fmin.reduce(known, -2), np.fmax.reduce(known, -2)


def heights(xy: np.ndarray) -> np.ndarray:
    """Return the longer side (...) of the box around the known joints of (..., J, 2), px; 0 where none is known."""
    low, high = box(xy)
    return np.nan_to_num(high - low).max(-1)


def redetected(clip: Clip, xy: np.ndarray, score: np.ndarray) -> Clip:
    """Return the clip with other detections (F, V, D, J, ...), absent where NaN, and without labels of earlier ones."""
    absent = np.isnan(xy).any(-1) | np.isnan(score)
    xy, score = np.where(absent[..., None], np.nan, xy), np.where(absent, np.nan, score)
    return replace(clip, detections=Detections2D(clip.detections.skeleton, xy, score), detection_labels=None)


def undetected(clip: Clip, joints: np.ndarray) -> Clip:
    """Return the clip without the detected joints where `joints` (F, V, D, J) is True."""
    found = clip.detections
    return redetected(clip, found.xy, np.where(joints, np.nan, found.score))


def undetected_nearest(clip: Clip, margin: np.ndarray, percent: float) -> Clip:
    """Return the clip without the detected joints of the smallest known margins (F, V, D, J), a percentage of all."""
    margin = np.where(clip.detections.observed, margin, np.nan)
    nearest = _lowest(margin, percent)
    return undetected(clip, nearest) if nearest.any() else clip


# When events occur, and on which limbs


def share_of_time(
    clip: Clip, shape: tuple[int, ...], percent: float, times: tuple[float, float], *, rng: np.random.Generator
) -> np.ndarray:
    """Draw events (F, *shape), True in `percent` of all entries, in many short bursts and a few long ones.

    `times` are correlation times, s, mixed half and half. A higher share has all events of a lower one.
    """
    return _lowest(multiscale_noise((len(clip), *shape), clip.fps, list(times), rng=rng), percent)


def _lowest(values: np.ndarray, percent: float) -> np.ndarray:
    """Return True for the lowest values, a percentage of the known ones."""
    known = values[~np.isnan(values)]
    number = round(len(known) * percent / 100)
    return values <= np.partition(known, number - 1)[number - 1] if number else np.zeros(values.shape, bool)


def limb_of_joint(skeleton: Skeleton) -> np.ndarray:
    """Return the number (J,) of the limb of each joint: an arm, a leg, the head, or the trunk, counted from 0."""
    limbs = []
    for joint in (name.rpartition(".")[2] for name in skeleton.joints):
        limb = next((limb for limb, parts in _LIMBS.items() if any(part in joint for part in parts)), "trunk")
        limbs.append(joint[:2] + limb if limb in ("arm", "leg") else limb)
    return np.unique(limbs, return_inverse=True)[1]
