"""Poses over time: fill gaps where the person is present, smooth, and change the frame rate."""

from collections.abc import Callable
from dataclasses import replace
from math import prod

import numpy as np

from dmae.data.clip import Poses3D, Source
from dmae.files.mapped import column_blocks, empty, frame_blocks
from dmae.numerics.body import interpolate_bodies
from dmae.numerics.paths import NEVER, Interpolation, frames_away, local_parabola

LONGEST_ABSENCE = 1.0
"""s; a person without any measurement for longer than this has left, and its joints are not filled."""
LONGEST_HOLD = 0.5
"""s; time before the first and after the last measurement of a joint in which the joint is filled."""

STILLS = 1.0
"""1/s; at a lower rate frames are stills: people have moved on between them, and no frame says anything of another.

Limbs of simulated people, hidden in single frames and completed with the weights for BODY_25: at 1/s the frames around
help (107 mm; 119 without them), at 0.5/s they mislead (143; 84).
"""
_USUAL_RATE = 25.0  # 1/s; rate that methods are told for a frame by itself, which has none
_STILLS_AT_A_TIME = 512  # People of stills that are filled together

_SHORT = 0.4
"""Length of the short of two parabolas that smooth, as a share of the long one."""
_UNKNOWN_SIGMA = 0.02
"""m along an axis, for a body as large as people; error of a joint without a covariance. Captured ones state 0.015."""

_BLOCK_BYTES = 1 << 20  # Bytes of paths that are smoothed at a time. Smoothing needs about thirty times this memory.


def present(poses: Poses3D, fps: float) -> np.ndarray:
    """Return (F, P) True where a person is present: it has a joint, or is in a gap of at most `LONGEST_ABSENCE`."""
    seen = (poses.source != Source.ABSENT).any(-1)
    since, until = frames_away(seen)
    return seen | (since + until - 1 <= LONGEST_ABSENCE * fps)


def are_stills(fps: float) -> bool:
    """Return whether frames at this rate are stills; an impossible rate is none."""
    return 0 < fps < STILLS


STRANGERS = "P1 of one is not P1 of the next"
"""What is to be known of the people of stills."""


def fill_stills(fill: Callable[[Poses3D, float], Poses3D], poses: Poses3D) -> Poses3D:
    """Return poses at a rate below `STILLS` with each person of each frame filled as a recording of one frame."""
    frames, persons = poses.xyz.shape[:2]
    step, made = max(_STILLS_AT_A_TIME // max(persons, 1), 1), []
    for start in range(0, max(frames, 1), step):
        part = poses.select(slice(start, start + step))
        alone = {name: array.reshape(1, -1, *array.shape[2:]) for name, array in part.arrays.items()}
        done = fill(Poses3D(poses.skeleton, **alone), _USUAL_RATE)
        made.append([array.reshape(*part.xyz.shape[:2], *array.shape[2:]) for array in done.arrays.values()])
    return Poses3D(done.skeleton, *map(np.concatenate, zip(*made, strict=True)))


def fill_world(poses: Poses3D, fps: float, through: Interpolation) -> Poses3D:
    """Return the poses with gaps filled by interpolating the path of each joint in the world.

    A gap of a joint is filled, independent of its length, in frames in which its person is `present`. Before its first
    and after its last measurement, a joint is filled for `LONGEST_HOLD`. Filled joints have the source `COMPLETED` and
    0 views. The following is true for all methods of this module: coordinates that are not finite become absent, a
    joint that was never measured stays absent, and poses without persons or frames do not change; ValueError if fps is
    not positive.

    Args:
        through: Function that interpolates (F, ..., 3) with gaps, for example `dmae.numerics.paths.linear`.
    """
    poses = without_infinite(poses, fps)
    return take_estimate(poses, fps, through(poses.xyz.astype(np.float64)))


def fill_body_frame(poses: Poses3D, fps: float, through: Interpolation, by_rays: bool = False) -> Poses3D:
    """Return the poses with gaps filled in the frame of the body, see `interpolate_bodies`.

    With `by_rays`, a joint that only one camera detected is placed on the ray of that detection.
    """
    poses = without_infinite(poses, fps)
    rays = poses.rays if by_rays else None
    bodies = interpolate_bodies(poses.xyz.astype(np.float64), poses.skeleton, fps, through, rays)
    return take_estimate(poses, fps, bodies.filled)


def smooth(poses: Poses3D, fps: float, seconds: float, frames: slice = slice(None)) -> Poses3D:
    """Return some frames smoothed without delay, by parabolas around each frame, fitted with Gaussian weights.

    A long and a short parabola are blended. In fast motion, as of a foot that kicks, the long one cuts the corners: it
    is trusted as far as the two agree within the joint's stated error,

        weight = 1 / (1 + (distance / sigma)^4),

    with sigma the root of the sum of the variances along the axes. So the window adapts to the signal, as in the
    intersection of confidence intervals (Goldenshluger & Nemirovski, Math. Methods Stat. 1997).

    Motion with constant acceleration does not change. Absent joints stay absent and have no weight. Measured joints
    become `DENOISED`. Covariances do not change, so they are upper bounds afterwards. Stills are not smoothed.
    `seconds` is the standard deviation of the weights of the long parabola, 0 for no smoothing; ValueError if it is
    negative or infinite.
    """
    if not 0 <= seconds < np.inf:
        raise ValueError(f"smooth={seconds:g}: expected seconds, 0 (no smoothing) or more")
    given, poses = poses, poses if frames == slice(None) else poses.select(frames)
    if seconds == 0 or are_stills(fps):
        return poses
    smoothed, unknown = empty(poses.xyz.shape, np.float32), 3 * (_UNKNOWN_SIGMA * poses.skeleton.scale) ** 2
    before, after, cov = (
        array.reshape(len(array), prod(array.shape[1:3]), prod(array.shape[3:]))
        for array in (given.xyz, smoothed, poses.cov)
    )
    for columns, paths in column_blocks(before, _BLOCK_BYTES):
        paths = paths.astype(np.float64)
        long, short = (local_parabola(paths, reach * fps, frames) for reach in (seconds, _SHORT * seconds))
        for part in frame_blocks(after):
            variance = cov[part, columns, ::4].sum(-1, dtype=float)
            variance = np.where(np.isnan(variance), unknown, np.maximum(variance, 1e-12))
            apart = short[part] - long[part]
            weight = 1 / (1 + ((apart**2).sum(-1) / variance) ** 2)
            after[part, columns] = short[part] - weight[..., None] * apart
    return replace(poses, xyz=smoothed, source=np.where(poses.source == Source.MEASURED, Source.DENOISED, poses.source))


def without_infinite(poses: Poses3D, fps: float) -> Poses3D:
    """Return the poses with joints made absent if a coordinate is infinite; ValueError if fps is not positive."""
    if not (np.isfinite(fps) and fps > 0):
        raise ValueError(f"fps must be positive, found {fps}")
    return poses.without(np.isinf(poses.xyz).any(-1))


def take_estimate(poses: Poses3D, fps: float, estimate: np.ndarray) -> Poses3D:
    """Return the poses with absent joints filled by an estimate (F, P, J, 3) m, where their person is `present`.

    A joint is filled between two of its measurements, or within `LONGEST_HOLD` of one.
    """
    observed = poses.source != Source.ABSENT
    since, until = frames_away(observed)
    near = (np.maximum(since, until) < NEVER) | (np.minimum(since, until) <= LONGEST_HOLD * fps)
    filled = ~observed & near & present(poses, fps)[..., None] & ~np.isnan(estimate).any(-1)
    return replace(
        poses,
        xyz=np.where(filled[..., None], estimate, poses.xyz),
        source=np.where(filled, Source.COMPLETED, poses.source),
    )


def keep_rejected(filled: Poses3D, given: Poses3D) -> Poses3D:
    """Return filled poses in which completed joints keep the views that measured them: their measurement was rejected.

    `given` are the poses before anything was rejected.
    """
    rejected = (filled.source == Source.COMPLETED) & (given.source != Source.ABSENT)
    return replace(filled, views=np.where(rejected, given.views, filled.views))


def resample(poses: Poses3D, fps: float, to_fps: float) -> Poses3D:
    """Return the same motion at another frame rate, by linear interpolation between neighbouring frames.

    A joint is known at a time if it is known in both frames around that time. It gets the weaker of the two sources. It
    has a ray if both frames have a ray from the same camera. Covariances and numbers of views are dropped.
    """
    count = len(poses.xyz)
    time = np.arange(int((count - 1) / fps * to_fps + 1e-6) + 1 if count else 0) * (fps / to_fps)
    first = np.minimum((time + 1e-6).astype(int), count - 1)
    second = np.minimum(first + (time - first > 1e-6), count - 1)
    weight = np.where(second > first, time - first, 0)[:, None, None, None]
    xyz = poses.xyz[first] * (1 - weight) + poses.xyz[second] * weight
    source = np.maximum(poses.source[first], poses.source[second])
    rays = poses.rays[first] * (1 - weight[..., None]) + poses.rays[second] * weight[..., None]
    same = (poses.rays[first, ..., :1, :] == poses.rays[second, ..., :1, :]).all(-1, keepdims=True)
    rays[..., 1, :] /= np.linalg.norm(rays[..., 1, :], axis=-1, keepdims=True)
    return Poses3D(poses.skeleton, xyz, np.where(np.isnan(xyz).any(-1), 0, source), rays=np.where(same, rays, np.nan))
