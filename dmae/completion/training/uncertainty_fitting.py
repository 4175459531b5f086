"""Fitting of the factors that calibrate predicted uncertainty, on held-back poses."""

from collections.abc import Iterable

import numpy as np

from dmae.completion.completer import Completer
from dmae.completion.uncertainty import CLASSES, Factors, gap_classes
from dmae.data.clip import Poses3D
from dmae.metrics.position import REGION_PROBABILITY, REGION_RADIUS

_FEWEST = 200
"""Joints of a class of gaps from which its own factor is fitted."""


def fit_factors(complete: Completer, held_back: Iterable[tuple[Poses3D, Poses3D]], fps: float) -> Factors | None:
    """Fit the factors with which regions of 90 % hold 90 % of the truth, by length of gap.

    Args:
        complete: With factors of 1: the standard deviation of completed joints is the predicted scale.
        held_back: Measured poses and their truth, at the model's rate; not used in training.

    Returns:
        As for `calibrated`; classes with few joints take the factor of all. None if there are few in all.
    """
    found = []
    for measured, truth in held_back:
        done = complete(measured, fps)
        deviation = np.sqrt(done.cov[..., 0, 0].astype(np.float64))
        ratio = np.linalg.norm(done.xyz.astype(np.float64) - truth.xyz, axis=-1) / deviation
        lengths, noisy = complete.uncertainty_inputs(measured, fps)
        columns = np.broadcast_arrays(ratio, gap_classes(lengths), noisy > 0.5)
        found.append(np.stack([column[np.isfinite(ratio)] for column in columns]))
    ratio, number, noisy = np.concatenate(found or [np.empty((3, 0))], 1)

    def factor(*groups: np.ndarray) -> float:
        enough = next(group for group in groups if group.sum() >= _FEWEST)
        return float(np.quantile(ratio[enough], REGION_PROBABILITY) / REGION_RADIUS)

    if len(ratio) < _FEWEST:
        return None
    everything = np.ones(len(ratio), bool)
    return tuple(
        tuple(factor((number == i) & kind, number == i, kind, everything) for i in range(CLASSES))
        for kind in (noisy == 0, noisy == 1)
    )
