"""How sure completed joints are: scales that a model states, brought to what its errors turn out to be."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np

from dmae.clip import Poses3D
from dmae.metrics import GAPS, RADIUS, SHARE

if TYPE_CHECKING:
    from dmae.complete import Completer

Factors = tuple[tuple[float, ...], tuple[float, ...]]

_FEWEST = 200
"""Joints of a class of gaps by which it is calibrated for itself."""

CLASSES = len(GAPS) + 1
"""Of gaps: those that scores tell apart, and joints never measured."""


def inflated(scale: np.ndarray, lengths: np.ndarray, captured: np.ndarray, factors: Factors) -> np.ndarray:
    """Standard deviations along each axis, m, of joints whose stated scales are `scale` (...), m.

    Args:
        lengths: (...) of the gaps that the joints are in, frames at the model's rate; infinite where they are never
            measured.
        captured: (...) see `dmae.trust.as_captured`.
        factors: Of exact poses and of captured ones, each for `dmae.metrics.GAPS` and for what is never measured.
    """
    exact, noisy = np.log(factors)[:, _classes(lengths)]
    return np.exp(exact + captured * (noisy - exact)) * scale


def fit_factors(complete: Completer, held_back: Iterable[tuple[Poses3D, Poses3D]], fps: float) -> Factors | None:
    """The factors by which regions of 90 % hold 90 % of the truth, by length of gap.

    Args:
        complete: With factors of 1: it gives what it completes the stated scale as standard deviation.
        held_back: Measured poses and the truth of them, at the model's rate; no part of the training.

    Returns:
        As for `inflated`; classes with few joints take that of all. None if there are few in all.
    """
    found = []
    for measured, truth in held_back:
        done = complete(measured, fps)
        deviation = np.sqrt(done.cov[..., 0, 0].astype(np.float64))
        ratio = np.linalg.norm(done.xyz.astype(np.float64) - truth.xyz, axis=-1) / deviation
        lengths, captured = complete.doubts(measured, fps)
        columns = np.broadcast_arrays(ratio, _classes(lengths), captured > 0.5)
        found.append(np.stack([column[np.isfinite(ratio)] for column in columns]))
    ratio, number, captured = np.concatenate(found or [np.empty((3, 0))], 1)

    def factor(*groups: np.ndarray) -> float:
        enough = next(group for group in groups if group.sum() >= _FEWEST)
        return float(np.quantile(ratio[enough], SHARE) / RADIUS)

    if len(ratio) < _FEWEST:
        return None
    everything = np.ones(len(ratio), bool)
    return tuple(
        tuple(factor((number == i) & kind, number == i, kind, everything) for i in range(CLASSES))
        for kind in (captured == 0, captured == 1)
    )


def _classes(lengths: np.ndarray) -> np.ndarray:
    """Which of `dmae.metrics.GAPS` gaps of those lengths are in, and one more where they are infinite."""
    return np.searchsorted([*(high for _, high in GAPS if high), np.finfo(float).max], np.rint(lengths))
