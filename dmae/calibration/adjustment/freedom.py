"""Freedom: which parameters of cameras an adjustment may change."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dmae.calibration.adjustment.parameters import CENTRE, DRIFT, FOCAL, K1, K2, OFFSET, ROTATION, Q


@dataclass(frozen=True)
class Freedom:
    """The parameters that may change, and the expected size of their changes.

    Attributes:
        free: (V, Q) True for parameters that may change.
        prior: (V, Q) standard deviation of their change, inf where nothing is known.
        robust_prior: True if most cameras should stay and a few may move far (Cauchy); False if all move a little.
    """

    free: np.ndarray
    prior: np.ndarray
    robust_prior: bool = False

    @classmethod
    def of(
        cls,
        views: int,
        only: list[int] | None = None,
        *,
        rotation: bool = False,
        centre: bool = False,
        focal: bool = False,
        k1: bool = False,
        k2: bool = False,
        offset: bool = False,
        drift: bool = False,
    ) -> Freedom:
        """Return the freedom of the named parameters, of all views or of some."""
        free = np.zeros((views, Q), bool)
        rows = slice(None) if only is None else only
        for part, wanted in (
            (ROTATION, rotation),
            (CENTRE, centre),
            (FOCAL, focal),
            (K1, k1),
            (K2, k2),
            (OFFSET, offset),
            (DRIFT, drift),
        ):
            free[rows, part] = wanted
        return cls(free, np.full((views, Q), np.inf))
