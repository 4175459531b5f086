"""Poses at another frame rate."""

import numpy as np

from dmae.clip import Poses3D


def resample(poses: Poses3D, fps: float, to_fps: float) -> Poses3D:
    """The same motion at another rate, by straight lines between neighbouring frames.

    A joint is there at a time if it is in both frames around it, and takes the weaker source of the two; so has it a
    ray, if both have one of the same camera. Covariances and numbers of views are dropped.
    """
    count = len(poses.xyz)
    time = np.arange(int((count - 1) / fps * to_fps + 1e-6) + 1) * (fps / to_fps)
    first = np.minimum((time + 1e-6).astype(int), count - 1)
    second = np.minimum(first + (time - first > 1e-6), count - 1)
    share = np.where(second > first, time - first, 0)[:, None, None, None]
    xyz = poses.xyz[first] * (1 - share) + poses.xyz[second] * share
    source = np.maximum(poses.source[first], poses.source[second])
    rays = poses.rays[first] * (1 - share[..., None]) + poses.rays[second] * share[..., None]
    same = (poses.rays[first, ..., :1, :] == poses.rays[second, ..., :1, :]).all(-1, keepdims=True)
    rays[..., 1, :] /= np.linalg.norm(rays[..., 1, :], axis=-1, keepdims=True)
    return Poses3D(poses.skeleton, xyz, np.where(np.isnan(xyz).any(-1), 0, source), rays=np.where(same, rays, np.nan))
