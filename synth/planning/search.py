"""Choose cameras: the best next one again and again, then each exchanged for a better one."""

from dataclasses import dataclass

import numpy as np

from synth.planning.evidence import Evidence

_EXACT = 0.05
"""m; standard error at which a joint that is measured counts half."""
_RIDGE = 1e-3
"""1/m^2; keeps the determinant of joints that one camera sees above zero."""


@dataclass(frozen=True)
class Prediction:
    """What the search expects of a rig, before any capture.

    Attributes:
        score: From 0 to 1; the share of joints measured, each weighted by how exactly.
        missing: Share of joints that are not measured, %.
        error: Median standard error of joints, mm.
    """

    score: float
    missing: float
    error: float


def standard_errors(information: np.ndarray) -> np.ndarray:
    """Return the standard errors (...) of places, m, of inverse covariances (..., 6), 1/m^2, as in `Evidence`."""
    xx, yy, zz, xy, xz, yz = np.moveaxis(np.asarray(information, np.float64), -1, 0)
    xx, yy, zz = xx + _RIDGE, yy + _RIDGE, zz + _RIDGE
    minors = yy * zz - yz * yz, xx * zz - xz * xz, xx * yy - xy * xy
    determinant = xx * minors[0] - xy * (xy * zz - xz * yz) + xz * (xy * yz - xz * yy)
    return np.sqrt(sum(minors) / np.maximum(determinant, 1e-12))


@dataclass(frozen=True)
class _State:
    """Joint evidence of some cameras on N joints.

    Attributes:
        none, one: (N,) probabilities that no camera and that a single one detects the joint.
        information: (N, 6) as in `Evidence`.
    """

    none: np.ndarray
    one: np.ndarray
    information: np.ndarray

    @staticmethod
    def of(evidence: Evidence, chosen: list[int]) -> "_State":
        count = len(evidence.probability)
        state = _State(np.ones(count), np.zeros(count), np.zeros((count, 6)))
        for camera in chosen:
            state = state.with_camera(evidence, camera)
        return state

    def with_camera(self, evidence: Evidence, camera: int) -> "_State":
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
        """From 0 to 1: the share of joints measured, each weighted by how exactly; a little for a first camera."""
        exact = 1 / (1 + (standard_errors(self.information) / _EXACT) ** 2)
        return float((self.measured * exact).mean() + 1e-3 * (1 - self.none).mean())


def predict(evidence: Evidence, chosen: list[int]) -> Prediction:
    """Return what the search expects of the cameras `chosen`."""
    state = _State.of(evidence, chosen)
    error = standard_errors(state.information)
    return Prediction(state.value(), float(100 * (1 - state.measured.mean())), float(1000 * np.median(error)))


def choose(evidence: Evidence, place: np.ndarray, numbers: range, exchanges: int) -> dict[int, list[int]]:
    """Choose cameras for each number, by greedy search and exchange.

    Args:
        evidence: Of C candidates.
        place: (C,) index of each candidate's place; no place is taken twice.
        numbers: Of cameras.
        exchanges: How often at most each camera is exchanged for the best other one.

    Returns:
        Indices of the cameras, by number, sorted.

    Raises:
        ValueError: there are fewer places than cameras.
    """
    places = len(set(place.tolist()))
    if max(numbers) > places:
        raise ValueError(f"cameras: {max(numbers)} cameras do not fit into {places} places; raise mount.places")
    chosen, found = [], {}
    for number in range(1, max(numbers) + 1):
        chosen = [*chosen, _best(evidence, place, chosen)]
        if number in numbers:
            chosen = _exchanged(evidence, place, chosen, exchanges)
            found[number] = sorted(chosen)
    return found


def _best(evidence: Evidence, place: np.ndarray, others: list[int]) -> int:
    """Return the camera that is best beside others."""
    return int(_scores(evidence, place, others).argmax())


def _scores(evidence: Evidence, place: np.ndarray, others: list[int]) -> np.ndarray:
    """Return the score (C,) of each camera beside others; -1 for those at a place that is taken."""
    before = _State.of(evidence, others)
    free = ~np.isin(place, place[others])
    return np.array([before.with_camera(evidence, c).value() if free[c] else -1.0 for c in range(len(place))])


def _exchanged(evidence: Evidence, place: np.ndarray, chosen: list[int], rounds: int) -> list[int]:
    """Return the cameras after each was exchanged for the best other one, in at most so many rounds."""
    chosen = list(chosen)
    for _ in range(rounds):
        before = list(chosen)
        for index in range(len(chosen)):
            others = chosen[:index] + chosen[index + 1 :]
            chosen[index] = _best(evidence, place, others)
        if chosen == before:
            break
    return chosen
