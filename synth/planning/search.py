"""Choose cameras: add the best next camera repeatedly, then exchange each camera for a better one."""

import time
from dataclasses import dataclass

import numpy as np

from dmae.progress import progress
from synth.planning.evidence import JointEvidence

_HALF_WEIGHT_ERROR = 0.05
"""Standard error at which a measured joint counts half, m."""
_RIDGE = 1e-3
"""Added information, 1/m^2. It keeps the determinant above zero for joints that only one camera sees."""
_TIMED_ROWS = 2000
"""Number of joints in the measurement of the search time."""


@dataclass(frozen=True)
class RigPrediction:
    """Prediction of the search for a rig, before any capture.

    Attributes:
        score: From 0 to 1: the share of joints that are measured, each weighted by its accuracy.
        missing: Share of joints that are not measured, %.
        error: Median standard error of joints, mm.
    """

    score: float
    missing: float
    error: float


def standard_errors(information: np.ndarray) -> np.ndarray:
    """Return the standard errors (...) of positions, m.

    Args:
        information: (..., 6) inverse covariances, 1/m^2, as in `JointEvidence`.
    """
    xx, yy, zz, xy, xz, yz = np.moveaxis(np.asarray(information, np.float64), -1, 0)
    xx, yy, zz = xx + _RIDGE, yy + _RIDGE, zz + _RIDGE
    minors = yy * zz - yz * yz, xx * zz - xz * xz, xx * yy - xy * xy
    determinant = xx * minors[0] - xy * (xy * zz - xz * yz) + xz * (xy * yz - xz * yy)
    return np.sqrt(sum(minors) / np.maximum(determinant, 1e-12))


@dataclass(frozen=True)
class _State:
    """Joint evidence of some cameras on N joints.

    Attributes:
        none, one: (N,) probabilities that no camera detects the joint, and that exactly one does.
        information: (N, 6) sum over the cameras, as in `JointEvidence`.
    """

    none: np.ndarray
    one: np.ndarray
    information: np.ndarray

    @staticmethod
    def of(evidence: JointEvidence, chosen: list[int]) -> "_State":
        count = len(evidence.probability)
        state = _State(np.ones(count), np.zeros(count), np.zeros((count, 6)))
        for camera in chosen:
            state = state.with_camera(evidence, camera)
        return state

    def with_camera(self, evidence: JointEvidence, camera: int) -> "_State":
        found = evidence.probability[:, camera]
        return _State(
            self.none * (1 - found),
            self.one * (1 - found) + self.none * found,
            self.information + evidence.information[:, camera],
        )

    @property
    def measured(self) -> np.ndarray:
        """(N,) probability that two cameras or more detect the joint."""
        return 1 - self.none - self.one

    def value(self) -> float:
        """Return a score from 0 to 1: the share of joints that are measured, each weighted by its accuracy.

        A single camera measures nothing, but gets a small value, so that first cameras can be compared.
        """
        exact = 1 / (1 + (standard_errors(self.information) / _HALF_WEIGHT_ERROR) ** 2)
        return float((self.measured * exact).mean() + 1e-3 * (1 - self.none).mean())


def predict(evidence: JointEvidence, chosen: list[int]) -> RigPrediction:
    """Return the prediction of the search for the cameras `chosen`."""
    state = _State.of(evidence, chosen)
    error = standard_errors(state.information)
    return RigPrediction(state.value(), float(100 * (1 - state.measured.mean())), float(1000 * np.median(error)))


def choose(evidence: JointEvidence, place: np.ndarray, numbers: range, exchanges: int) -> dict[int, list[int]]:
    """Choose cameras for each number, by greedy search and exchange.

    Args:
        evidence: Evidence of C candidates.
        place: (C,) index of each candidate's place; each place is used at most once.
        numbers: Numbers of cameras.
        exchanges: Greatest number of times that each camera is exchanged for the best other one.

    Returns:
        Sorted indices of the cameras, by number of cameras.

    Raises:
        ValueError: there are fewer places than cameras.
    """
    places = len(set(place.tolist()))
    if max(numbers) > places:
        raise ValueError(f"cameras: {max(numbers)} cameras do not fit into {places} places; raise mount.places")
    chosen, found = [], {}
    for number in progress(range(1, max(numbers) + 1), "choosing cameras"):
        chosen = [*chosen, _best(evidence, place, chosen)]
        if number in numbers:
            chosen = _exchanged(evidence, place, chosen, exchanges)
            found[number] = sorted(chosen)
    return found


def seconds_of_search(evidence: JointEvidence, rows: int, cameras: int, numbers: range) -> float:
    """Return the estimated time of `choose`, s, from the measured time for a few cameras.

    Args:
        evidence: Evidence of a few cameras.
        rows, cameras: Numbers of joints and of cameras in the search.
        numbers: Numbers of cameras to choose.
    """
    found, few = evidence.probability.shape
    repeats = -(-_TIMED_ROWS // max(1, found))
    larger = JointEvidence(np.tile(evidence.probability, (repeats, 1)), np.tile(evidence.information, (repeats, 1, 1)))
    start = time.perf_counter()
    _scores(larger, np.arange(few), [0])
    each = (time.perf_counter() - start) / (few - 1) / (found * repeats)
    # Usually no camera changes any more after two rounds of exchanges.
    return each * rows * cameras * (max(numbers) + 2 * sum(numbers))


def _best(evidence: JointEvidence, place: np.ndarray, others: list[int]) -> int:
    """Return the camera with the highest score when it is added to others."""
    return int(_scores(evidence, place, others).argmax())


def _scores(evidence: JointEvidence, place: np.ndarray, others: list[int]) -> np.ndarray:
    """Return (C,) the score of the others plus each camera; -1 for cameras at an occupied place."""
    before = _State.of(evidence, others)
    free = ~np.isin(place, place[others])
    return np.array([before.with_camera(evidence, c).value() if free[c] else -1.0 for c in range(len(place))])


def _exchanged(evidence: JointEvidence, place: np.ndarray, chosen: list[int], rounds: int) -> list[int]:
    """Return the cameras after exchanges of each for the best other one, in at most `rounds` rounds."""
    chosen = list(chosen)
    for _ in range(rounds):
        before = list(chosen)
        for index in range(len(chosen)):
            others = chosen[:index] + chosen[index + 1 :]
            chosen[index] = _best(evidence, place, others)
        if chosen == before:
            break
    return chosen
