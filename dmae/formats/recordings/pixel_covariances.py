"""Covariances of projected joints, px^2: the uncertainty of poses for files that contain pixel coordinates."""

import numpy as np

from dmae.data.cameras import CameraRig
from dmae.data.clip import Poses3D

_STEP_M = 1e-4


def pixel_covariances(poses: Poses3D, rig: CameraRig) -> np.ndarray | None:
    """Return the covariances (F, V, P, J, 3) px^2 of projected joints, to first order: xx, xy, yy.

    NaN where unknown. None if the covariances of all joints are unknown.
    """
    if not np.isfinite(poses.cov).any():
        return None
    xyz, cov = poses.xyz.astype(np.float64), poses.cov.astype(np.float64)
    steps = [rig.project(xyz + sign * _STEP_M * axis)[0] for axis in np.eye(3) for sign in (1, -1)]
    by_xyz = np.stack(
        [(ahead - behind) / (2 * _STEP_M) for ahead, behind in zip(steps[::2], steps[1::2], strict=True)], -1
    )
    found = by_xyz @ cov[:, None] @ by_xyz.swapaxes(-1, -2)
    return np.stack([found[..., 0, 0], found[..., 0, 1], found[..., 1, 1]], -1)


def covariance_entry(covariance: np.ndarray) -> list[list[float] | None]:
    """Return covariances (J, 3) px^2 as lists for JSON, rounded to 0.0001; None for joints where unknown."""
    known = np.isfinite(covariance).all(-1)
    return [row if there else None for row, there in zip(covariance.round(4).tolist(), known, strict=True)]
