"""Copies of a clip's own people, moved in the world and in time."""

import numpy as np

from dmae.data.clip import Clip
from dmae.evaluation.corruption.bodies import clearance, clearance_of_others
from dmae.evaluation.corruption.detections import heights, redetected
from dmae.evaluation.corruption.people import by_detection, detections_of_people, pixels_of_people


def companion(people: np.ndarray, person: int, distance: float, angle: np.ndarray | float, delay: int) -> np.ndarray:
    """Return a copy (F, J, 3) of a person, at a constant distance from that person.

    Args:
        people: (F, P, J, 3) m, world, z up.
        person: Index of the copied person.
        distance: m, horizontal distance between the middles of both bodies.
        angle: rad, direction of the copy from the person, (F,) or constant.
        delay: Frames by which the copy is delayed; at the ends of the clip its motion is reversed.
    """
    copy = people[delayed(len(people), delay), person]
    to = np.stack([np.cos(angle), np.sin(angle)], -1) * distance
    copy = copy.copy()
    copy[..., :2] += (_middle(people[:, person]) - _middle(copy) + to)[:, None]
    return copy


def delayed(frames: int, delay: int) -> np.ndarray:
    """Return for each of F frames the index of the frame `delay` earlier, reflected at the ends."""
    period = max(2 * (frames - 1), 1)
    index = (np.arange(frames) - delay) % period
    return np.minimum(index, period - index)


def with_companions(clip: Clip, bodies: np.ndarray, copied: list[int], delays: list[int]) -> Clip:
    """Return the clip with detections of additional people, which hide others and are hidden by them.

    A joint of a copy is detected as the same joint of the copied person at the copied time: with the same error, in
    proportion to the height in the image, and the same confidence, or not at all. Joints behind any other body
    or outside the image are not detected.

    Args:
        bodies: (F, B, J, 3) the copies, m.
        copied: (B,) index of the person that each body copies.
        delays: (B,) frames by which each body is delayed.
    """
    rig, skeleton = clip.true_rig or clip.rig, clip.poses.skeleton
    people, count = clip.poses.xyz.astype(np.float64), clip.poses.xyz.shape[1]
    everyone = np.concatenate([people, bodies], 1)
    hidden = clearance_of_others(rig.centers, everyone, skeleton)[:, :, count:] < 0
    newly = by_detection(clip, clearance(rig.centers, people, bodies, skeleton) < 0, False)
    error, score = _errors(clip)
    pixels = rig.project(bodies)[0]
    frames = np.stack([delayed(len(clip), delay) for delay in delays], 1)  # (F, B)
    error, score = (np.stack([e[frames[:, b], :, p] for b, p in enumerate(copied)], 2) for e in (error, score))
    pixels = pixels + error * heights(pixels)[..., None, None]
    score = np.where(hidden | ~rig.inside(pixels), np.nan, score)
    found = clip.detections
    kept = np.where(newly, np.nan, found.score)
    return redetected(clip, np.concatenate([found.xy, pixels], 2), np.concatenate([kept, score], 2))


def _errors(clip: Clip) -> tuple[np.ndarray, np.ndarray]:
    """Return the errors (F, V, P, J, 2) of the detections of people, in their heights, and confidences (F, V, P, J)."""
    shown, pixels = detections_of_people(clip), pixels_of_people(clip)
    taken = np.maximum(shown, 0)
    if not clip.detections.score.shape[2]:
        return np.full(pixels.shape, np.nan), np.full(pixels.shape[:-1], np.nan)
    xy = np.take_along_axis(clip.detections.xy, taken[..., None, None], 2)
    score = np.take_along_axis(clip.detections.score, taken[..., None], 2)
    height = heights(pixels)
    error = (xy - pixels) / np.where(height > 0, height, np.nan)[..., None, None]
    return error, np.where((shown < 0)[..., None], np.nan, score)


def _middle(body: np.ndarray) -> np.ndarray:
    """Return the middle (F, 2) of the box around a body (F, J, 3), seen from above, m; NaN where it is absent."""
    known = ~np.isnan(body[..., :2])
    low = np.where(known, body[..., :2], np.inf).min(1)
    high = np.where(known, body[..., :2], -np.inf).max(1)
    return np.where(known.any(1), (np.where(known.any(1), low, 0) + np.where(known.any(1), high, 0)) / 2, np.nan)
