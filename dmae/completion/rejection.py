"""Rejection: measured joints that cannot be right, because the frames around contradict them."""

from math import prod

import numpy as np
from scipy.ndimage import maximum_filter1d

from dmae.numerics.paths import neighbours, pchip_between, surrounding_frames, take_samples

_REACHES = (0.04, 0.1, 0.2)
"""s that are left out on either side of a sample with it: errors last for several frames."""
_LONGEST = 0.6
"""s; samples farther apart than this do not predict what is between them."""
_ERROR = 0.05
"""m; a deviation that measurement noise explains."""
ACCELERATION = 20.0
"""m/s^2; a deviation that motion explains has at most this acceleration."""


def contradicted(xyz: np.ndarray, fps: float, acceleration: float = ACCELERATION) -> np.ndarray:
    """Find samples that monotone cubics through the other frames contradict.

    A sample is predicted from the two samples before and the two after it, leaving out those nearest to it. It is
    contradicted when its deviation exceeds measurement noise plus the greatest acceleration over that time. Of
    samples near each other only the worst is dropped, and the others are judged again without it. The constants are
    those with which simulated captures came out nearest the truth. Allowing for the covariance of samples made it
    worse: uncertain samples are wrong more often.

    Args:
        xyz: (F, ..., 3) m, NaN where not measured.
        acceleration: m/s^2, the greatest that people are assumed to reach.

    Returns:
        (F, ...) True where a sample is contradicted.
    """
    flat = xyz.reshape(len(xyz), prod(xyz.shape[1:-1]), 3).astype(np.float64)
    near = 2 * max(round(max(_REACHES) * fps), 1) + 1
    found = np.zeros(flat.shape[:2], bool)
    remaining = np.arange(flat.shape[1])
    while len(remaining):
        paths = np.where(found[:, remaining, None], np.nan, flat[:, remaining])
        worst = np.max([_deviation(paths, fps, max(round(reach * fps), 1), acceleration) for reach in _REACHES], axis=0)
        bad = (worst > 1) & (worst == maximum_filter1d(worst, near, axis=0, mode="constant"))
        found[:, remaining] |= bad
        remaining = remaining[bad.any(0)]
    return found.reshape(xyz.shape[:-1])


def _deviation(paths: np.ndarray, fps: float, reach: int, acceleration: float) -> np.ndarray:
    """Return the deviation of samples of paths (F, n, 3) as a multiple of the tolerance, (F, n); 0 where unknown."""
    known = ~np.isnan(paths).any(-1)
    before, after = neighbours(known)
    frame, column = np.nonzero(known)
    times = surrounding_frames(before, after, frame, column, reach)
    predictable = (times[1] >= 0) & (times[2] < len(paths)) & (times[2] - times[1] <= _LONGEST * fps)
    frame, column, times = frame[predictable], column[predictable], times[:, predictable]
    predicted = pchip_between(times, take_samples(paths, times, column), frame)
    deviation = np.zeros(known.shape)
    tolerance = _ERROR + acceleration / 2 * (frame - times[1]) * (times[2] - frame) / fps**2
    deviation[frame, column] = np.linalg.norm(paths[frame, column] - predicted, axis=-1) / tolerance
    return deviation
