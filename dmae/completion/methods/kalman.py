"""A Kalman smoother of each joint's path through the world: fills and denoises, with covariances."""

from dataclasses import replace

import numpy as np

from dmae.completion.methods.registry import completion_method
from dmae.data.clip import Poses3D, Source
from dmae.data.skeleton import Skeleton
from dmae.numerics.filling import take_estimate, without_infinite
from dmae.numerics.kalman import smooth_paths

UNKNOWN_DEVIATION = 0.02
"""m along each axis; assumed of measured joints without a covariance."""

_LIMB = ("elbow", "wrist", "knee", "ankle", "heel", "toe")


@completion_method("kalman")
def fill_kalman(poses: Poses3D, fps: float) -> Poses3D:
    """A Kalman smoother of each joint, which denoises measured joints too.

    See `dmae.numerics.kalman`. Measured joints are moved to their smoothed path and become `DENOISED`. All joints have
    the covariance that follows from those of the measurements; where a measurement has none it is `UNKNOWN_DEVIATION`
    squared.
    """
    poses = without_infinite(poses, fps)
    frames, persons, joints = poses.source.shape
    known = np.isfinite(poses.cov).all((-1, -2))
    cov = np.where(known[..., None, None], poses.cov, UNKNOWN_DEVIATION**2 * np.eye(3)).astype(np.float64)
    # Measurements are never exact, and rounding must not make a covariance singular.
    cov = cov + 1e-6 * np.eye(3)
    xyz, spread = smooth_paths(
        poses.xyz.astype(np.float64).reshape(frames, persons * joints, 3),
        cov.reshape(frames, persons * joints, 3, 3),
        fps,
        np.tile(_acceleration_density(poses.skeleton), persons),
    )
    filled = take_estimate(poses, fps, xyz.reshape(poses.xyz.shape))
    known = (filled.source != Source.ABSENT)[..., None]
    return replace(
        filled,
        xyz=np.where(known, xyz.reshape(poses.xyz.shape), np.nan),
        source=np.where(filled.source == Source.MEASURED, Source.DENOISED, filled.source),
        cov=np.where(known[..., None], spread.reshape(poses.cov.shape), np.nan),
    )


def _acceleration_density(skeleton: Skeleton) -> np.ndarray:
    """Return spectral densities of acceleration, (J,) m^2/s^3, with which simulated people are followed best."""
    if skeleton.defined:
        # In a world in which the body is as large as a person, its accelerations are not those of people.
        limbs = np.isin(np.arange(len(skeleton)), skeleton.trunk, invert=True)
        return np.where(limbs, 10.0, 1.0) / skeleton.scale**2
    return np.array([10.0 if joint.endswith(_LIMB) else 1.0 for joint in skeleton.joints])
