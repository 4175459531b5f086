"""Percentages of what is known, and the sources of joints as percentages."""

import numpy as np

from dmae.data.clip import Source
from dmae.metrics.comparison import Comparison
from dmae.metrics.registry import Column, metric
from dmae.numerics.statistics import mean_known


def percent(counted: np.ndarray, known: np.ndarray, axis=None):
    """Return the percentage of the `known` entries that are `counted`, over some axes; NaN where nothing is known."""
    return 100 * mean_known(np.where(known, counted, np.nan), axis)


def source_shares(source: np.ndarray, known: np.ndarray) -> dict[str, float]:
    """Return the percentages of the true joints that are absent, measured, denoised and completed.

    Args:
        source: (F, T, J) `Source` of the matched predictions, ABSENT for missed persons.
        known: (F, T, J) True for joints that are true.
    """
    return {kind.name.lower(): float(percent(source == kind, known)) for kind in Source}


@metric(
    "shares",
    order=7,
    columns=(
        Column("filled", "%", lambda shares: shares["completed"], order=3),
        Column("absent", "%", lambda shares: shares["absent"], order=4),
    ),
)
def _shares(comparison: Comparison) -> dict[str, float]:
    """True joints that are absent, measured, denoised, completed, %."""
    return source_shares(comparison.source, comparison.known)
