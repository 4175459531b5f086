"""A prediction and the truth: the input of every metric."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from dmae.data.clip import Poses3D, Source
from dmae.data.conversion import scale_of
from dmae.data.skeleton import Skeleton
from dmae.metrics.matching import GATE, match, take_matched
from dmae.numerics.paths import gap_lengths

GAP_RATE = 25.0
"""Frames/s in which lengths of gaps are stated, for clips of any frame rate."""


@dataclass(frozen=True, eq=False)
class Comparison:
    """A prediction and the truth to compare it with, on one skeleton of J joints.

    Attributes:
        pred: P predicted persons.
        captured: The same persons before anything was filled; defines which joints were hidden.
        truth: T true persons.
        actors: True persons that PCP is averaged over.
        matches: (F, T) index of the prediction that matches each true person, -1 for none; by default from `match`.
        fps: Frames per second.
        compared: (F, T, J) True where joints count for the error by gap; None for all.

    Raises:
        ValueError: prediction and captured poses differ in shape.
    """

    pred: Poses3D
    captured: Poses3D
    truth: Poses3D
    actors: tuple[int, ...]
    matches: np.ndarray = None
    fps: float = GAP_RATE
    compared: np.ndarray | None = None

    def __post_init__(self):
        if self.captured.source.shape != self.pred.source.shape:
            raise ValueError(
                f"captured {self.captured.source.shape} and filled poses {self.pred.source.shape} differ in shape"
            )
        if self.matches is None:
            object.__setattr__(self, "matches", match(self.pred.xyz, self.truth.xyz, self.scale * GATE))

    @cached_property
    def scale(self) -> float:
        """Size of the bodies relative to people. Thresholds in metres are multiplied by it."""
        return scale_of(self.truth)

    @property
    def skeleton(self) -> Skeleton:
        return self.truth.skeleton

    @cached_property
    def known(self) -> np.ndarray:
        """(F, T, J) True for joints that the truth contains."""
        return ~np.isnan(self.truth.xyz).any(-1)

    @cached_property
    def matched(self) -> np.ndarray:
        """(F, T, J, 3) predictions in the order of the truth, m; NaN where a person is missed."""
        return take_matched(self.pred.xyz, self.matches)

    @cached_property
    def source(self) -> np.ndarray:
        """(F, T, J) `Source` of the matched predictions, ABSENT where a person is missed."""
        return take_matched(self.pred.source, self.matches, Source.ABSENT)

    @cached_property
    def cov(self) -> np.ndarray:
        """(F, T, J, 3, 3) covariance of matched predictions, plus that of the truth if it was itself measured, m^2."""
        return take_matched(self.pred.cov, self.matches) + np.nan_to_num(self.truth.cov)

    @cached_property
    def hidden(self) -> np.ndarray:
        """(F, T, J) True where capture did not measure the joint."""
        return ~take_matched(self.captured.measured, self.matches, False)

    @cached_property
    def gap_lengths(self) -> np.ndarray:
        """(F, T, J) length of the gap around each joint in frames at `GAP_RATE`; 0 where the joint was measured."""
        lengths = np.ceil(gap_lengths(self.captured.measured) * (GAP_RATE / self.fps) - 1e-6)
        return take_matched(lengths, self.matches, 0)
