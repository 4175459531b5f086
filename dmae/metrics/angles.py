"""Metrics of joint angles: errors of hips, knees and ankles in degrees, and whether stated deviations predict them."""

from functools import lru_cache

import numpy as np
from scipy.special import ndtr

from dmae.data.clip import Poses3D
from dmae.metrics.comparison import Comparison, take_matched
from dmae.metrics.registry import metric
from dmae.numerics.kinematics import ANGLES, NoBody, body_motion, can_move, joint_angles
from dmae.numerics.statistics import mean_known

JUDGED = {"hips": "hip_flexion", "knees": "knee_angle", "ankles": "ankle_angle"}
"""The angles of the legs that are judged, left and right together."""
SHOWN_BY = {
    "hips": ("hip", "knee", "shoulder"),
    "knees": ("hip", "knee", "ankle"),
    "ankles": ("knee", "ankle", "big_toe", "heel"),
}
"""The joints that show each of these angles, on the same side of the body."""
_COLUMNS = [[n for n, angle in enumerate(ANGLES) if angle.name.startswith(name)] for name in JUDGED.values()]
_LEVELS = np.arange(1, 10) / 10  # Probabilities of the intervals over which the calibration error is averaged
LEVEL = 0.9
"""Probability of the intervals whose share of true angles is stated."""


def leg_angles(poses: Poses3D) -> tuple[np.ndarray, np.ndarray]:
    """Return the angles of `JUDGED` (F, P, 3, 2), degrees, right sides first, and their standard deviations.

    They are NaN where joints do not determine them, and everywhere for skeletons that have no hips and shoulders.
    """
    found = np.full((2, *poses.xyz.shape[:2], len(JUDGED), 2), np.nan)
    for person in range(poses.xyz.shape[1]) if can_move(poses.skeleton) else ():
        try:
            motion = body_motion(poses, person)
        except NoBody:
            continue
        found[:, :, person] = np.stack(joint_angles(motion))[..., _COLUMNS]
    return found[0], found[1]


@lru_cache(maxsize=1)
def angle_errors(comparison: Comparison) -> tuple[np.ndarray, np.ndarray]:
    """Return errors (F, T, 3, 2) of the angles of `JUDGED`, degrees, and stated standard deviations; NaN if unknown.

    A body is fitted to what matches a true person, whatever the prediction contains elsewhere.
    """
    cov = take_matched(comparison.pred.cov, comparison.matches)
    matched = Poses3D(comparison.skeleton, comparison.matched, comparison.source, cov)
    values, spread = leg_angles(matched)
    return (values - comparison.angles + 180) % 360 - 180, spread


def calibration(error: np.ndarray, spread: np.ndarray) -> dict[str, float]:
    """Return how well standard deviations predict errors, both of any shape; NaN does not count.

    Returns:
        `held`, % of the true angles in the 90 % interval; `ece`, the expected calibration error: the mean difference,
        over intervals of 10 % to 90 %, of this share and the probability (Kuleshov et al., ICML 2018).
    """
    level = _level(error, spread)
    level = level[~np.isnan(level)]
    if not len(level):
        return {"held": float("nan"), "ece": float("nan")}
    shares = (level[:, None] <= _LEVELS).mean(0)
    return {"held": float(100 * (level <= LEVEL).mean()), "ece": float(np.abs(shares - _LEVELS).mean())}


def in_interval(error: np.ndarray, spread: np.ndarray) -> np.ndarray:
    """Return where the true angle is within the interval of probability `LEVEL`; False where it is not known."""
    return _level(error, spread) <= LEVEL


def _level(error: np.ndarray, spread: np.ndarray) -> np.ndarray:
    """Return the probability of the smallest interval that contains the true angle."""
    return 2 * ndtr(np.abs(error) / spread) - 1


@metric("angles", order=11)
def _angles(comparison: Comparison) -> dict[str, float] | None:
    """MAE of joint angles of hips, knees, ankles, degrees, bias, and calibration; only with `angles=true`."""
    if comparison.angles is None:
        return None
    error, spread = angle_errors(comparison)
    known = ~np.isnan(comparison.angles)
    size = mean_known(np.abs(error), (0, 1, 3))
    return (
        {"mae": float(mean_known(np.abs(error), None)), "bias": float(mean_known(error, None))}
        | dict(zip(JUDGED, map(float, size), strict=True))
        | {"determined": float(100 * mean_known(np.where(known, ~np.isnan(error), np.nan), None))}
        | calibration(error, spread)
    )
