"""Triangulation: robust points with covariance, batched over persons, joints and frames."""

from dataclasses import dataclass
from math import prod
from typing import NamedTuple

import numpy as np

from dmae.data.array_fields import same_fields, short_repr
from dmae.data.cameras import CameraRig
from dmae.numerics.compiled import compiled
from dmae.reconstruction.config import NoiseModel

DEFAULT_NOISE = NoiseModel()
_MIN_DEPTH = 0.05  # m; points that are nearer to a camera are not used
_CONVERGED = 1e-6  # m; shorter steps end the refinement of a point
_HUBER = 2.0  # Sigmas; residuals beyond them count linearly
_PRIOR_FREEDOM = 4.0  # Degrees of freedom for which the sigmas count when residuals of a point contradict them
_AGREEING = 3  # A point is triangulated from this number of agreeing views, even if two views agree more closely


@dataclass(frozen=True)
class Points:
    """Triangulated points; leading axes (...) as in the input.

    Attributes:
        xyz: (..., 3) m, world; NaN where fewer than two views agree.
        cov: (..., 3, 3) covariance, m^2; NaN where xyz is.
        used: (..., V) True for the views that a point was triangulated from.
        residual: (...) root mean square reprojection error over those views, px; NaN where xyz is.
    """

    xyz: np.ndarray
    cov: np.ndarray
    used: np.ndarray
    residual: np.ndarray

    __repr__, __eq__ = short_repr, same_fields

    @property
    def views(self) -> np.ndarray:
        """(...) number of views used."""
        return self.used.sum(-1)


def triangulate(
    rig: CameraRig, xy: np.ndarray, confidence: np.ndarray, noise: NoiseModel = DEFAULT_NOISE, iterations: int = 8
) -> Points:
    """Triangulate points robustly, weighted by confidence.

    Each pair of the four most confident views proposes the point at which their rays pass closest. The proposal that
    most views agree with is refined by Gauss-Newton: it minimises

        sum over views v of huber(|project_v(X) - xy_v| / sigma_v),
        sigma_v = hypot(min_sigma_px, focal_v * sigma(confidence_v) / depth_v) px,

    over the views within the gate (Hartley & Zisserman, 2nd ed., 12.3 and A6.8). This is the triangulation step of
    Algorithm 1 of the paper, which takes all views above `th_p` with equal weights. Points in front of fewer than two
    agreeing cameras, and points with a standard error above `noise.max_error_m`, are absent.

    Args:
        rig: V cameras.
        xy: (..., V, 2) undistorted px (see `CameraRig.undistort`); NaN where a view does not see the point.
        confidence: (..., V) in [0, 1]; NaN where a view does not see the point.
        noise: Expected error of detections.
        iterations: Largest number of Gauss-Newton steps; two leave an error of some millimetres. Steps end below 1 um.

    Returns:
        Points (...) in the world of the rig, m, with covariance (J^T W J)^-1, which is scaled up where residuals exceed
        their sigmas.
    """
    xy, confidence = np.asarray(xy, np.float64), np.asarray(confidence, np.float64)
    floor = np.full(len(rig), float(noise.min_sigma_px))
    sigma = noise.sigma(np.where(np.isfinite(confidence), confidence, np.nan))
    return triangulate_by_sigma(rig, xy, sigma, floor, noise, iterations)


def triangulate_by_sigma(
    rig: CameraRig,
    xy: np.ndarray,
    sigma: np.ndarray,
    floor: np.ndarray,
    noise: NoiseModel = DEFAULT_NOISE,
    iterations: int = 8,
) -> Points:
    """Triangulate points as `triangulate` does, with detections of known noise, sigma_v = hypot(floor_v, ...) px.

    Args:
        sigma: (..., V) m at the depth of the point; NaN where a view does not see it.
        floor: (V,) px.
        noise: Gate, and largest error of a point.
    """
    views, shape = len(rig), xy.shape[:-2]
    xy, sigma = xy.reshape(prod(shape), views, 2), sigma.reshape(prod(shape), views)
    sigma = np.where(np.isfinite(xy).all(-1) & np.isfinite(sigma), sigma, np.nan)
    cameras = _Cameras(rig.projections, rig.world_from_pixel, rig.centers, rig.focal, floor)
    found = _triangulate_points(cameras, xy, sigma, noise.gate_sigmas, noise.max_error_m, iterations)
    return Points(*(array.reshape(shape + array.shape[1:]) for array in found))


_PAIRED_VIEWS = 4  # Largest number of views from which pairs are made


class _Cameras(NamedTuple):
    """What the kernels read of V pinhole cameras."""

    projections: np.ndarray  # (V, 3, 4) from the world to homogeneous pixels
    rays: np.ndarray  # (V, 3, 3) from homogeneous pixels to directions in the world
    centers: np.ndarray  # (V, 3) m
    focal: np.ndarray  # (V,) px
    floor: np.ndarray  # (V,) px, smallest sigma in the image of each view


class _Fit(NamedTuple):
    """How well a point fits each of V views. Entries of views that do not see it mean nothing."""

    pixels: np.ndarray  # (V, 3) x and y, px, and depth, m, of the point
    scales: np.ndarray  # (V,) 1 / sigma, 1/px
    errors: np.ndarray  # (V,) distance between detection and pixel, sigmas
    kept: np.ndarray  # (V,) True for views that are used


@compiled()
def _triangulate_points(cameras, xy, sigma, gate, max_error, iterations):
    """Triangulate n points separately; return the fields of `Points`.

    Args:
        cameras: `_Cameras`, V of them.
        xy: (n, V, 2) px.
        sigma: (n, V) m at the depth of the point; NaN where a view does not see it.
        gate: Sigmas; residuals beyond them are not used.
        max_error: m, largest standard error along the worst direction.
        iterations: Largest number of Gauss-Newton steps.
    """
    points, views = xy.shape[:2]
    xyz, cov = np.full((points, 3), np.nan), np.full((points, 3, 3), np.nan)
    used, residual = np.zeros((points, views), np.bool_), np.full(points, np.nan)
    seen_by, point = np.empty(views, np.int64), np.empty(3)
    information, factor, gradient = np.empty((3, 3)), np.empty((3, 3)), np.empty(3)
    fit = _Fit(np.empty((views, 3)), np.empty(views), np.empty(views), np.zeros(views, np.bool_))
    for i in range(points):
        seen = seen_by[: _observing(sigma[i], seen_by)]
        if not _propose(cameras, xy[i], sigma[i], gate, seen, point):
            continue
        for _ in range(iterations):
            _compare(cameras, xy[i], sigma[i], gate, seen, point, fit)
            _normal_equations(cameras, xy[i], seen, fit, information, gradient)
            cholesky(information, factor)
            solve(factor, gradient)
            for k in range(3):
                point[k] -= gradient[k]
            if max(abs(gradient[0]), abs(gradient[1]), abs(gradient[2])) < _CONVERGED:
                break
        _compare(cameras, xy[i], sigma[i], gate, seen, point, fit)
        _normal_equations(cameras, xy[i], seen, fit, information, gradient)
        number, weighted, square = 0, 0.0, 0.0
        for k in range(len(seen)):
            v = seen[k]
            if fit.kept[v]:
                number += 1
                weighted += fit.errors[v] ** 2
                square += (fit.errors[v] / fit.scales[v]) ** 2
        if number < 2:
            continue
        cholesky(information, factor)
        # Residuals larger than their sigmas show that the sigmas are too small here, so the covariance is increased.
        excess = max((weighted + _PRIOR_FREEDOM) / (2 * number - 3 + _PRIOR_FREEDOM), 1.0)
        for column in range(3):
            for row in range(3):
                gradient[row] = excess if row == column else 0.0
            solve(factor, gradient)
            for row in range(3):
                information[row, column] = gradient[row]
        if not largest_eigenvalue(information) <= max_error**2:
            continue
        residual[i] = np.sqrt(square / number)
        # Element by element: the message of an error of shapes takes three seconds to compile.
        for row in range(3):
            xyz[i, row] = point[row]
            for column in range(3):
                cov[i, row, column] = information[row, column]
        for k in range(len(seen)):
            v = seen[k]
            used[i, v] = fit.kept[v]
    return xyz, cov, used, residual


@compiled()
def _propose(cameras, xy, sigma, gate, seen, point):
    """Write the midpoint of two rays with which most views agree to `point`; return False where no two rays meet.

    Args:
        xy, sigma: (V, 2) px and (V,) m, of the point's detections.
        gate: Sigmas; a view that is farther off does not agree.
        seen: The views that see the point.
    """
    best, direction, proposal = np.empty(_PAIRED_VIEWS, np.int64), np.empty((_PAIRED_VIEWS, 3)), np.empty(3)
    pairs, least = _most_certain(seen, sigma, best), np.inf
    for k in range(pairs):
        _direction(cameras.rays[best[k]], xy[best[k]], direction[k])
    for a in range(pairs):
        for b in range(a + 1, pairs):
            one, other = cameras.centers[best[a]], cameras.centers[best[b]]
            if not _midpoint(one, direction[a], other, direction[b], proposal):
                continue
            error, near_views = 0.0, 0
            for k in range(len(seen)):
                v = seen[k]
                x, y, depth = project(cameras.projections[v], proposal)
                if depth <= _MIN_DEPTH:
                    error += gate**2
                    continue
                near = cameras.focal[v] * sigma[v] / depth
                square = ((x - xy[v, 0]) ** 2 + (y - xy[v, 1]) ** 2) / (cameras.floor[v] ** 2 + near**2)
                error += min(square, gate**2)
                near_views += square < gate**2
                if error >= least:
                    break
            if near_views < _AGREEING:
                error += gate**2 * len(sigma)
            if error < least:
                least = error
                for k in range(3):
                    point[k] = proposal[k]
    return np.isfinite(least)


@compiled()
def _observing(sigma, seen):
    """Write the views with a sigma into `seen`; return their number."""
    count = 0
    for v in range(len(sigma)):
        if not np.isnan(sigma[v]):
            seen[count] = v
            count += 1
    return count


@compiled()
def _most_certain(seen, sigma, best):
    """Write the views with the smallest sigmas, in order, into `best`; return their number."""
    number = min(len(seen), _PAIRED_VIEWS)
    for place in range(number):
        chosen = -1
        for k in range(len(seen)):
            v = seen[k]
            taken = False
            for earlier in range(place):
                taken |= best[earlier] == v
            if not taken and (chosen < 0 or sigma[v] < sigma[chosen]):
                chosen = v
        best[place] = chosen
    return number


@compiled()
def _direction(ray, xy, direction):
    """Write the unit direction through a pixel into `direction`."""
    for row in range(3):
        direction[row] = ray[row, 0] * xy[0] + ray[row, 1] * xy[1] + ray[row, 2]
    length = np.sqrt(direction[0] ** 2 + direction[1] ** 2 + direction[2] ** 2)
    for row in range(3):
        direction[row] /= length


@compiled()
def _midpoint(center_a, ray_a, center_b, ray_b, midpoint):
    """Write the point midway between two rays; return False where they are parallel or part in front of a camera."""
    cosine, base_a, base_b = 0.0, 0.0, 0.0
    for k in range(3):
        base = center_b[k] - center_a[k]
        cosine += ray_a[k] * ray_b[k]
        base_a += ray_a[k] * base
        base_b += ray_b[k] * base
    sine2 = 1 - cosine**2
    if sine2 <= 1e-8:
        return False
    along_a, along_b = (base_a - cosine * base_b) / sine2, (cosine * base_a - base_b) / sine2
    if along_a <= 0 or along_b <= 0:
        return False
    for k in range(3):
        midpoint[k] = (center_a[k] + along_a * ray_a[k] + center_b[k] + along_b * ray_b[k]) / 2
    return True


@compiled()
def project(projection, point):
    """Return x and y, px, and depth, m, of a point; NaN for points that are NaN or not in front of the camera."""
    x = projection[0, 0] * point[0] + projection[0, 1] * point[1] + projection[0, 2] * point[2] + projection[0, 3]
    y = projection[1, 0] * point[0] + projection[1, 1] * point[1] + projection[1, 2] * point[2] + projection[1, 3]
    depth = projection[2, 0] * point[0] + projection[2, 1] * point[1] + projection[2, 2] * point[2] + projection[2, 3]
    if not depth > 0:
        return np.nan, np.nan, depth
    return x / depth, y / depth, depth


@compiled()
def _compare(cameras, xy, sigma, gate, seen, point, fit):
    """Write into `fit` how far the detections of a point are from where the views `seen` see it.

    Args:
        xy, sigma: (V, 2) px and (V,) m at the depth of the point.
        gate: Sigmas; views that are farther off, or before which the point is not, are not kept.
    """
    ahead = 0
    for k in range(len(seen)):
        v = seen[k]
        fit.pixels[v, 0], fit.pixels[v, 1], fit.pixels[v, 2] = project(cameras.projections[v], point)
        fit.kept[v] = fit.pixels[v, 2] > _MIN_DEPTH
        ahead += fit.kept[v]
    # With few views the point follows each of them: with two, a residual shows half the disagreement.
    limit = gate * np.sqrt(1 - 1.5 / max(ahead, 2))
    for k in range(len(seen)):
        v = seen[k]
        if fit.kept[v]:
            dx, dy = fit.pixels[v, 0] - xy[v, 0], fit.pixels[v, 1] - xy[v, 1]
            fit.scales[v] = 1 / np.sqrt(cameras.floor[v] ** 2 + (cameras.focal[v] * sigma[v] / fit.pixels[v, 2]) ** 2)
            fit.errors[v] = np.sqrt(dx * dx + dy * dy) * fit.scales[v]
            fit.kept[v] = fit.errors[v] <= limit


@compiled()
def _normal_equations(cameras, xy, seen, fit, information, gradient):
    """Write J^T W J (3, 3) and J^T W r (3,) of the views that are kept, with Huber weights W; J is in px per m."""
    for row in range(3):
        gradient[row] = 0.0
        for column in range(3):
            information[row, column] = 0.0
    for k in range(len(seen)):
        v = seen[k]
        if not fit.kept[v]:
            continue
        x, y, depth = fit.pixels[v, 0], fit.pixels[v, 1], fit.pixels[v, 2]
        dx, dy = x - xy[v, 0], y - xy[v, 1]
        weight = fit.scales[v] ** 2 * min(1.0, _HUBER / max(fit.errors[v], 1e-9))
        P = cameras.projections[v]
        u0, w0 = (P[0, 0] - x * P[2, 0]) / depth, (P[1, 0] - y * P[2, 0]) / depth
        u1, w1 = (P[0, 1] - x * P[2, 1]) / depth, (P[1, 1] - y * P[2, 1]) / depth
        u2, w2 = (P[0, 2] - x * P[2, 2]) / depth, (P[1, 2] - y * P[2, 2]) / depth
        gradient[0] += weight * (u0 * dx + w0 * dy)
        gradient[1] += weight * (u1 * dx + w1 * dy)
        gradient[2] += weight * (u2 * dx + w2 * dy)
        information[0, 0] += weight * (u0 * u0 + w0 * w0)
        information[1, 0] += weight * (u1 * u0 + w1 * w0)
        information[1, 1] += weight * (u1 * u1 + w1 * w1)
        information[2, 0] += weight * (u2 * u0 + w2 * w0)
        information[2, 1] += weight * (u2 * u1 + w2 * w1)
        information[2, 2] += weight * (u2 * u2 + w2 * w2)
    damping = 1e-9 * (information[0, 0] + information[1, 1] + information[2, 2]) + 1e-9
    for row in range(3):
        information[row, row] += damping
        for column in range(row):
            information[column, row] = information[row, column]


@compiled()
def cholesky(matrix, factor):
    """Write the lower factor of a positive definite matrix (3, 3)."""
    for row in range(3):
        for column in range(row + 1):
            total = matrix[row, column]
            for k in range(column):
                total -= factor[row, k] * factor[column, k]
            if row == column:
                factor[row, row] = np.sqrt(max(total, 1e-300))
            else:
                factor[row, column] = total / factor[column, column]


@compiled()
def solve(factor, vector):
    """Solve L L^T x = vector in place."""
    for row in range(3):
        for k in range(row):
            vector[row] -= factor[row, k] * vector[k]
        vector[row] /= factor[row, row]
    for row in range(2, -1, -1):
        for k in range(row + 1, 3):
            vector[row] -= factor[k, row] * vector[k]
        vector[row] /= factor[row, row]


@compiled()
def largest_eigenvalue(matrix):
    """Return the largest eigenvalue of a symmetric matrix (3, 3), in closed form."""
    aside = matrix[0, 1] ** 2 + matrix[0, 2] ** 2 + matrix[1, 2] ** 2
    mean = (matrix[0, 0] + matrix[1, 1] + matrix[2, 2]) / 3
    a, b, c = matrix[0, 0] - mean, matrix[1, 1] - mean, matrix[2, 2] - mean
    spread = np.sqrt((a * a + b * b + c * c + 2 * aside) / 6)
    if spread == 0:
        return mean
    determinant = (
        a * (b * c - matrix[1, 2] ** 2)
        - matrix[0, 1] * (matrix[0, 1] * c - matrix[1, 2] * matrix[0, 2])
        + matrix[0, 2] * (matrix[0, 1] * matrix[1, 2] - b * matrix[0, 2])
    )
    half = min(max(determinant / (2 * spread**3), -1.0), 1.0)
    return mean + 2 * spread * np.cos(np.arccos(half) / 3)


def closest_approach(
    base: np.ndarray, direction_a: np.ndarray, direction_b: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the points at which lines a and b are closest to each other. The arguments broadcast.

    Args:
        base: (..., 3) vector from the start of a to the start of b.
        direction_a: (..., 3) unit vectors along a.
        direction_b: (..., 3) unit vectors along b.

    Returns:
        along_a: (...) distance from the start of a to the point nearest to b, negative behind the start.
        along_b: (...) the same for b.
        sine2: (...) squared sine of the angle between the lines, at least 1e-12. Parallel lines have no closest points.
    """
    cosine = (direction_a * direction_b).sum(-1)
    base_a, base_b = (direction_a * base).sum(-1), (direction_b * base).sum(-1)
    sine2 = np.maximum(1 - cosine**2, 1e-12)
    return (base_a - cosine * base_b) / sine2, (cosine * base_a - base_b) / sine2, sine2
