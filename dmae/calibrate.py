"""How sure completed joints are: scales that a model states, brought to what its errors turn out to be."""

from collections.abc import Callable, Iterable

import numpy as np

from dmae.clip import Poses3D
from dmae.metrics import GAPS, RADIUS, SHARE, gap_lengths

_FEWEST = 200
"""Joints of a class of gaps by which it is calibrated for itself."""


def inflated(scale: np.ndarray, lengths: np.ndarray, factors: tuple[float, ...]) -> np.ndarray:
    """Standard deviations along each axis, m, of joints whose stated scales are `scale` (...), m.

    Args:
        lengths: (...) of the gaps that the joints are in, frames at the model's rate.
        factors: One for each of `dmae.metrics.GAPS`.
    """
    return np.asarray(factors)[_classes(lengths)] * scale


def fit_factors(
    complete: Callable[[Poses3D, float], Poses3D], held_back: Iterable[tuple[Poses3D, Poses3D]], fps: float
) -> tuple[float, ...] | None:
    """The factors by which regions of 90 % hold 90 % of the truth, by length of gap.

    Args:
        complete: Completes poses and gives what it completes the stated scale as standard deviation.
        held_back: Measured poses and the truth of them, at the model's rate; no part of the training.

    Returns:
        One for each of `dmae.metrics.GAPS`; classes with few joints take that of all. None if there are few in all.
    """
    ratios, classes = [], []
    for measured, truth in held_back:
        done = complete(measured, fps)
        deviation = np.sqrt(done.cov[..., 0, 0].astype(np.float64))
        ratio = np.linalg.norm(done.xyz.astype(np.float64) - truth.xyz, axis=-1) / deviation
        known = np.isfinite(ratio)
        ratios.append(ratio[known])
        classes.append(_classes(gap_lengths(done.measured))[known])
    ratio, found = np.concatenate(ratios or [[]]), np.concatenate(classes or [[]])
    if len(ratio) < _FEWEST:
        return None
    groups = [ratio[found == number] for number in range(len(GAPS))]
    return tuple(float(np.quantile(group if len(group) >= _FEWEST else ratio, SHARE) / RADIUS) for group in groups)


def _classes(lengths: np.ndarray) -> np.ndarray:
    """Which of `dmae.metrics.GAPS` gaps of those lengths are in."""
    return np.searchsorted([high for _, high in GAPS if high], np.rint(lengths))
