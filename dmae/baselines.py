"""Filling what no camera measured without learning: the methods a learned completion has to beat."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np

from dmae import bodyframe
from dmae.clip import Poses3D, Source
from dmae.gaps import neighbours
from dmae.kalman import smooth_paths
from dmae.rejection import contradicted
from dmae.series import Interpolation, hold, linear, local_parabola, pchip
from dmae.skeleton import Skeleton

LONGEST_ABSENCE = 1.0
"""s; a person of whom nothing was measured for longer is taken to have left, and is not invented."""

LONGEST_HOLD = 0.5
"""s; how long a joint stays as first or last measured before its first and after its last measurement."""

UNKNOWN_DEVIATION = 0.02
"""m along each axis; how well a joint is taken to be measured whose covariance is not known."""

_LIMB = ("elbow", "wrist", "knee", "ankle", "heel", "toe")


def present(poses: Poses3D, fps: float) -> np.ndarray:
    """(F, P) True where a person is there: measured, or missing for at most `LONGEST_ABSENCE` between sightings."""
    seen = (poses.source != Source.ABSENT).any(-1)
    before, after = neighbours(seen)
    inside = (before >= 0) & (after < len(seen))
    return seen | (inside & (after - before - 1 <= LONGEST_ABSENCE * fps))


def fill(poses: Poses3D, fps: float, through: Interpolation) -> Poses3D:
    """Fill by interpolating each joint's path through the world.

    However long a joint is hidden, its gap is filled while its person is `present`; before its first
    and after its last measurement it is held for `LONGEST_HOLD`. What is filled is `COMPLETED` and used no
    views. This, and what follows, holds for every method of this module: coordinates that are not finite are
    absent; a joint never measured stays so; without persons, or frames, there is nothing to do.

    Args:
        fps: Frames per second of the poses.
        through: How (F, ..., 3) with holes is interpolated, as `dmae.series.linear`.

    Raises:
        ValueError: fps is not positive.
    """
    poses = _sound(poses, fps)
    return _take(poses, fps, through(poses.xyz.astype(np.float64)))


def fill_body(
    poses: Poses3D, fps: float, through: Interpolation, by_rays: bool = False, recalling: bool = False
) -> Poses3D:
    """Fill by interpolating offsets between joints in a frame that turns with the body, see `dmae.bodyframe`.

    Args:
        by_rays: Put joints that a single camera saw on its ray.
        recalling: Place limbs as the person held them when the rest of the body was alike, see `dmae.recall`.
    """
    poses = _sound(poses, fps)
    rays = poses.rays if by_rays else None
    xyz = poses.xyz.astype(np.float64)
    return _take(poses, fps, bodyframe.interpolate(xyz, poses.skeleton, fps, through, rays, recalling))


fill_hold = partial(fill, through=hold)
fill_linear = partial(fill, through=linear)
fill_pchip = partial(fill, through=pchip)
fill_linear_body = partial(fill_body, through=linear)
fill_pchip_body = partial(fill_body, through=pchip)
fill_rays = partial(fill_body, through=pchip, by_rays=True)
fill_recall = partial(fill_body, through=pchip, by_rays=True, recalling=True)


def fill_kalman(poses: Poses3D, fps: float) -> Poses3D:
    """Fill and denoise by a Kalman smoother of each joint's path through the world, see `dmae.kalman`.

    Measured joints are moved to where their path has them and become `DENOISED`. All joints have the covariance
    that follows from those of the measurements; of joints of unknown covariance it is `UNKNOWN_DEVIATION` squared.
    """
    poses = _sound(poses, fps)
    frames, persons, joints = poses.source.shape
    known = np.isfinite(poses.cov).all((-1, -2))
    cov = np.where(known[..., None, None], poses.cov, UNKNOWN_DEVIATION**2 * np.eye(3)).astype(np.float64)
    # Measurements are never exact, and rounding must not make a covariance singular.
    cov = cov + 1e-6 * np.eye(3)
    xyz, spread = smooth_paths(
        poses.xyz.astype(np.float64).reshape(frames, persons * joints, 3),
        cov.reshape(frames, persons * joints, 3, 3),
        fps,
        np.tile(_agility(poses.skeleton), persons),
    )
    filled = _take(poses, fps, xyz.reshape(poses.xyz.shape))
    there = filled.source != Source.ABSENT
    moved = there[..., None]
    return replace(
        filled,
        xyz=np.where(moved, xyz.reshape(poses.xyz.shape), np.nan),
        source=np.where(filled.source == Source.MEASURED, Source.DENOISED, filled.source),
        cov=np.where(moved[..., None], spread.reshape(poses.cov.shape), np.nan),
    )


def reject(poses: Poses3D, fps: float) -> Poses3D:
    """The poses less those measured joints that the frames around contradict (`dmae.rejection`)."""
    poses = _sound(poses, fps)
    return poses.without(poses.measured & contradicted(poses.xyz, fps))


def fill_reject_pchip(poses: Poses3D, fps: float) -> Poses3D:
    """`reject`, then fill as `pchip_body`. What was rejected and filled again is `COMPLETED`."""
    return fill_pchip_body(reject(poses, fps), fps)


def fill_reject_recall(poses: Poses3D, fps: float) -> Poses3D:
    """`reject`, then fill as `recall`."""
    return fill_recall(reject(poses, fps), fps)


def smooth(poses: Poses3D, fps: float, seconds: float) -> Poses3D:
    """Light smoothing without delay: at each frame the parabola that fits best around it, Gaussian weights.

    Motion at constant acceleration passes unchanged; absent joints stay absent and have no weight.
    Measured joints become `DENOISED`; covariances stay as they were, now upper bounds.

    Args:
        fps: Frames per second of the poses.
        seconds: Standard deviation of the weights; 0 leaves the poses as they are.
    """
    if seconds == 0:
        return poses
    return replace(
        poses,
        xyz=local_parabola(poses.xyz.astype(np.float64), seconds * fps),
        source=np.where(poses.source == Source.MEASURED, Source.DENOISED, poses.source),
    )


def _sound(poses: Poses3D, fps: float) -> Poses3D:
    """The poses less what is not finite."""
    if not (np.isfinite(fps) and fps > 0):
        raise ValueError(f"fps must be positive, found {fps}")
    return poses.without(np.isinf(poses.xyz).any(-1))


def _take(poses: Poses3D, fps: float, estimate: np.ndarray) -> Poses3D:
    """Take an estimate (F, P, J, 3) where a joint is absent, its person present, and a measurement near enough."""
    observed = poses.source != Source.ABSENT
    before, after = neighbours(observed)
    inside = (before >= 0) & (after < len(observed))
    index = np.arange(len(observed))[:, None, None]
    since = np.where(before >= 0, index - before, len(observed))
    until = np.where(after < len(observed), after - index, len(observed))
    held = (before >= 0) ^ (after < len(observed))
    near = inside | (held & (np.minimum(since, until) <= LONGEST_HOLD * fps))
    filled = ~observed & near & present(poses, fps)[..., None] & ~np.isnan(estimate).any(-1)
    return replace(
        poses,
        xyz=np.where(filled[..., None], estimate, poses.xyz),
        source=np.where(filled, Source.COMPLETED, poses.source),
    )


def _agility(skeleton: Skeleton) -> np.ndarray:
    """(J,) m^2/s^3, spectral densities of acceleration: those with which simulated people are followed best."""
    return np.array([10.0 if joint.endswith(_LIMB) else 1.0 for joint in skeleton.joints])


METHODS: dict[str, Callable[[Poses3D, float], Poses3D]] = {
    "measured": lambda poses, fps: poses,
    "hold": fill_hold,
    "linear": fill_linear,
    "pchip": fill_pchip,
    "linear_body": fill_linear_body,
    "pchip_body": fill_pchip_body,
    "rays": fill_rays,
    "recall": fill_recall,
    "kalman": fill_kalman,
    "reject_pchip": fill_reject_pchip,
    "reject_recall": fill_reject_recall,
}
"""What is done about joints that no camera measured, by name; each takes poses and frames per second."""
