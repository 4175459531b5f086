"""Measured joints that cannot be right, because the frames around them say otherwise."""

from math import prod

import numpy as np
from scipy.ndimage import maximum_filter1d

from dmae.gaps import neighbours
from dmae.series import around, pchip_between, take_at

_REACHES = (0.04, 0.1, 0.2)
"""s left out on either side of a sample with it: what goes wrong goes wrong for several frames."""
_LONGEST = 0.6
"""s; over a longer stretch the frames around prove nothing."""
_ERROR = 0.05
"""m; a deviation that noise explains."""
ACCELERATION = 20.0
"""m/s^2; motion that does explains a deviation, too."""


def contradicted(xyz: np.ndarray, fps: float, acceleration: float = ACCELERATION) -> np.ndarray:
    """Samples that monotone cubics through the other frames contradict.

    A sample is foretold from the two before and the two after it, those nearest to it left out. It is
    contradicted when it is off by more than an error and the greatest acceleration over that time explain. Of
    samples near each other only the worst is dropped, and the others then judged without it. The constants are
    those with which people captured in simulation came out nearest the truth; allowing for the covariance of
    samples made it worse: what is unsure is wrong more often.

    Args:
        xyz: (F, ..., 3) m, NaN where not measured.
        acceleration: m/s^2, what people are thought able to do.

    Returns:
        (F, ...) True where a sample is contradicted.
    """
    flat = xyz.reshape(len(xyz), prod(xyz.shape[1:-1]), 3).astype(np.float64)
    near = 2 * max(round(max(_REACHES) * fps), 1) + 1
    found = np.zeros(flat.shape[:2], bool)
    unsettled = np.arange(flat.shape[1])
    while len(unsettled):
        paths = np.where(found[:, unsettled, None], np.nan, flat[:, unsettled])
        worst = np.max([_deviation(paths, fps, max(round(reach * fps), 1), acceleration) for reach in _REACHES], axis=0)
        bad = (worst > 1) & (worst == maximum_filter1d(worst, near, axis=0, mode="constant"))
        found[:, unsettled] |= bad
        unsettled = unsettled[bad.any(0)]
    return found.reshape(xyz.shape[:-1])


def _deviation(paths: np.ndarray, fps: float, reach: int, acceleration: float) -> np.ndarray:
    """(F, n) how far samples of paths (F, n, 3) are off, as a multiple of what is allowed; 0 where nobody can tell."""
    known = ~np.isnan(paths).any(-1)
    before, after = neighbours(known)
    frame, column = np.nonzero(known)
    times = around(before, after, frame, column, reach)
    told = (times[1] >= 0) & (times[2] < len(paths)) & (times[2] - times[1] <= _LONGEST * fps)
    frame, column, times = frame[told], column[told], times[:, told]
    off = np.linalg.norm(paths[frame, column] - pchip_between(times, take_at(paths, times, column), frame), axis=-1)
    deviation = np.zeros(known.shape)
    explained = _ERROR + acceleration / 2 * (frame - times[1]) * (times[2] - frame) / fps**2
    deviation[frame, column] = off / explained
    return deviation
