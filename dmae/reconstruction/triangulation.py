"""Triangulation: robust points with covariance, batched over persons, joints and frames."""

from dataclasses import dataclass
from math import prod

import numpy as np

from dmae.data.cameras import CameraRig
from dmae.reconstruction.compiled.points import triangulate_points
from dmae.reconstruction.config import NoiseModel

DEFAULT_NOISE = NoiseModel()
_MIN_DEPTH = 0.05
"""m; points that are nearer to a camera are not used."""
_CONVERGED = 1e-6
"""m; shorter steps end the refinement of a point."""
_HUBER = 2.0
"""Sigmas; residuals beyond them count linearly."""
_CONTRADICTING, _CONTRADICTED = 1.0, 3.0
"""Sigmas; with `selective`, the weight of a view falls above the first value and is 0 above the second."""
_SELECTED_VIEWS = 4
"""Smallest number of views of a point from which some can be left out. With three, the wrong one is ambiguous."""
_AGREEING = 3
"""A point is triangulated from this number of agreeing views, even if two views agree more closely."""


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

    @property
    def views(self) -> np.ndarray:
        """(...) number of views used."""
        return self.used.sum(-1)


def triangulate(
    rig: CameraRig,
    xy: np.ndarray,
    confidence: np.ndarray,
    noise: NoiseModel = DEFAULT_NOISE,
    iterations: int = 8,
    *,
    selective: bool = False,
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
        selective: Leave out views that contradict the others by sigmas, where at least four see the point, instead of
            averaging them: for cameras that are centimetres off (`dmae.reconstruction.people.disagreement`).

    Returns:
        Points (...) in the world of the rig, m, with covariance (J^T W J)^-1, which is scaled up where residuals exceed
        their sigmas.

    Raises:
        ValueError: the arrays do not have the shapes of the rig.
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
    observed = np.isfinite(xy).all(-1) & np.isfinite(confidence)
    points = Points(
        np.full((len(xy), 3), np.nan),
        np.full((len(xy), 3, 3), np.nan),
        np.zeros((len(xy), views), bool),
        np.full(len(xy), np.nan),
    )
    triangulate_points(
        rig.projections,
        rig.world_from_pixel,
        rig.centers,
        rig.focal,
        xy,
        np.where(observed, noise.sigma(confidence), np.nan),
        noise.min_sigma_px,
        noise.gate_sigmas,
        np.array([_MIN_DEPTH, _CONVERGED, _HUBER, noise.max_error_m, _CONTRADICTING, _CONTRADICTED]),
        _AGREEING,
        _SELECTED_VIEWS if selective else views + 1,
        iterations,
        points.xyz,
        points.cov,
        points.used,
        points.residual,
    )
    return Points(
        points.xyz.reshape(*shape, 3),
        points.cov.reshape(*shape, 3, 3),
        points.used.reshape(*shape, views),
        points.residual.reshape(shape),
    )
