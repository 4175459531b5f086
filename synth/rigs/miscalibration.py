"""Miscalibration: a calibration that differs from the true cameras, and its error in pixels."""

from dataclasses import dataclass, replace

import numpy as np

from dmae.data.cameras import CameraRig
from synth.rigs.coverage import Stage, area
from synth.rigs.displacement import check_deviations, displace


@dataclass(frozen=True)
class MiscalibrationConfig:
    """Errors of the calibration that a clip stores as its rig.

    Pictures and labels are those of the true cameras, which the clip stores as `true_rig`. Drawn for each clip and
    camera, normally distributed; the values are standard deviations.

    Attributes:
        focal: Relative error of the focal length (of its logarithm).
        principal_point: Along each axis, px.
        distortion: Of k1, for both lens models.
        rotation: About each axis of the camera, rad.
        translation: Of the camera's centre along each axis, m.
    """

    focal: float = 0.0
    principal_point: float = 0.0
    distortion: float = 0.0
    rotation: float = 0.0
    translation: float = 0.0

    def __post_init__(self):
        check_deviations("rig.error", self)


def miscalibrate(rig: CameraRig, config: MiscalibrationConfig, *, rng: np.random.Generator) -> CameraRig | None:
    """Return a random calibration of a rig; None if all errors are 0."""
    if config == MiscalibrationConfig():
        return None
    reported = displace(rig, config.translation, config.rotation, rng=rng)
    focal, k1, *point = rng.normal(size=(4, len(rig)))
    K, dist = rig.K.copy(), rig.dist.copy()
    # The exponential keeps focal lengths positive.
    K[:, :2, :2] *= np.exp(config.focal * focal)[:, None, None]
    K[:, :2, 2] += config.principal_point * np.transpose(point)
    dist[:, 0] += config.distortion * k1
    return replace(reported, K=K, dist=dist)


def calibration_error(true: CameraRig, reported: CameraRig, stage: Stage) -> list[float]:
    """Return the root mean square reprojection error of each camera over the people's area, px."""
    points = area(stage).reshape(1, -1, 3)
    xy = true.project(points)[0]
    square = np.where(true.inside(xy), ((reported.project(points)[0] - xy) ** 2).sum(-1), np.nan)
    counted = np.isfinite(square[0])
    return np.sqrt(np.nansum(square[0], 1) / counted.sum(1).clip(1)).round(3).tolist()
