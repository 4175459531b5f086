"""Uncertainty of completed joints: predicted scales, calibrated to the errors found on held-back clips."""

from __future__ import annotations

import numpy as np

from dmae.metrics.position import GAPS

Factors = tuple[tuple[float, ...], tuple[float, ...]]
"""Of exact poses and of noisy ones, each for the classes of gaps."""

CLASSES = len(GAPS) + 1
"""Of gaps: those that scores distinguish, and joints never measured."""


def calibrated(scale: np.ndarray, lengths: np.ndarray, noisy: np.ndarray, factors: Factors) -> np.ndarray:
    """Return standard deviations along each axis, m, of joints with predicted scales `scale` (...), m.

    Args:
        lengths: (...) of the gaps that the joints are in, frames at the model's rate; infinite where they are never
            measured.
        noisy: (...) see `dmae.completion.features.noisiness`.
        factors: Of exact poses and of noisy ones, each for `GAPS` and for joints never measured.
    """
    of_exact, of_noisy = np.log(factors)[:, gap_classes(lengths)]
    return np.exp(of_exact + noisy * (of_noisy - of_exact)) * scale


def gap_classes(lengths: np.ndarray) -> np.ndarray:
    """Return the index in `GAPS` of gaps of those lengths; one more where they are infinite."""
    return np.searchsorted([*(high for _, high in GAPS if high), np.finfo(float).max], np.rint(lengths))
