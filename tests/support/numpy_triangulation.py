"""Triangulation as `dmae.reconstruction.triangulation` does it, in numpy: its oracle, and a solver to spoil."""

from copy import copy
from math import prod

import numpy as np

from dmae.data.cameras import CameraRig
from dmae.reconstruction.config import NoiseModel
from dmae.reconstruction.triangulation import DEFAULT_NOISE, Points, closest_approach

_MIN_DEPTH = 0.05
"""m; nothing nearer to a camera is used."""
_CONVERGED = 1e-6
"""m; shorter steps end the refinement of a point."""
_HUBER = 2.0
"""Sigmas; residuals beyond them count linearly."""
_PRIOR_FREEDOM = 4.0
"""Degrees of freedom that the sigmas count as."""
_AGREEING = 3
"""Views that a point is made of where as many agree, before it is made of two that agree more closely."""
_PAIRED_VIEWS = 4
"""Largest number of views from which pairs are made."""
_CHUNK = 60_000
"""Points times pairs times views in memory at once: few enough to stay in the cache."""


def triangulate(
    rig: CameraRig,
    xy: np.ndarray,
    confidence: np.ndarray,
    noise: NoiseModel = DEFAULT_NOISE,
    iterations: int = 8,
) -> Points:
    """Triangulate points as `dmae.reconstruction.triangulation.triangulate`."""
    xy, confidence = np.asarray(xy, np.float64), np.asarray(confidence, np.float64)
    views = len(rig)
    shape = xy.shape[:-2]
    xy, confidence = xy.reshape(prod(shape), views, 2), confidence.reshape(prod(shape), views)
    observed = np.isfinite(xy).all(-1) & np.isfinite(confidence)
    points = Points(
        np.full((len(xy), 3), np.nan),
        np.full((len(xy), 3, 3), np.nan),
        np.zeros((len(xy), views), bool),
        np.full(len(xy), np.nan),
    )
    enough = np.flatnonzero(observed.sum(-1) >= 2)
    pairs = min(views, _PAIRED_VIEWS) * (min(views, _PAIRED_VIEWS) - 1) // 2
    for chunk in np.array_split(enough, len(enough) * pairs * views // _CHUNK + 1):
        observations = _Observations(rig, xy[chunk], observed[chunk], noise.sigma(confidence[chunk]), noise)
        start = observations.best_midpoints()
        known = np.isfinite(start[:, 0])
        xyz, cov, used, residual = observations[known].refine(start[known], iterations)
        good = (used.sum(-1) >= 2) & (np.linalg.eigvalsh(cov)[:, -1] <= noise.max_error_m**2)
        found = chunk[known][good]
        points.xyz[found], points.cov[found] = xyz[good], cov[good]
        points.used[found], points.residual[found] = used[good], residual[good]
    return Points(
        points.xyz.reshape(*shape, 3),
        points.cov.reshape(*shape, 3, 3),
        points.used.reshape(*shape, views),
        points.residual.reshape(shape),
    )


class _Observations:
    """Observations of n points by V views: xy (n, V, 2) px, observed (n, V), sigma (n, V) m."""

    def __init__(
        self,
        rig: CameraRig,
        xy: np.ndarray,
        observed: np.ndarray,
        sigma: np.ndarray,
        noise: NoiseModel,
    ):
        self.pinhole = rig.undistorted
        self.noise, self.observed = noise, observed
        self.xy, self.sigma = np.where(observed[..., None], xy, 0), np.where(observed, sigma, 1)
        self.projections, self.focal = rig.projections, np.sqrt(rig.K[:, 0, 0] * rig.K[:, 1, 1])

    def __getitem__(self, points) -> "_Observations":
        part = copy(self)
        part.xy, part.observed, part.sigma = self.xy[points], self.observed[points], self.sigma[points]
        return part

    def compare(self, xyz: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Compare the reprojections of points (n, ..., 3) with the observations.

        Returns:
            offset: (n, ..., V, 2) reprojection less xy, px.
            scale: (n, ..., V) 1 / sigma in the image, 1/px.
            depth: (n, ..., V) m.
        """
        views, between = len(self.pinhole), (1,) * (xyz.ndim - 2)
        homogeneous = xyz @ self.projections[:, :, :3].reshape(-1, 3).T + self.projections[:, :, 3].ravel()
        homogeneous = homogeneous.reshape(*xyz.shape[:-1], views, 3)
        depth = homogeneous[..., 2]
        near = np.maximum(depth, _MIN_DEPTH)
        spread = (self.focal * self.sigma).reshape(-1, *between, views)
        scale = 1 / np.hypot(self.noise.min_sigma_px, spread / near)
        return homogeneous[..., :2] / near[..., None] - self.xy.reshape(-1, *between, views, 2), scale, depth

    def best_midpoints(self) -> np.ndarray:
        """Return the points (n, 3) of the pairs of rays with the smallest truncated error over all views.

        The most confident views form the pairs; all views enter the error. A point on which three views agree comes
        before one of two.
        """
        rays, centers = self.pinhole.rays(self.xy.swapaxes(0, 1)[None])[0], self.pinhole.centers
        best = np.argsort(np.where(self.observed, self.sigma, np.inf), -1)[:, :_PAIRED_VIEWS]
        a, b = (best[:, side] for side in np.triu_indices(best.shape[1], 1))
        point = np.arange(len(self.xy))[:, None]
        midpoints = _midpoints(centers[a], rays[a, point], centers[b], rays[b, point])
        midpoints[~(self.observed[point, a] & self.observed[point, b])] = np.nan
        offset, scale, depth = self.compare(midpoints)
        limit = self.noise.gate_sigmas**2
        with np.errstate(invalid="ignore"):
            error = (offset[..., 0] ** 2 + offset[..., 1] ** 2) * scale**2
            error = np.where(depth > _MIN_DEPTH, np.minimum(error, limit), limit)
        error = np.where(self.observed[:, None], error, 0)
        agreeing = (self.observed[:, None] & (error < limit)).sum(-1)
        error = error.sum(-1) + np.where(agreeing < _AGREEING, limit * error.shape[-1], 0)
        error[np.isnan(midpoints[..., 0])] = np.inf
        return midpoints[point[:, 0], error.argmin(-1)]

    def refine(self, xyz: np.ndarray, iterations: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Refine points (n, 3); return them with covariance, views used and residual as in `Points`."""
        xyz, moving, part = xyz.copy(), np.arange(len(xyz)), self
        for _ in range(iterations):
            information, gradient, *_ = part._normal_equations(xyz[moving])
            step = np.linalg.solve(information, gradient[..., None])[..., 0]
            xyz[moving] -= step
            unconverged = (np.abs(step) >= _CONVERGED).any(-1)
            if 2 * unconverged.sum() < len(moving):
                moving, part = moving[unconverged], part[unconverged]
                if not len(moving):
                    break
        information, _, used, error, scale = self._normal_equations(xyz)
        square, count = np.where(used, error**2, 0), used.sum(-1)
        # Residuals larger than their sigmas show that the sigmas are too small: the covariance grows with them.
        freedom = np.maximum(2 * count - 3, 1)
        excess = (square.sum(-1) + _PRIOR_FREEDOM) / (freedom + _PRIOR_FREEDOM)
        cov = np.linalg.inv(information) * np.maximum(excess, 1)[:, None, None]
        return xyz, cov, used, np.sqrt((square / scale**2).sum(-1) / np.maximum(count, 1))

    def _normal_equations(self, xyz: np.ndarray) -> tuple[np.ndarray, ...]:
        """Return the normal equations of a Gauss-Newton step from points (n, 3).

        Returns:
            information: J^T W J (n, 3, 3).
            gradient: J^T W r (n, 3).
            used: (n, V) views within the gate.
            error: (n, V) in sigmas.
            scale: (n, V) 1 / sigma in the image, 1/px.
        """
        offset, scale, depth = self.compare(xyz)
        error = np.sqrt(offset[..., 0] ** 2 + offset[..., 1] ** 2) * scale
        used = self.observed & (depth > _MIN_DEPTH)
        # With few views the point follows each of them: with two, a residual shows half the disagreement.
        count = np.maximum(used.sum(-1, keepdims=True), 2)
        used &= error <= self.noise.gate_sigmas * np.sqrt(1 - 1.5 / count)
        down = np.minimum(1, _HUBER / np.maximum(error, 1e-9))
        weight = np.where(used, down * scale**2, 0)
        pixels = offset + self.xy
        M = self.projections[:, :, :3]
        jacobian = (M[:, :2] - pixels[..., None] * M[:, None, 2]) / np.maximum(depth, _MIN_DEPTH)[..., None, None]
        jacobian = jacobian.reshape(len(xyz), 2 * len(self.pinhole), 3)
        weighted = jacobian.swapaxes(-1, -2) * np.repeat(weight, 2, -1)[:, None]
        information = weighted @ jacobian
        damping = 1e-9 * np.trace(information, axis1=-2, axis2=-1) + 1e-9
        information += damping[:, None, None] * np.eye(3)
        gradient = (weighted @ offset.reshape(len(xyz), 2 * len(self.pinhole), 1))[..., 0]
        return information, gradient, used, error, scale


def _midpoints(center_a: np.ndarray, rays_a: np.ndarray, center_b: np.ndarray, rays_b: np.ndarray) -> np.ndarray:
    """Return the points (..., 3) midway between unit rays (..., 3) from centres (..., 3) where they pass closest.

    NaN where the rays are parallel within 0.1 mrad, or pass closest behind a camera.
    """
    along_a, along_b, sine2 = closest_approach(center_b - center_a, rays_a, rays_b)
    midpoints = (center_a + along_a[..., None] * rays_a + center_b + along_b[..., None] * rays_b) / 2
    return np.where(((sine2 > 1e-8) & (along_a > 0) & (along_b > 0))[..., None], midpoints, np.nan)
