"""The heading of bodies: the direction in which they face, an angle about the vertical."""

import numpy as np

from dmae.data.skeleton import Skeleton
from dmae.numerics.interpolation import linear, local_parabola


def body_heading(xyz: np.ndarray, skeleton: Skeleton) -> np.ndarray:
    """Return the heading of bodies (..., J, 3) by their hips and shoulders, (...) rad; NaN where neither pair is known.

    The lines across hips and shoulders count alike, however long they are.
    """
    left = np.zeros((*xyz.shape[:-2], 2))
    for part in ("hip", "shoulder"):
        if {f"l_{part}", f"r_{part}"} <= set(skeleton.joints):
            left_joint, right_joint = skeleton.index(f"l_{part}", f"r_{part}")
            across = xyz[..., left_joint, :2] - xyz[..., right_joint, :2]
            length = np.linalg.norm(across, axis=-1, keepdims=True)
            left += np.where(length > 1e-6, across / np.maximum(length, 1e-6), 0)
    return np.where((left != 0).any(-1), np.arctan2(-left[..., 0], left[..., 1]), np.nan)


def smooth_heading(xyz: np.ndarray, skeleton: Skeleton, frames: float) -> np.ndarray:
    """Return the heading of bodies (F, P, J, 3) interpolated over time and smoothed, (F, P) rad, unwrapped; never NaN.

    It is midway between the heading of the hips and that of the shoulders. Where one of them is hidden, the other and
    the interpolated twist between them stand for it. A body of which neither is ever known has heading 0.

    Args:
        frames: Standard deviation of the smoothing weights.
    """
    hips, shoulders = (_heading_of_pair(xyz, skeleton, joint) for joint in ("l_hip", "l_shoulder"))
    twist = np.angle(np.exp(1j * (hips - shoulders)))
    twist = np.nan_to_num(linear(twist[..., None])[..., 0])
    heading = np.where(np.isnan(shoulders), hips - twist / 2, shoulders + twist / 2)
    # Interpolated as vectors: between two angles there are two ways round.
    direction = linear(np.stack([np.cos(heading), np.sin(heading)], -1))
    heading = np.unwrap(np.nan_to_num(np.arctan2(direction[..., 1], direction[..., 0])), axis=0)
    return local_parabola(heading[..., None], frames)[..., 0]


def rotation_z(angle: np.ndarray) -> np.ndarray:
    """Return the rotations (..., 3, 3) about z by angles (...), rad."""
    cos, sin, zero, one = np.cos(angle), np.sin(angle), np.zeros_like(angle), np.ones_like(angle)
    return np.stack([cos, -sin, zero, sin, cos, zero, zero, zero, one], -1).reshape(*angle.shape, 3, 3)


def rotate_z(xyz: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """Return points (..., 3) rotated about z by angles (...), rad."""
    cos, sin = np.cos(angle), np.sin(angle)
    x, y, z = xyz[..., 0], xyz[..., 1], xyz[..., 2]
    return np.stack([cos * x - sin * y, sin * x + cos * y, z], -1)


def _heading_of_pair(xyz: np.ndarray, skeleton: Skeleton, left_joint: str) -> np.ndarray:
    """Return the heading (F, P) rad by the line from a joint's right-hand partner to it; NaN where unknown.

    In a fused skeleton the joint is that of the first part that has it.
    """
    for left, right in enumerate(skeleton.mirror):
        if skeleton.joints[left].rpartition(".")[2] == left_joint:
            across = xyz[:, :, left] - xyz[:, :, right]
            return np.arctan2(-across[..., 0], across[..., 1])
    return np.full(xyz.shape[:2], np.nan)
