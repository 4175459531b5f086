"""The heading of bodies: the direction that they face, as an angle about the vertical axis."""

import numpy as np
from scipy.spatial.transform import Rotation

from dmae.data.skeleton import Skeleton
from dmae.numerics.interpolation import linear, local_parabola
from dmae.numerics.robust import median_over_frames

_MIN_POINTS, _MIN_EXTENT = 3, 0.02
"""Smallest number of points that determine a rotation, and smallest squared extent of the points across their longest
direction, as a share of the squared extent along it."""


def body_heading(xyz: np.ndarray, skeleton: Skeleton) -> np.ndarray:
    """Return the heading of bodies (..., J, 3) from hips and shoulders, (...) rad; NaN where neither pair is known.

    The line between the hips and the line between the shoulders have equal weights, independent of their lengths.
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
    """Return the heading of bodies, interpolated over time and smoothed, (F, P) rad, unwrapped; never NaN.

    The heading is midway between the heading of the hips and the heading of the shoulders. Where one of the two is
    unknown, it is computed from the other and from the interpolated twist between them. If neither is known in any
    frame, the heading is 0.

    Args:
        xyz: (F, P, J, 3) m; NaN where unknown.
        skeleton: Skeleton of the J joints.
        frames: Standard deviation of the smoothing weights, frames.
    """
    hips, shoulders = (_heading_of_pair(xyz, skeleton, joint) for joint in ("l_hip", "l_shoulder"))
    twist = np.angle(np.exp(1j * (hips - shoulders)))
    twist = np.nan_to_num(linear(twist[..., None])[..., 0])
    heading = np.where(np.isnan(shoulders), hips - twist / 2, shoulders + twist / 2)
    # Interpolate unit vectors instead of angles, because angles can be interpolated in two directions.
    direction = linear(np.stack([np.cos(heading), np.sin(heading)], -1))
    heading = np.unwrap(np.nan_to_num(np.arctan2(direction[..., 1], direction[..., 0])), axis=0)
    return local_parabola(heading[..., None], frames)[..., 0]


def body_rotations(xyz: np.ndarray, skeleton: Skeleton, frames: float) -> np.ndarray:
    """Return the rotations of bodies in the world, (F, P, 3, 3), from their heading or from their torso.

    The torso is used for your own skeletons, if they define a torso or have neither hips nor shoulders. The rotation is
    then the one that brings the usual shape of the torso nearest to its joints (Kabsch 1976), in frames with at least
    three known joints of the torso, and is interpolated in the others. Without any such frame it is the identity.

    Args:
        xyz: (F, P, J, 3) m; NaN where unknown.
        skeleton: Skeleton of the J joints.
        frames: As in `smooth_heading`. Rotations of the torso are smoothed with a quarter of it.
    """
    pairs = [{f"l_{part}", f"r_{part}"} for part in ("hip", "shoulder")]
    if not skeleton.defined or (skeleton.torso is None and any(pair <= set(skeleton.joints) for pair in pairs)):
        return rotation_z(smooth_heading(xyz, skeleton, frames))
    turned = np.broadcast_to(np.eye(3), (*xyz.shape[:2], 3, 3)).copy()
    for person in range(xyz.shape[1]):
        found = _torso_rotations(xyz[:, person][:, list(skeleton.trunk)])
        known = np.flatnonzero(~np.isnan(found).any((1, 2)))
        if len(known):
            quaternion = np.full((len(xyz), 4), np.nan)
            quaternion[known] = Rotation.from_matrix(found[known]).as_quat()
            # A quaternion and its negative are the same rotation: choose signs that make neighbours similar.
            signs = np.sign((quaternion[known[1:]] * quaternion[known[:-1]]).sum(-1))
            quaternion[known[1:]] *= np.cumprod(np.where(signs == 0, 1, signs))[:, None]
            turned[:, person] = Rotation.from_quat(local_parabola(linear(quaternion), frames / 4)).as_matrix()
    return turned


def _torso_rotations(points: np.ndarray) -> np.ndarray:
    """Return the rotations (F, 3, 3) from the usual shape of n points to the points (F, n, 3); NaN where unknown."""
    known = ~np.isnan(points).any(-1)
    if not len(points) or known.sum(1).max() < _MIN_POINTS:
        return np.full((len(points), 3, 3), np.nan)
    reference = points[known.sum(1).argmax()]
    found = _fitted(points, reference)
    # Fit again, with the median shape over all frames.
    middle = np.where(known[..., None], points, 0).sum(1) / np.maximum(known.sum(1), 1)[:, None]
    shapes = np.einsum("fji,fnj->fni", found, points - middle[:, None])
    complete = known.sum(1) == known.any(0).sum()
    usual = median_over_frames(shapes[complete]) if complete.any() else reference
    return _fitted(points, usual)


def _fitted(points: np.ndarray, reference: np.ndarray) -> np.ndarray:
    """Return the rotations (F, 3, 3) that bring `reference` (n, 3) nearest to `points` (F, n, 3); NaN where unknown."""
    both = (~np.isnan(points).any(-1) & ~np.isnan(reference).any(-1))[..., None]
    count = np.maximum(both.sum(1), 1)
    there, here = np.where(both, points, 0), np.where(both, reference, 0)
    there = np.where(both, there - (there.sum(1) / count)[:, None], 0)
    here = np.where(both, here - (here.sum(1) / count)[:, None], 0)
    left, sizes, right = np.linalg.svd(np.einsum("fni,fnj->fij", there, here))
    sign = np.sign(np.linalg.det(left @ right))
    left[..., 2] *= sign[:, None]
    determined = (both.sum((1, 2)) >= _MIN_POINTS) & (sizes[:, 1] > _MIN_EXTENT * sizes[:, 0])
    return np.where(determined[:, None, None], left @ right, np.nan)


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
    """Return the heading (F, P) rad from the line between a left joint and the same joint on the right.

    NaN where unknown. In a fused skeleton, the joint of the first part that contains it is used.
    """
    for left, right in enumerate(skeleton.mirror):
        if skeleton.joints[left].rpartition(".")[2] == left_joint:
            across = xyz[:, :, left] - xyz[:, :, right]
            return np.arctan2(-across[..., 0], across[..., 1])
    return np.full(xyz.shape[:2], np.nan)
