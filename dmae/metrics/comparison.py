"""A prediction and its truth, matched person by person: the input of every metric."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.optimize import linear_sum_assignment

from dmae.data.array_fields import UNSET
from dmae.data.clip import Poses3D, Source
from dmae.data.conversion import scale_of
from dmae.data.skeleton import Skeleton
from dmae.numerics.filling import are_stills
from dmae.numerics.paths import gap_lengths
from dmae.numerics.statistics import mean_known

GATE = 0.5
"""m; a prediction with a larger mean distance of its joints is another person. It applies to bodies of human size."""


def match(pred: np.ndarray, truth: np.ndarray, gate: float = GATE, missing: float | None = None) -> np.ndarray:
    """Assign predictions (F, P, J, 3) m to true persons (F, T, J, 3) m, each once in a frame (Hungarian algorithm).

    The cost of a pair is the mean distance over the true joints, with each distance limited to the gate, m. A joint
    that is not predicted costs `missing`, m, by default the gate, so that a single hand does not replace a whole body.
    A pair is allowed if the mean distance of its common joints is within the gate. The assignment matches as many
    persons as possible, with the least cost. Returns indices (F, T) of predictions, -1 if a true person is missed or
    absent.
    """
    matches = np.full(truth.shape[:2], -1)
    distance = distances(pred, truth)
    allowed = mean_known(distance, -1) <= gate
    cost = np.where(np.isnan(distance), gate if missing is None else missing, np.minimum(distance, gate))
    cost = mean_known(np.where(np.isnan(truth).any(-1)[:, :, None], np.nan, cost), -1)
    # A forbidden pair costs more than any number of allowed pairs.
    cost = np.where(allowed, cost, 1 + gate * (1 + min(cost.shape[1:])))
    for frame in np.flatnonzero(allowed.any((1, 2))):
        rows, columns = linear_sum_assignment(cost[frame])
        kept = allowed[frame, rows, columns]
        matches[frame, rows[kept]] = columns[kept]
    return matches


def match_nearest(pred: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Assign to every true person the nearest prediction, which persons may share, without a gate, as in `match`."""
    if not pred.shape[1]:
        return np.full(truth.shape[:2], -1)
    mean = mean_known(distances(pred, truth), -1)
    return np.where(np.isnan(mean).all(-1), -1, np.nan_to_num(mean, nan=np.inf).argmin(-1))


def match_claimed(pred: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Assign predictions to their nearest true person within `GATE`; the first one counts; arrays as in `match`."""
    if 0 in (pred.shape[1], truth.shape[1]):
        return np.full(truth.shape[:2], -1)
    mean = np.nan_to_num(mean_known(distances(pred, truth), -1), nan=np.inf)
    claims = (mean == mean.min(1, keepdims=True)) & (mean < GATE)
    return np.where(claims.any(-1), claims.argmax(-1), -1)


def distances(pred: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Return (F, T, P, J) distances, m, between every true person and every prediction; NaN where one is absent."""
    return np.linalg.norm(pred[:, None] - truth[:, :, None].astype(np.float64), axis=-1)


def take_matched(array: np.ndarray, matches: np.ndarray, missing=np.nan) -> np.ndarray:
    """Reorder (F, P, ...) by predictions to (F, T, ...) by true persons; `missing` where a person has no prediction."""
    taken = np.full((*matches.shape, *array.shape[2:]), missing, array.dtype)
    frame, person = np.nonzero(matches >= 0)
    taken[frame, person] = array[frame, matches[frame, person]]
    return taken


GAP_RATE = 25.0
"""Frames/s in which lengths of gaps are stated, for clips of any frame rate."""


def gap_frames(measured: np.ndarray, fps: float) -> np.ndarray:
    """Return the length of the gap around each entry of `measured` (F, ...), in frames at `GAP_RATE`; 0 where True.

    In stills it is 1, as nobody is followed from one to the next.
    """
    if are_stills(fps):
        return (~measured).astype(int)
    return np.ceil(gap_lengths(measured) * (GAP_RATE / fps) - 1e-6).astype(int)


@dataclass(frozen=True, eq=False)
class Comparison:
    """A prediction and the truth to compare it with, on one skeleton of J joints.

    Raises:
        ValueError: prediction and captured poses differ in shape.
    """

    pred: Poses3D  # P predicted persons
    captured: Poses3D  # The same persons before anything was filled; defines which joints were hidden
    truth: Poses3D  # T true persons
    actors: tuple[int, ...]  # True persons that PCP is averaged over
    # (F, T) index of the prediction that matches each true person, -1 for none; by default from `match`
    matches: np.ndarray = UNSET
    fps: float = GAP_RATE  # Frames per second
    compared: np.ndarray | None = None  # (F, T, J) True where joints count for the error by gap; None for all
    # (F, T, 3, 2) true angles from `dmae.metrics.angles.leg_angles`, degrees; None if they are not scored
    angles: np.ndarray | None = None

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
    def error(self) -> np.ndarray:
        """(F, T, J) distance of the matched predictions from the truth, mm; NaN where either is unknown."""
        return 1000 * np.linalg.norm(self.matched - self.truth.xyz.astype(np.float64), axis=-1)

    @cached_property
    def source(self) -> np.ndarray:
        """(F, T, J) `Source` of the matched predictions, ABSENT where a person is missed."""
        return take_matched(self.pred.source, self.matches, Source.ABSENT)

    @cached_property
    def cov(self) -> np.ndarray:
        """(F, T, J, 3, 3) covariance of matched predictions, plus the one that the truth states, if any, m^2."""
        return take_matched(self.pred.cov, self.matches) + np.nan_to_num(self.truth.cov)

    @cached_property
    def hidden(self) -> np.ndarray:
        """(F, T, J) True where capture did not measure the joint."""
        return ~take_matched(self.captured.measured, self.matches, False)

    @cached_property
    def gap_lengths(self) -> np.ndarray:
        """(F, T, J) length of the gap around each joint in frames at `GAP_RATE`; 0 where the joint was measured."""
        return take_matched(gap_frames(self.captured.measured, self.fps), self.matches, 0)
