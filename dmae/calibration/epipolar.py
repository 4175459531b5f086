"""Epipolar geometry of two views: fundamental matrices, distances from epipolar lines, closest points of rays.

S sampled frames out of F; D detections per view; J joints; n pairs of views.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from dmae.calibration.hypothesis import Hypothesis
from dmae.data.cameras import CameraRig
from dmae.reconstruction.triangulation import closest_approach


@dataclass(frozen=True)
class ViewSample:
    """Detections of some cameras in S frames.

    Attributes:
        rig: V cameras without distortion.
        xy: (V, S, D, J, 2) undistorted px; NaN where absent.
        joints: (V, S, D, J) True where a joint was detected, even if the lens has no ray for its pixel.
        size: (V, S, D) extent of each detection, px.
    """

    rig: CameraRig
    xy: np.ndarray
    joints: np.ndarray
    size: np.ndarray

    @classmethod
    def of(cls, hypothesis: Hypothesis, frames: np.ndarray, views: list[int] | None = None) -> ViewSample:
        """Return the detections in frames (S,) of all cameras, or of some."""
        views = list(range(len(hypothesis.rig))) if views is None else views
        rig = hypothesis.rig if len(views) == len(hypothesis.rig) else hypothesis.rig[views]
        rows = frames[:, None] - hypothesis.offsets[views]
        inside = (rows >= 0) & (rows < len(hypothesis.xy))
        xy = np.where(inside[..., None, None, None], hypothesis.xy[np.where(inside, rows, 0), views], np.nan)
        joints = np.isfinite(xy[..., 0])
        low, high = (np.where(joints[..., None], xy, limit) for limit in (np.inf, -np.inf))
        size = np.hypot(*np.moveaxis(np.maximum(high.max(3) - low.min(3), 0), -1, 0))
        arrays = (rig.undistort(xy), joints, np.maximum(size, 1))
        return cls(rig.undistorted, *(array.swapaxes(0, 1) for array in arrays))

    @cached_property
    def homogeneous(self) -> np.ndarray:
        """(V, S, D, J, 3) homogeneous pixels, float32."""
        return np.concatenate([self.xy, np.ones_like(self.xy[..., :1])], -1).astype(np.float32)

    def rays(self, view: np.ndarray, frame: np.ndarray, index: np.ndarray) -> np.ndarray:
        """Return unit directions (m, J, 3), world, of detections given by view, frame and index, all (m,)."""
        xy = self.xy[view, frame, index]
        world_from_pixel = np.linalg.inv(self.rig.K @ self.rig.cam_from_world[:, :3, :3])[view]
        rays = xy @ world_from_pixel[:, :, :2].swapaxes(-1, -2) + world_from_pixel[:, None, :, 2]
        return rays / np.linalg.norm(rays, axis=-1, keepdims=True)


def fundamental(rig: CameraRig, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return F (n, 3, 3) of unit norm with x_b^T F x_a = 0 (Hartley & Zisserman, 2nd ed., 9.2) for undistorted px."""
    b_from_a = rig.cam_from_world[b] @ np.linalg.inv(rig.cam_from_world[a])
    x, y, z = b_from_a[:, :3, 3].T
    zero = np.zeros_like(x)
    cross = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], -1).reshape(-1, 3, 3)
    F = np.linalg.inv(rig.K[b]).swapaxes(-1, -2) @ cross @ b_from_a[:, :3, :3] @ np.linalg.inv(rig.K[a])
    return F / np.maximum(np.linalg.norm(F, axis=(-2, -1), keepdims=True), 1e-12)


def epipolar_distances(
    sample_a: ViewSample, sample_b: ViewSample, a: np.ndarray, b: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return px (n, S, D, D, J) from joints in views a to the epipolar lines of joints in views b, and vice versa."""
    F = fundamental(sample_a.rig, a, b).astype(np.float32)[:, None, None]
    xy_a, xy_b = sample_a.homogeneous[a], sample_b.homogeneous[b]
    lines_b, lines_a = xy_a @ F.swapaxes(-1, -2), xy_b @ F
    residual = np.abs(sum(lines_b[:, :, :, None, :, k] * xy_b[:, :, None, :, :, k] for k in range(3)))
    with np.errstate(divide="ignore", invalid="ignore"):
        return (
            residual / np.hypot(lines_a[..., 0], lines_a[..., 1])[:, :, None],
            residual / np.hypot(lines_b[..., 0], lines_b[..., 1])[:, :, :, None],
        )


def intersect(sample_a: ViewSample, sample_b: ViewSample, a, b, frame, i, j) -> tuple[np.ndarray, ...]:
    """Find the closest points of the rays of detections i of views a and j of views b, all (m,).

    Returns:
        rays_a, rays_b: (m, J, 3) unit directions.
        depth_a, depth_b: (m, J) along the rays, in the unit of the rig.
        sine2: (m, J) squared sine of the angle between them.
    """
    centers = sample_a.rig.centers
    rays_a, rays_b = sample_a.rays(a, frame, i), sample_b.rays(b, frame, j)
    return rays_a, rays_b, *closest_approach((centers[b] - centers[a])[:, None], rays_a, rays_b)
