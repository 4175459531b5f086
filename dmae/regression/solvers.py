"""Examples of solvers: `dmae regress solver=dmae.regression.solvers:ours`, `:dlt`, `:opencv`.

Each takes the arrays of a rig and of n points, and returns (n, 3) points in metres, NaN where it refuses.
"""

import cv2
import numpy as np

from dmae.data.cameras import CameraRig
from dmae.reconstruction.triangulation import triangulate


def ours(*, K, dist, cam_from_world, size, xy, confidence) -> np.ndarray:
    """Triangulate by `dmae.reconstruction.triangulation`: robust, weighted by confidence, with every view."""
    rig = CameraRig(tuple(map(str, range(len(K)))), K, dist, cam_from_world, size)
    return triangulate(rig, rig.undistort(xy), confidence).xyz


def dlt(*, K, dist, cam_from_world, size, xy, confidence) -> np.ndarray:
    """Triangulate linearly (Hartley & Zisserman, 2nd ed., 12.2) from all views with equal weights.

    It fails on gross errors, on points that would lie behind the cameras, and far from the origin of the world.
    """
    xy, P = _undistort(K, dist, _rated(xy, confidence)), K @ cam_from_world[:, :3]
    rows = xy[..., None] * P[:, None, 2] - P[:, :2]
    observed = np.isfinite(xy)
    rows = np.where(observed[..., None], rows, 0).reshape(len(xy), -1, 4)
    homogeneous = np.linalg.svd(rows)[2][:, -1]
    return np.where(observed[..., 0].sum(-1)[:, None] >= 2, homogeneous[:, :3] / homogeneous[:, 3:], np.nan)


def opencv(*, K, dist, cam_from_world, size, xy, confidence) -> np.ndarray:
    """Triangulate by `cv2.triangulatePoints` from the first two views that saw the point. It fails as `dlt` does."""
    xy, P = _undistort(K, dist, _rated(xy, confidence)), K @ cam_from_world[:, :3]
    observed = np.isfinite(xy[..., 0])
    pairs = np.argsort(~observed, axis=-1, kind="stable")[:, :2]
    xyz = np.full((len(xy), 3), np.nan)
    for a, b in np.unique(pairs, axis=0):
        some = np.flatnonzero((pairs == (a, b)).all(-1) & (observed.sum(-1) >= 2))
        if len(some):
            xyz[some] = (found := cv2.triangulatePoints(P[a], P[b], xy[some, a].T, xy[some, b].T))[:3].T / found[3:].T
    return xyz


def _rated(xy: np.ndarray, confidence: np.ndarray) -> np.ndarray:
    """Return (n, V, 2) pixels, NaN where a view gave them without a confidence."""
    return np.where(np.isfinite(confidence)[..., None], xy, np.nan)


def _undistort(K: np.ndarray, dist: np.ndarray, xy: np.ndarray) -> np.ndarray:
    """Return (n, V, 2) undistorted px. OpenCV ignores the skew of K, so it gets normalised points."""
    undistorted = np.empty_like(xy)
    for v, (axes, centre) in enumerate(zip(K[:, :2, :2], K[:, :2, 2], strict=True)):
        points = np.linalg.solve(axes, (xy[:, v] - centre).T).T
        undistorted[:, v] = cv2.undistortPoints(points[:, None], np.eye(3), dist[v])[:, 0] @ axes.T + centre
    return undistorted
