"""Points from rays: robust triangulation, batched over persons, joints and frames."""

from copy import copy
from dataclasses import dataclass
from math import prod

import numpy as np

from dmae.cameras import CameraRig

_NEAREST = 0.05
"""Nothing is seen nearer to a camera than this, m."""
_CONVERGED = 1e-6
"""m; shorter steps end the refinement of a point."""
_HUBER = 2.0
"""Residuals beyond this many sigmas count linearly."""
_PAIRED_VIEWS = 4
"""Pairs are made of so many views at most."""
_CHUNK = 60_000
"""Points times pairs times views held at once: few enough to stay in the cache."""


@dataclass(frozen=True)
class Noise:
    """How far a detected joint lies from the true one, and from when on that is too far.

    Detectors err in proportion to the size of the person in the image. So sigma is a length on the
    person: sure at confidence 1, unsure at 0, linear between, and in the image never below a floor. The
    defaults fit the leave-one-view-out errors of OpenPose on adults (median by confidence, one axis).

    Attributes:
        unsure: sigma at confidence 0, m.
        sure: sigma at confidence 1, m.
        pixels: Floor of sigma in the image, px.
        gate: A view whose standardised residual (in sigmas, redundancy allowed for) is larger is not used.
        deepest: A point whose standard error along its worst direction is larger is not given, m.
    """

    unsure: float = 0.065
    sure: float = 0.012
    pixels: float = 1.0
    gate: float = 5.0
    deepest: float = 0.25

    def sigma(self, confidence: np.ndarray) -> np.ndarray:
        """Standard deviation of one axis at the person's depth, m; NaN stays NaN."""
        return self.unsure + (self.sure - self.unsure) * np.clip(confidence, 0, 1)


@dataclass(frozen=True)
class Points:
    """Triangulated points; leading axes (...) as in the input.

    Attributes:
        xyz: (..., 3) m, world; NaN where fewer than two views agree.
        cov: (..., 3, 3) covariance, m^2; NaN where xyz is.
        used: (..., V) True for the views a point is made of.
        residual: (...) root mean square over those views of the reprojection error, px; NaN where xyz is.
    """

    xyz: np.ndarray
    cov: np.ndarray
    used: np.ndarray
    residual: np.ndarray

    @property
    def views(self) -> np.ndarray:
        """(...) number of views used."""
        return self.used.sum(-1)


def triangulate(
    rig: CameraRig, xy: np.ndarray, confidence: np.ndarray, noise: Noise = Noise(), steps: int = 8
) -> Points:
    """Robust, confidence-weighted triangulation.

    Of the points in which any two rays pass closest, the one that most views agree with is refined by
    Gauss-Newton on Huber-weighted reprojection errors (Hartley & Zisserman, 2nd ed., 12.3 and A6.8) over
    the views within the gate. A view counts only with the point in front of it.

    Args:
        rig: V cameras.
        xy: (..., V, 2) undistorted pixels (`CameraRig.undistort`); NaN where a view does not see the point.
        confidence: (..., V) in [0, 1].
        noise: What to expect of detections.
        steps: Most steps of refinement. Two leave some millimetres.

    Raises:
        ValueError: the arrays do not fit the rig.
    """
    xy, confidence = np.asarray(xy, np.float64), np.asarray(confidence, np.float64)
    views = len(rig)
    if xy.shape[-2:] != (views, 2) or confidence.shape != xy.shape[:-1]:
        raise ValueError(
            f"rig of {views} cameras: expected xy (..., {views}, 2) and confidence (..., {views}), "
            f"found {xy.shape} and {confidence.shape}"
        )
    shape = xy.shape[:-2]
    xy, confidence = xy.reshape(prod(shape), views, 2), confidence.reshape(prod(shape), views)
    seen = np.isfinite(xy).all(-1) & np.isfinite(confidence)
    points = Points(
        np.full((len(xy), 3), np.nan),
        np.full((len(xy), 3, 3), np.nan),
        np.zeros((len(xy), views), bool),
        np.full(len(xy), np.nan),
    )
    enough = np.flatnonzero(seen.sum(-1) >= 2)
    pairs = min(views, _PAIRED_VIEWS) * (min(views, _PAIRED_VIEWS) - 1) // 2
    for some in np.array_split(enough, len(enough) * pairs * views // _CHUNK + 1):
        sightings = _Sightings(rig, xy[some], seen[some], noise.sigma(confidence[some]), noise)
        start = sightings.closest_pair()
        known = np.isfinite(start[:, 0])
        xyz, cov, used, residual = sightings[known].refine(start[known], steps)
        good = (used.sum(-1) >= 2) & (np.linalg.eigvalsh(cov)[:, -1] <= noise.deepest**2)
        found = some[known][good]
        points.xyz[found], points.cov[found] = xyz[good], cov[good]
        points.used[found], points.residual[found] = used[good], residual[good]
    return Points(
        points.xyz.reshape(*shape, 3),
        points.cov.reshape(*shape, 3, 3),
        points.used.reshape(*shape, views),
        points.residual.reshape(shape),
    )


class _Sightings:
    """What V views saw of n points: xy (n, V, 2) px, seen (n, V), sigma (n, V) m."""

    def __init__(self, rig: CameraRig, xy: np.ndarray, seen: np.ndarray, sigma: np.ndarray, noise: Noise):
        self.pinhole = rig.undistorted
        self.noise, self.seen = noise, seen
        self.xy, self.sigma = np.where(seen[..., None], xy, 0), np.where(seen, sigma, 1)
        self.projections, self.focal = rig.projections, np.sqrt(rig.K[:, 0, 0] * rig.K[:, 1, 1])

    def __getitem__(self, points) -> "_Sightings":
        some = copy(self)
        some.xy, some.seen, some.sigma = self.xy[points], self.seen[points], self.sigma[points]
        return some

    def compare(self, xyz: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Where points (n, ..., 3) would be seen.

        Returns:
            off: (n, ..., V, 2) their pixels less xy.
            scale: (n, ..., V) 1 / sigma in the image, 1/px.
            depth: (n, ..., V) m.
        """
        views, between = len(self.pinhole), (1,) * (xyz.ndim - 2)
        homogeneous = xyz @ self.projections[:, :, :3].reshape(-1, 3).T + self.projections[:, :, 3].ravel()
        homogeneous = homogeneous.reshape(*xyz.shape[:-1], views, 3)
        depth = homogeneous[..., 2]
        near = np.maximum(depth, _NEAREST)
        spread = (self.focal * self.sigma).reshape(-1, *between, views)
        scale = 1 / np.hypot(self.noise.pixels, spread / near)
        return homogeneous[..., :2] / near[..., None] - self.xy.reshape(-1, *between, views, 2), scale, depth

    def closest_pair(self) -> np.ndarray:
        """(n, 3) where two rays pass closest: of all pairs the one with the least truncated error over all views.

        Of many views the surest supply the pairs, all judge them.
        """
        rays, centers = self.pinhole.rays(self.xy.swapaxes(0, 1)[None])[0], self.pinhole.centers
        surest = np.argsort(np.where(self.seen, self.sigma, np.inf), -1)[:, :_PAIRED_VIEWS]
        a, b = (surest[:, side] for side in np.triu_indices(surest.shape[1], 1))
        point = np.arange(len(self.xy))[:, None]
        middle = _between(centers[a], rays[a, point], centers[b], rays[b, point])
        middle[~(self.seen[point, a] & self.seen[point, b])] = np.nan
        off, scale, depth = self.compare(middle)
        far = self.noise.gate**2
        with np.errstate(invalid="ignore"):
            error = (off[..., 0] ** 2 + off[..., 1] ** 2) * scale**2
            error = np.where(depth > _NEAREST, np.minimum(error, far), far)
        error = np.where(self.seen[:, None], error, 0).sum(-1)
        error[np.isnan(middle[..., 0])] = np.inf
        return middle[point[:, 0], error.argmin(-1)]

    def refine(self, xyz: np.ndarray, steps: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Points (n, 3) from a start near them, with covariance, views used and residual as in `Points`."""
        xyz, moving, some = xyz.copy(), np.arange(len(xyz)), self
        for _ in range(steps):
            information, gradient, *_ = some._normal_equations(xyz[moving])
            step = np.linalg.solve(information, gradient[..., None])[..., 0]
            xyz[moving] -= step
            still = (np.abs(step) >= _CONVERGED).any(-1)
            if 2 * still.sum() < len(moving):
                moving, some = moving[still], some[still]
                if not len(moving):
                    break
        information, _, used, error, scale = self._normal_equations(xyz)
        square, count = np.where(used, error**2, 0), used.sum(-1)
        # Views that disagree by more than their sigmas say less than their sigmas promise.
        surprise = square.sum(-1) / np.maximum(2 * count - 3, 1)
        cov = np.linalg.inv(information) * np.maximum(surprise, 1)[:, None, None]
        return xyz, cov, used, np.sqrt((square / scale**2).sum(-1) / np.maximum(count, 1))

    def _normal_equations(self, xyz: np.ndarray) -> tuple[np.ndarray, ...]:
        """What a step from points (n, 3) takes.

        Returns:
            information: J^T W J (n, 3, 3).
            gradient: J^T W r (n, 3).
            used: (n, V) views within the gate.
            error: (n, V) in sigmas.
            scale: (n, V) 1 / sigma in the image, 1/px.
        """
        off, scale, depth = self.compare(xyz)
        error = np.sqrt(off[..., 0] ** 2 + off[..., 1] ** 2) * scale
        used = self.seen & (depth > _NEAREST)
        # With few views the point follows each of them: of two views a residual shows half the disagreement.
        count = np.maximum(used.sum(-1, keepdims=True), 2)
        used &= error <= self.noise.gate * np.sqrt(1 - 1.5 / count)
        weight = np.where(used, np.minimum(1, _HUBER / np.maximum(error, 1e-9)) * scale**2, 0)
        pixels = off + self.xy
        M = self.projections[:, :, :3]
        jacobian = (M[:, :2] - pixels[..., None] * M[:, None, 2]) / np.maximum(depth, _NEAREST)[..., None, None]
        jacobian = jacobian.reshape(len(xyz), 2 * len(self.pinhole), 3)
        weighted = jacobian.swapaxes(-1, -2) * np.repeat(weight, 2, -1)[:, None]
        information = weighted @ jacobian
        damping = 1e-9 * np.trace(information, axis1=-2, axis2=-1) + 1e-9
        information += damping[:, None, None] * np.eye(3)
        gradient = (weighted @ off.reshape(len(xyz), 2 * len(self.pinhole), 1))[..., 0]
        return information, gradient, used, error, scale


def _between(center_a: np.ndarray, rays_a: np.ndarray, center_b: np.ndarray, rays_b: np.ndarray) -> np.ndarray:
    """Points (..., 3) half way between unit rays (..., 3) from centres (..., 3) where they pass closest.

    NaN where the rays are parallel within 0.1 mrad or pass closest behind a camera.
    """
    base = center_b - center_a
    cosine = (rays_a * rays_b).sum(-1)
    along_a, along_b = (rays_a * base).sum(-1), (rays_b * base).sum(-1)
    sine2 = np.maximum(1 - cosine**2, 1e-12)
    far_a = (along_a - cosine * along_b) / sine2
    far_b = (cosine * along_a - along_b) / sine2
    middle = (center_a + far_a[..., None] * rays_a + center_b + far_b[..., None] * rays_b) / 2
    return np.where(((sine2 > 1e-8) & (far_a > 0) & (far_b > 0))[..., None], middle, np.nan)
