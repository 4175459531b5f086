"""Bodies that are larger or smaller than people: capture in a world in which they are as large as people."""

from collections.abc import Callable
from dataclasses import replace
from itertools import combinations, product

import numpy as np

from dmae.data.clip import Clip, Detections2D, Poses3D
from dmae.data.conversion import SIZE_QUANTILE, extent, resized_poses, resized_rig
from dmae.numerics.statistics import evenly_spaced
from dmae.reconstruction.config import CaptureConfig
from dmae.reconstruction.triangulation import closest_approach

_FRAMES, _PAIRS, _DETECTIONS = 40, 10, 8
"""Largest numbers of frames, of pairs of cameras per frame, and of detections per camera that measure bodies."""
_GAP = 0.05
"""Largest median distance between the rays of two cameras to the joints of one body, as a share of its extent."""
_WHOLE = 0.6  # Smallest share of the joints that two cameras must have in common


def in_units_of_people(steps: Callable[[Clip, CaptureConfig], Poses3D], clip: Clip, config: CaptureConfig) -> Poses3D:
    """Run steps of capture in a world in which bodies are as large as people; return their result in the clip's world.

    Raises as `as_people`.
    """
    clip, config, scale = as_people(clip, config)
    poses = steps(clip, config)
    return poses if scale == 1 else resized_poses(poses, scale)


def as_people(clip: Clip, config: CaptureConfig) -> tuple[Clip, CaptureConfig, float]:
    """Return clip and configuration in a world in which bodies are as large as people, and the scale of that world.

    The size of bodies is measured if the skeleton states none. Only cameras and detections of the clip are resized;
    people's own clips are returned as they are.

    Raises ValueError if the skeleton states no size, and the detections do not determine it.
    """
    found, skeleton = clip.detections, clip.detections.skeleton
    if skeleton.size_m is None:
        size = measured_size(clip, config.th_p)
        if size is None:
            raise ValueError(
                f"clip {clip.id!r}: no two cameras show the size of a {skeleton.name!r}; state size_m in its file, the "
                "usual distance between its two joints farthest apart, m, or check the cameras with dmae doctor"
            )
        skeleton = replace(skeleton, size_m=size)
    scale = skeleton.scale
    if scale == 1:
        return clip, config, scale
    rig, detections = resized_rig(clip.rig, 1 / scale), Detections2D(skeleton, found.xy, found.score)
    resized = Clip(clip.id, clip.fps, rig, detections, images=clip.images, provenance=clip.provenance)
    return resized, resized_config(config, 1 / scale), scale


def resized_config(config: CaptureConfig, factor: float) -> CaptureConfig:
    """Return the configuration for a world `factor` times as large: places are scaled, lengths on the body are not."""
    subject = config.subject
    if subject.at is not None and subject.camera is None:
        subject = replace(subject, at=[subject.at[0], *(factor * value for value in subject.at[1:])])
    if subject.leg_m is not None:
        subject = replace(subject, leg_m=[factor * value for value in subject.leg_m])
    volume = None if config.volume is None else [factor * value for value in config.volume]
    return replace(config, subject=subject, volume=volume)


def measured_size(clip: Clip, th_p: float) -> float | None:
    """Return the usual distance between the two joints farthest apart, m; None if no two cameras show it.

    In some frames each detection of a camera is compared with the detections of another. The rays to the joints of one
    body nearly meet, and the points where they meet give its extent.
    """
    xy = np.where((clip.detections.score >= th_p)[..., None], clip.detections.xy, np.nan).astype(np.float64)
    enough = (np.isfinite(xy[..., 0]).sum(-1) >= max(2, _WHOLE * xy.shape[-2])).any(-1)
    frames = np.flatnonzero(enough.sum(1) >= 2)
    frames = frames[evenly_spaced(len(frames), _FRAMES)]
    rays, centers, sizes = clip.rig.rays(xy[frames]), clip.rig.centers, []
    for directions, shown in zip(rays, enough[frames], strict=True):
        for a, b in list(combinations(np.flatnonzero(shown), 2))[:_PAIRS]:
            sizes += _sizes(directions[a], directions[b], centers[a], centers[b])
    return float(np.quantile(sizes, SIZE_QUANTILE)) if sizes else None


def _sizes(one: np.ndarray, other: np.ndarray, start: np.ndarray, end: np.ndarray) -> list[float]:
    """Return the extents of bodies that two cameras show, by rays (D, J, 3) to D detections of J joints."""
    found = []
    for first, second in product(one[:_DETECTIONS], other[:_DETECTIONS]):
        both = np.isfinite(first[:, 0]) & np.isfinite(second[:, 0])
        if both.sum() < max(2, _WHOLE * len(both)):
            continue
        a, b = first[both], second[both]
        along_a, along_b, _ = closest_approach(end - start, a, b)
        on_a, on_b = start + along_a[:, None] * a, end + along_b[:, None] * b
        size = extent((on_a + on_b) / 2)
        if min(along_a.min(), along_b.min()) > 0 and np.median(np.linalg.norm(on_a - on_b, axis=-1)) < _GAP * size:
            found.append(size)
    return found
