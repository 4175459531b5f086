"""What a detection is worth: the noise of a detector and of a calibration, learned from the recording itself.

Joints that several cameras see have residuals. They show how far detections scatter: by camera, for example because a
detector rounds to a grid; by kind of joint; by size of the person; and by confidence, whatever its scale. What is the
same in all frames is the error of the calibration. F frames, P people, V views, J joints.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from dmae.data.cameras import CameraRig, camera_label
from dmae.data.skeleton import Skeleton
from dmae.reconstruction.config import NoiseModel
from dmae.reconstruction.triangulation import Points

USUAL = 0.73
"""Confidence of a usual joint; all joints have it if confidences say nothing."""
_BINS = np.array([0, 0.02, 0.05, 0.1, 0.2, 0.35, 0.5, 0.65, 0.8, 1])
"""Quantiles of the scores in a recording between which one sigma is estimated."""
_PRIOR = 10.0  # Number of observations that the prior of each parameter counts as
_CLIPPED = 2.5
"""Squared standardised residuals, relative to their expected value, count at most this: detections of others, swaps."""
_EXPECTED = 0.809, 0.918
"""Mean clipped square of Gaussian residuals, of joints that two views measured (1 degree of freedom), and others."""
_ROUNDS = 30  # Number of updates of the parameters
_SHARED = 6.0
"""Number of observations that the calibration error of all cameras counts as, beside the two of each: a camera has six
parameters of its pose."""
_UNUSUAL = 3.0
"""Usual calibration errors; beyond this, what cameras share counts less for a camera: its calibration alone is off."""
_LEAST_PX, _LEAST_M = 0.2, 0.001  # px and m; smallest sigmas
_DISAGREE = 0.6  # Share of sigma due to calibration from which the line about the noise says so
_SAYS = 0.15  # Relative difference of sigma between confidences below which confidences say nothing


@dataclass(frozen=True)
class DetectionNoise:
    """Standard deviation of detected joints along one axis, in pixels:

        sigma^2 = floor_v^2 + (focal_v / depth * spread_j * shape(c))^2,

    with shape(c) = 1 at a usual confidence. Confidences are those that residuals bear out: `trusted(score)`.
    """

    model: NoiseModel  # Prior, and how sigma depends on trusted confidences
    floor_px: np.ndarray  # (V,) px of each camera, for people of any size, calibration included
    calibration_px: np.ndarray  # (V,) px; standard deviation of the error of its calibration, the same in all frames
    spread_m: np.ndarray  # (J,) m on the person, by joint
    knots: np.ndarray  # (K,) scores of the detector, ascending
    confidences: np.ndarray  # (K,) trusted confidences at the knots; between them they are interpolated
    constant: np.ndarray  # (V,) True for cameras whose scores say nothing
    count: int = 0  # Number of observations that it was learned from
    usual_px: float = np.nan  # Median sigma of the observations, px
    usual_m: float = np.nan  # The same on the person, m
    # px; displacement of images that residuals show, root mean square over cameras. `calibration_px` has in addition
    # what they cannot show, as points follow cameras that are displaced alike: much where a person stays in one place.
    displaced_px: float = 0.0

    @classmethod
    def prior(cls, model: NoiseModel, views: int, joints: int) -> DetectionNoise:
        """Return what is assumed of a detector before anything is learned: scores are confidences."""
        usual, ends = float(model.sigma(np.array(USUAL))), np.array([0.0, 1.0])
        floor, spread = np.full(views, model.min_sigma_px), np.full(joints, usual)
        return cls(model, floor, np.zeros(views), spread, ends, ends, np.zeros(views, bool), usual_m=usual)

    @property
    def jitter_px(self) -> np.ndarray:
        """(V,) px of each camera that differ from frame to frame: the floor without the calibration."""
        return np.sqrt(np.maximum(self.floor_px**2 - self.calibration_px**2, 0))

    @property
    def widening(self) -> float:
        """Factor of distances within which detections are compared, 1 or more: noisy detections are farther apart."""
        return max(1.0, self.usual_m / _USUAL_M)

    def trusted(self, score: np.ndarray) -> np.ndarray:
        """Return confidences in [0, 1] of scores (..., V, D, J); NaN stays NaN."""
        found = np.interp(score, self.knots, self.confidences)
        return np.where(np.isnan(score), np.nan, np.where(self.constant[:, None, None], USUAL, found))

    def sigma(self, confidence: np.ndarray) -> np.ndarray:
        """Return sigma without the floor at the person's depth, m, for trusted confidences (..., J, V)."""
        return self.spread_m[:, None] * self.shape(confidence)

    def shape(self, confidence: np.ndarray) -> np.ndarray:
        """Return sigma relative to that at a usual confidence."""
        return self.model.sigma(confidence) / self.model.sigma(np.array(USUAL))

    def describe(self, names: tuple[str, ...]) -> str:
        """Return the estimate in a line.

        Args:
            names: Of the V cameras.
        """
        if not self.count:
            return "how far detections scatter was not learned, so usual values are used"
        # What residuals show of the calibration, in place of all that it may be off by.
        shown2 = self.usual_px**2 - np.median(self.calibration_px) ** 2 + self.displaced_px**2
        scatter = np.sqrt(max(shown2, _LEAST_PX**2))
        on_person = 1000 * self.usual_m * scatter / self.usual_px
        text = f"detected joints scatter by {scatter:.1f} px, {on_person:.0f} mm on the person"
        far = self.floor_px > 2 * np.median(self.floor_px) + 1
        if far.any():
            each = (
                f"{camera_label(name)} by {floor:.0f} px more" for name, floor in zip(names, self.floor_px, strict=True)
            )
            text += f"; {', '.join(one for one, off in zip(each, far, strict=True) if off)} (see dmae doctor)"
        if self.usual_m > _DOUBTFUL_M:
            text += (
                f"; detectors err by less than {1000 * _DOUBTFUL_M:.0f} mm: dmae doctor, with the same data=..., "
                "examines calibration and synchronisation"
            )
        if self.displaced_px > _DISAGREE * scatter:
            text += f"; calibrations are off by {self.displaced_px:.0f} px (see dmae doctor, dmae calibrate)"
        if self.constant.all():
            return f"{text}; confidences say nothing, so they are not used"
        if self.constant.any():
            silent = ", ".join(camera_label(name) for name, one in zip(names, self.constant, strict=True) if one)
            text += f"; confidences of {silent} say nothing"
        if self.confidences[-1] < self.confidences[0]:
            return f"{text}; greater confidences mean greater errors, and are used so"
        return text

    def summary(self, names: tuple[str, ...]) -> dict:
        """Return the estimate as JSON values, for the provenance of a clip with cameras `names`."""
        rounded = {
            "floor_px": self.floor_px, "calibration_px": self.calibration_px, "spread_mm": 1000 * self.spread_m,
            "scores": self.knots, "confidences": self.confidences,
        }  # fmt: skip
        return (
            {"found": self.describe(names), "observations": self.count}
            | {name: np.round(values, 3).tolist() for name, values in rounded.items()}
            | {"scores_say_nothing": self.constant.tolist()}
        )


_USUAL_M = 0.05  # m; sigma of a usual joint for which the distances of the configuration are made
_DOUBTFUL_M = 0.08  # m; sigma from which cameras rather than detectors are likely to be wrong


@dataclass(frozen=True)
class Residuals:
    """n detections that were compared with the points that they and others were triangulated to."""

    # view, joint: (n,) index
    view: np.ndarray
    joint: np.ndarray
    score: np.ndarray  # (n,) of the detector
    square: np.ndarray  # (n,) squared distance from the reprojected point without the calibration errors found, px^2
    scale: np.ndarray  # (n,) px per m at the person
    freedom: np.ndarray  # (n,) expected square relative to 2 sigma^2: less than 1 where the point follows the detection
    pair: np.ndarray  # (n,) True where only two views measured the point
    calibration_px: np.ndarray  # (V,) px; standard deviation of the calibration error of each camera
    displaced_px: np.ndarray  # (V,) px along one axis; root mean square of the part of it that residuals show


def residuals(
    rig: CameraRig, noise: DetectionNoise, xy: np.ndarray, score: np.ndarray, assigned: np.ndarray, points: Points
) -> Residuals:
    """Return the residuals of all assigned detections, also of those that triangulation left out.

    Args:
        rig: V pinhole cameras.
        noise: With which the points were triangulated.
        xy: (F, V, D, J, 2) undistorted px.
        score: (F, V, D, J) of the detector.
        assigned: (F, P, V, J) detections of the joints, negative for none.
        points: (F, P, J) triangulated from these.
    """
    confidence = noise.trusted(score)
    frame, person, view, joint = np.nonzero((assigned >= 0) & ~np.isnan(points.xyz[:, :, None, :, 0]))
    detection = assigned[frame, person, view, joint]
    place = frame, view, detection, joint
    xyz, used = points.xyz[frame, person, joint], points.used[frame, person, joint, view]
    P = rig.projections[view]
    homogeneous = (P[:, :, :3] @ xyz[..., None])[..., 0] + P[:, :, 3]
    depth = homogeneous[:, 2]
    pixel = homogeneous[:, :2] / depth[:, None]
    slope = (P[:, :2, :3] - pixel[..., None] * P[:, 2:, :3]) / depth[:, None, None]
    scale = rig.focal[view] / depth
    spread = noise.spread_m[joint] * noise.shape(confidence[place])
    weight = 1 / (noise.floor_px[view] ** 2 + (scale * spread) ** 2)
    shape = points.xyz.shape[:3]
    group = np.ravel_multi_index((frame, person, joint), shape)
    count = np.bincount(group, used, minlength=np.prod(shape))
    information = np.zeros((len(count), 3, 3))
    np.add.at(information, group[used], weight[used, None, None] * (slope[used].swapaxes(1, 2) @ slope[used]))
    known = count >= 2
    information[~known] = np.eye(3)
    cov = np.linalg.inv(information + 1e-9 * np.trace(information, axis1=1, axis2=2)[:, None, None] * np.eye(3))
    follows = weight * np.einsum("nij,njk,nik->n", slope, cov[group], slope) / 2
    freedom = np.where(used, 1 - follows, 1 + follows)
    off = pixel - xy[place]
    measured = used & known[group] & np.isfinite(off[:, 0])
    calibration, shift = _calibration_errors(rig.focal, off, slope, weight, cov, view, group, measured)
    square = ((off - shift) ** 2).sum(-1)
    seen = np.maximum(np.bincount(view[measured], minlength=len(rig)), 1)
    displaced = np.sqrt(np.bincount(view[measured], (shift[measured] ** 2).sum(-1), len(rig)) / (2 * seen))
    kept = known[group] & (depth > 0) & (freedom > 0.02) & np.isfinite(square) & np.isfinite(score[place])
    parts = view, joint, score[place], square, scale, freedom, used & (count[group] == 2)
    return Residuals(*(*(part[kept] for part in parts), calibration, displaced))


def _calibration_errors(
    focal: np.ndarray, off: np.ndarray, slope: np.ndarray, weight: np.ndarray, cov: np.ndarray,
    view: np.ndarray, group: np.ndarray, measured: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Estimate how far the calibration of each camera is off: it displaces its image by b_v, the same in all frames.

    Points follow the cameras, so residuals show b without what moves the points: for a point with Jacobians J, weights
    W and covariance C, they are b - J C J^T W b. A camera may therefore look right because points follow it, and
    thousands of residuals say no more about it than one displacement. So b_v is assumed to be normal with variance
    tau_v^2 along each axis. The mean m and the covariance P of b given the residuals follow by least squares; P is
    large for displacements that points follow. The expected square of b_v, from m and P, is two observations of
    tau_v^2; what the cameras share counts as `_SHARED`, and as less for an unusual camera (an inverse gamma prior, with
    the scale that fits best: Gelman et al., Bayesian Data Analysis, 3rd ed., ch. 5).

    Args:
        focal: (V,) px; displacements are in proportion to it.
        off: (n, 2) px from the detections to the reprojected points.
        slope: (n, 2, 3) px per m.
        weight: (n,) 1/px^2.
        cov: (m, 3, 3) m^2, of the points.
        view, group: (n,) indices of the camera and of the point.
        measured: (n,) True where the point was triangulated from the detection.

    Returns:
        tau (V,) px, and the part of `off` (n, 2) that m explains.
    """
    views, scale = len(focal), focal / focal.mean()
    if not measured.any():
        return np.zeros(views), np.zeros_like(off)
    size = np.sqrt(weight * (off**2).sum(-1))
    pull = np.where(measured, weight * np.minimum(1, 2 / np.maximum(size, 1e-9)) * scale[view], 0)
    by_view = np.zeros((len(cov), views, 2, 3))  # of a point, before its covariance: J^T W of each camera
    by_view[group[measured], view[measured]] = pull[measured, None, None] * slope[measured]
    moves = by_view.reshape(len(cov), 2 * views, 3)
    own = np.repeat(np.bincount(view, pull * scale[view], views), 2)
    information = np.diag(own) - np.einsum("gai,gij,gbj->ab", moves, cov, moves)
    told = np.stack([np.bincount(view[measured], (pull[:, None] * off)[measured, k], views) for k in (0, 1)], 1).ravel()
    seen = np.bincount(view[measured], minlength=views) > 0
    tau2 = np.full(views, max((off[measured] ** 2).mean(), _LEAST_PX**2))
    for _ in range(_ROUNDS):
        covariance = np.linalg.inv(information + np.diag(np.repeat(1 / tau2, 2)))
        mean = covariance @ told
        square = (mean**2 + np.diag(covariance)).reshape(views, 2).sum(1)
        usual2 = 1 / np.mean(1 / tau2[seen])
        shared = _SHARED * np.minimum(1, 2 * _UNUSUAL**2 * usual2 / square)
        tau2 = np.maximum((shared * usual2 + square) / (shared + 2), 1e-4)
    moved = np.einsum("gij,gaj,a->gi", cov, moves, mean)
    shift = scale[view, None] * mean.reshape(views, 2)[view] - (slope @ moved[group][..., None])[..., 0]
    return scale * np.sqrt(tau2), np.where(np.isfinite(shift), shift, 0)


def fit(found: Residuals, prior: DetectionNoise, start: DetectionNoise, skeleton: Skeleton) -> DetectionNoise:
    """Estimate the noise of detections from residuals, robustly.

    The expected square of a residual is the sum of two variances, one of the camera in pixels and one of the joint on
    the person. Each is scaled by the ratio of squares to what is expected, weighted by its share, until they agree
    (variance components, as by expectation maximisation: Searle, Casella & McCulloch, Variance Components, ch. 8).
    Large squares are clipped, and a prior counts as some observations, so that few residuals change little.

    Args:
        prior: What is assumed without residuals.
        start: An earlier estimate, from which this one starts.
        skeleton: Of the detections; left and right joints are of one kind.
    """
    if not len(found.view):
        return prior
    kinds, kind = np.unique(np.minimum(np.arange(len(prior.spread_m)), skeleton.mirror), return_inverse=True)
    scores, of = _binned(found, prior), kind[found.joint]
    parts = _components(found, prior, start, of, len(kinds), scores)
    constant, confidences = scores.constant, prior.confidences
    if scores.told.any():
        shape2, scored = parts.shape2, np.unique(scores.bin[scores.told])
        usual_floor2 = np.median(parts.floor2[np.unique(found.view)])
        each = np.sqrt(usual_floor2 + np.median(found.scale) ** 2 * parts.level2 * shape2[scored])
        constant = constant | (each.max() < (1 + _SAYS) * each.min())
        model = prior.model
        usual = float(model.sigma(np.array(USUAL)))
        sigma_m = usual * np.sqrt(shape2[:-1])
        confidences = (model.sigma_unsure_m - sigma_m) / (model.sigma_unsure_m - model.sigma_sure_m)
        if confidences[1] > confidences[-1]:
            confidences[0] = confidences[1]
        confidences = np.clip(confidences, 0, 1)
    floor2 = parts.floor2 + found.calibration_px**2
    sigma = np.sqrt(floor2[found.view] + parts.spread2(found.scale**2, of, scores.bin))
    return replace(
        prior,
        floor_px=np.sqrt(floor2),
        calibration_px=found.calibration_px,
        spread_m=np.sqrt(parts.level2 * parts.kind2[kind]),
        knots=scores.knots,
        confidences=confidences,
        constant=constant,
        count=len(of),
        usual_px=float(np.median(sigma)),
        usual_m=float(np.median(sigma / found.scale)),
        displaced_px=float(np.sqrt(np.mean(found.displaced_px**2))),
    )


class _Scores(NamedTuple):
    """The scores of n residuals in K bins, each around a knot."""

    constant: np.ndarray  # (V,) True for cameras whose scores are all equal
    told: np.ndarray  # (n,) True for scores of other cameras
    knots: np.ndarray  # (K,) scores, ascending
    bin: np.ndarray  # (n,) number of the nearest knot; K if the camera's scores say nothing
    shape2: np.ndarray  # (K + 1,) what is assumed of the variance in each bin, relative to that at a usual confidence


def _binned(found: Residuals, prior: DetectionNoise) -> _Scores:
    """Divide the scores of a recording into bins, by their quantiles."""
    views = len(prior.floor_px)
    constant = np.array([_constant(found.score[found.view == v]) for v in range(views)])
    constant |= all(constant[np.bincount(found.view, minlength=views) > 0])
    told = ~constant[found.view]
    knots = prior.knots
    if told.any():
        # Scores below the least one are as prior confidences are.
        middles = np.quantile(found.score[told], (_BINS[:-1] + _BINS[1:]) / 2)
        knots = np.unique(np.append(min(0.0, middles[0]), middles))
    bins = np.where(told, np.abs(found.score[:, None] - knots).argmin(1), len(knots))
    usual = prior.shape(prior.trusted(np.broadcast_to(knots, (views, 1, len(knots))))[0, 0])
    if told.any() and (np.median(found.score[told]) > 1 or _inverted(found, told)):
        usual = np.ones(len(knots))  # what scores in another unit than 0 to 1, or inverted ones, mean is unknown
    return _Scores(constant, told, knots, bins, np.append(np.clip(usual, 0.4, 2.5), 1.0) ** 2)


class _Components(NamedTuple):
    """The parts of the variance of detections."""

    floor2: np.ndarray  # (V,) px^2, of each camera, without the calibration
    level2: float  # m^2, on the person, of a usual joint with a usual confidence
    kind2: np.ndarray  # Of each kind of joint, relative to that
    shape2: np.ndarray  # (K + 1,) of each bin of scores, relative to that

    def spread2(self, scale2: np.ndarray, kind: np.ndarray, bins: np.ndarray) -> np.ndarray:
        """Return the variance on the person of residuals, px^2, from px^2 per m^2, kinds and bins, all (n,)."""
        return scale2 * self.level2 * self.kind2[kind] * self.shape2[bins]


def _components(
    found: Residuals, prior: DetectionNoise, start: DetectionNoise, kind: np.ndarray, kinds: int, scores: _Scores
) -> _Components:
    """Estimate the parts of the variance, each in turn, until they agree.

    Args:
        found, prior, start: As for `fit`.
        kind: (n,) number of the kind of joint of each residual.
        kinds: How many there are.
        scores: Bins of the scores.
    """
    expected = np.where(found.pair, *_EXPECTED)
    half, most, scale2 = found.square / (2 * found.freedom * expected), _CLIPPED / expected, found.scale**2
    # Variances that start too small change slowly.
    middle = np.median(found.square / found.freedom) / 4
    level2, usual_level2 = float(np.mean(start.spread_m**2)), float(np.mean(prior.spread_m**2))
    now = _Components(np.maximum(start.jitter_px**2, middle), level2, np.ones(kinds), scores.shape2)

    def factor(group: np.ndarray, on_person: bool, before: np.ndarray) -> np.ndarray:
        """Return the factor of the variance of each group, for a prior by which it is `before` times as large."""
        floor, spread2 = now.floor2[found.view], now.spread2(scale2, kind, scores.bin)
        sigma2 = floor + spread2
        share = found.freedom * (spread2 if on_person else floor) / sigma2
        square = np.minimum(half / sigma2, most)
        size, total = (np.bincount(group, weight, minlength=len(before)) for weight in (share, share * square))
        told = np.log(np.maximum(total, 1e-12) / np.maximum(size, 1e-12))
        return np.exp((size * told + _PRIOR * np.log(before)) / (size + _PRIOR))

    everything = np.zeros(len(kind), int)
    for _ in range(_ROUNDS):
        floor2 = now.floor2 * factor(found.view, False, prior.floor_px**2 / now.floor2)
        now = now._replace(floor2=np.maximum(floor2, _LEAST_PX**2))
        now = now._replace(level2=now.level2 * factor(everything, True, np.array([usual_level2 / now.level2]))[0])
        now = now._replace(kind2=now.kind2 * factor(kind, True, 1 / now.kind2))
        now = now._replace(shape2=now.shape2 * factor(scores.bin, True, scores.shape2 / now.shape2))
        # Kinds and confidences say how joints differ from each other; the level belongs to all joints.
        mean = now.kind2[kind].mean()
        now = now._replace(kind2=now.kind2 / mean, level2=max(now.level2 * mean, _LEAST_M**2))
        mean = now.shape2[scores.bin].mean()
        now = now._replace(shape2=now.shape2 / mean, level2=max(now.level2 * mean, _LEAST_M**2))
    return now


def _inverted(found: Residuals, told: np.ndarray) -> bool:
    """Return whether residuals grow with the scores, beyond three standard errors of their rank correlation."""
    size = found.square[told] / (found.freedom[told] * found.scale[told] ** 2)
    ranks = [values.argsort().argsort() for values in (found.score[told], size)]
    return np.corrcoef(ranks)[0, 1] * np.sqrt(told.sum()) > 3


def _constant(score: np.ndarray) -> bool:
    """Return whether nearly all scores are equal, as of detectors without confidences."""
    return not len(score) or np.mean(np.abs(score - np.median(score)) < 1e-3) > 0.99
