"""Poses with their gaps filled: an interpolated estimate, used where a person is present."""

from dataclasses import replace
from math import prod

import numpy as np

from dmae.data.clip import Poses3D, Source
from dmae.files.mapped import column_blocks, empty, frame_blocks
from dmae.numerics import body_frame
from dmae.numerics.gaps import neighbours
from dmae.numerics.interpolation import Interpolation, local_parabola

LONGEST_ABSENCE = 1.0
"""s; a person without any measurement for longer has left, and is not filled."""

LONGEST_HOLD = 0.5
"""s; how long a joint stays as first or last measured before its first and after its last measurement."""

_PATHS = 1 << 20
"""Bytes of paths that are smoothed at a time, which takes some thirty times as many."""


def present(poses: Poses3D, fps: float) -> np.ndarray:
    """Return (F, P) True where a person is present: has a joint, or has none for at most `LONGEST_ABSENCE`."""
    seen = (poses.source != Source.ABSENT).any(-1)
    before, after = neighbours(seen)
    inside = (before >= 0) & (after < len(seen))
    return seen | (inside & (after - before - 1 <= LONGEST_ABSENCE * fps))


def fill_world(poses: Poses3D, fps: float, through: Interpolation) -> Poses3D:
    """Fill by interpolating each joint's path through the world.

    A gap is filled, however long, while its person is `present`. Before its first and after its last measurement a
    joint is held for `LONGEST_HOLD`. What is filled is `COMPLETED` and used no views. This holds for every method of
    this module: coordinates that are not finite are absent; a joint never measured stays absent; poses without
    persons or frames stay as they are.

    Args:
        fps: Frames per second of the poses.
        through: How (F, ..., 3) with gaps is interpolated, such as `dmae.numerics.interpolation.linear`.

    Raises:
        ValueError: fps is not positive.
    """
    poses = without_infinite(poses, fps)
    return take_estimate(poses, fps, through(poses.xyz.astype(np.float64)))


def fill_body_frame(poses: Poses3D, fps: float, through: Interpolation, by_rays: bool = False) -> Poses3D:
    """Fill by interpolating offsets between joints in a frame that turns with the body, see `dmae.numerics.body_frame`.

    Args:
        by_rays: Place joints that a single camera detected on the ray of that detection.
    """
    poses = without_infinite(poses, fps)
    rays = poses.rays if by_rays else None
    bodies = body_frame.interpolate(poses.xyz.astype(np.float64), poses.skeleton, fps, through, rays)
    return take_estimate(poses, fps, bodies.filled)


def smooth(poses: Poses3D, fps: float, seconds: float, frames: slice = slice(None)) -> Poses3D:
    """Smooth lightly and without delay: fit a parabola around each frame, with Gaussian weights.

    Motion at constant acceleration passes unchanged; absent joints stay absent and have no weight.
    Measured joints become `DENOISED`; covariances stay as they were, now upper bounds.

    Args:
        fps: Frames per second of the poses.
        seconds: Standard deviation of the weights; 0 leaves the poses as they are.
        frames: Those that are smoothed and returned, by the frames around.

    Raises:
        ValueError: a negative or infinite number of seconds.
    """
    if not 0 <= seconds < np.inf:
        raise ValueError(f"smooth={seconds:g}: expected seconds, 0 (no smoothing) or more")
    given, poses = poses, poses if frames == slice(None) else poses.select(frames)
    if seconds == 0:
        return poses
    smoothed = empty(poses.xyz.shape, np.float32)
    before, after = (xyz.reshape(len(xyz), prod(xyz.shape[1:-1]), 3) for xyz in (given.xyz, smoothed))
    for columns, paths in column_blocks(before, _PATHS):
        paths = local_parabola(paths.astype(np.float64), seconds * fps, frames)
        for part in frame_blocks(after):
            after[part, columns] = paths[part]
    return replace(
        poses,
        xyz=smoothed,
        source=np.where(poses.source == Source.MEASURED, Source.DENOISED, poses.source),
    )


def without_infinite(poses: Poses3D, fps: float) -> Poses3D:
    """Return the poses without joints that are not finite.

    Raises:
        ValueError: fps is not positive.
    """
    if not (np.isfinite(fps) and fps > 0):
        raise ValueError(f"fps must be positive, found {fps}")
    return poses.without(np.isinf(poses.xyz).any(-1))


def take_estimate(poses: Poses3D, fps: float, estimate: np.ndarray) -> Poses3D:
    """Use an estimate (F, P, J, 3) where a joint is absent, its person present, and a measurement close in time."""
    observed = poses.source != Source.ABSENT
    before, after = neighbours(observed)
    inside = (before >= 0) & (after < len(observed))
    index = np.arange(len(observed))[:, None, None]
    since = np.where(before >= 0, index - before, len(observed))
    until = np.where(after < len(observed), after - index, len(observed))
    at_one_end = (before >= 0) ^ (after < len(observed))
    near = inside | (at_one_end & (np.minimum(since, until) <= LONGEST_HOLD * fps))
    filled = ~observed & near & present(poses, fps)[..., None] & ~np.isnan(estimate).any(-1)
    return replace(
        poses,
        xyz=np.where(filled[..., None], estimate, poses.xyz),
        source=np.where(filled, Source.COMPLETED, poses.source),
    )
