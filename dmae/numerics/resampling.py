"""Poses at another frame rate."""

import numpy as np

from dmae.data.clip import Poses3D


def resample(poses: Poses3D, fps: float, to_fps: float) -> Poses3D:
    """Return the same motion at another frame rate, by linear interpolation between neighbouring frames.

    A joint is known at a time if it is known in both frames around that time. It gets the weaker of the two sources. It
    has a ray if both frames have a ray from the same camera. Covariances and numbers of views are dropped.

    Args:
        poses: Poses at `fps`.
        fps: Frames per second of `poses`.
        to_fps: Frames per second of the result.
    """
    count = len(poses.xyz)
    time = np.arange(int((count - 1) / fps * to_fps + 1e-6) + 1) * (fps / to_fps)
    first = np.minimum((time + 1e-6).astype(int), count - 1)
    second = np.minimum(first + (time - first > 1e-6), count - 1)
    weight = np.where(second > first, time - first, 0)[:, None, None, None]
    xyz = poses.xyz[first] * (1 - weight) + poses.xyz[second] * weight
    source = np.maximum(poses.source[first], poses.source[second])
    rays = poses.rays[first] * (1 - weight[..., None]) + poses.rays[second] * weight[..., None]
    same = (poses.rays[first, ..., :1, :] == poses.rays[second, ..., :1, :]).all(-1, keepdims=True)
    rays[..., 1, :] /= np.linalg.norm(rays[..., 1, :], axis=-1, keepdims=True)
    return Poses3D(poses.skeleton, xyz, np.where(np.isnan(xyz).any(-1), 0, source), rays=np.where(same, rays, np.nan))
