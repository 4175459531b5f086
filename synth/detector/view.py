"""The detections of one camera during the simulation of errors, and the truth that the errors depend on."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from enum import IntEnum

import numpy as np

from dmae.data.array_fields import UNSET
from dmae.data.labels import JointError, Visibility
from dmae.data.typed import Configuration
from dmae.numerics.noise import bursts, multiscale_noise


class ErrorStream(IntEnum):
    """The purpose of each random stream of a view. Never renumber them: existing data sets depend on the numbers."""

    TIMING = 0
    OFFSET = 1
    BIAS = 2
    NOISE = 3
    SCORE = 4
    MISS = 5
    NEIGHBOUR_MISS = 6
    PERSON_MISS = 7
    SWAP = 8
    LEG_INVERSION = 9
    ARM_INVERSION = 10
    MERGE = 11
    SPLIT = 12
    GHOSTS = 13
    DROP = 14
    ORDER = 15
    CUSTOM = 16
    BODY_INVERSION = 17


@dataclass(frozen=True)
class Times(Configuration):
    """Correlation times of errors."""

    correlation: float = 0.1
    """s; time in which the varying part of errors decorrelates: half of it to 1/e in three times that, half in a third
    of it. Scores and ghosts decorrelate in this time."""
    bursts: list[float] = field(default_factory=lambda: [3.0, 0.4])
    """s; two correlation times of events, a long and a short one, mixed half and half. The size of errors is correlated
    over the long one."""

    def __post_init__(self):
        super().__post_init__()
        if not 0 <= self.correlation < float("inf"):
            raise ValueError(f"detector.times.correlation: expected 0 or more, found {self.correlation}")
        if len(self.bursts) != 2 or not min(self.bursts) > 0:
            raise ValueError(f"detector.times.bursts: expected two times above 0 s, found {list(self.bursts)}")


@dataclass(frozen=True)
class View:
    """One camera's view of P persons in F frames, and its D detections of the 25 joints of BODY25.

    Without errors, detection d is person d. Errors can add detections.
    """

    fps: float  # Frames per second
    size: np.ndarray  # (2,) image width and height, px
    xyz: np.ndarray  # (F, P, 25, 3) true joints, m, world
    true_xy: np.ndarray  # (F, P, 25, 2) projections of the joints at the time of exposure, px; NaN behind the camera
    visibility: np.ndarray  # (F, P, 25) `Visibility` at that time
    occluder: np.ndarray  # (F, P, 25) index of the person or object that hides the joint
    parts: dict[str, np.ndarray]  # Fields of `PartConfig`, (25, ...) each
    times: Times  # Correlation times of errors
    minimum_score: float  # Joints with a lower confidence are not reported
    # Function that returns a new generator for a stream of this view, at its beginning
    random: Callable[[ErrorStream], np.random.Generator]
    xy: np.ndarray = UNSET  # (F, D, 25, 2) detected joints, px; NaN where missed
    score: np.ndarray = UNSET  # (F, D, 25) confidence; NaN where missed
    owner: np.ndarray = UNSET  # (F, D, 25) int16 index of the person that each detected joint belongs to; -1 in ghosts
    # (F, D, 25) uint8 `JointError`; GOOD if no joint or person was confused, even if the joint is far off
    kind: np.ndarray = UNSET
    person: np.ndarray = UNSET  # (D,) int16 index of the person of each detection; -1 for ghosts
    error_rank: np.ndarray = UNSET  # (F, P, 25) rank of the size of each joint's noise in its distribution, from 0 to 1
    shown: np.ndarray = UNSET  # (F,) index of the frame with the detections that each frame shows; -1 for none

    def __post_init__(self):
        if self.xy is None:
            joints = self.visibility.shape
            persons = np.arange(joints[1], dtype=np.int16)
            perfect = {
                "xy": self.true_xy,
                "score": np.ones(joints),
                "owner": np.broadcast_to(persons[:, None], joints),
                "kind": np.full(joints, JointError.GOOD, np.uint8),
                "person": persons,
                "error_rank": np.zeros(joints),
                "shown": np.arange(joints[0]),
            }
            for name, array in perfect.items():
                object.__setattr__(self, name, array)

    @property
    def hidden(self) -> np.ndarray:
        """(F, P, 25) True for hidden joints in the image."""
        return (self.visibility != Visibility.VISIBLE) & (self.visibility <= Visibility.HIDDEN_BY_OBJECT)

    def of_hidden(self, name: str) -> np.ndarray:
        """Return (F, P, 25, ...) the parameter `hidden_<name>` of each joint, or `covered_<name>` where another person
        or an object hides it and that is given. 0 means that neither is given."""
        hidden, covered = self.parts[f"hidden_{name}"], self.parts[f"covered_{name}"]
        given = covered.reshape(len(covered), -1).any(1)
        by_other = (self.visibility == Visibility.HIDDEN_BY_PERSON) | (self.visibility == Visibility.HIDDEN_BY_OBJECT)
        own = by_other & given
        return np.where(own[..., None] if covered.ndim > 1 else own, covered, hidden)

    def inside(self, xy: np.ndarray) -> np.ndarray:
        """Return (...) True where pixels (..., 2) are in the image; False for NaN."""
        with np.errstate(invalid="ignore"):
            return np.all((xy >= -0.5) & (xy <= self.size - 0.5), -1)

    @property
    def observed(self) -> np.ndarray:
        """(F, D, 25) True where a joint is detected."""
        return ~np.isnan(self.score)

    def noise(self, shape: tuple[int, ...], *, rng: np.random.Generator) -> np.ndarray:
        """Return standard normal noise of a shape (F, ...) with the correlation times of `times.bursts`."""
        return multiscale_noise(shape, self.fps, self.times.bursts, rng=rng)

    def events(self, probability: np.ndarray | float, shape: tuple[int, ...], stream: ErrorStream) -> np.ndarray:
        """Return events of a shape (F, ...), bool, with a probability, in bursts of `times.bursts`."""
        return bursts(probability, self.noise(shape, rng=self.random(stream)))

    def without(self, joints: np.ndarray) -> "View":
        """Return the view without the detected joints where `joints` (F, D, 25) is True."""
        xy, score = np.where(joints[..., None], np.nan, self.xy), np.where(joints, np.nan, self.score)
        return replace(self, xy=xy, score=score)

    def reported(self) -> "View":
        """Return the view without joints outside the image, with too low confidence, or without position or score."""
        with np.errstate(invalid="ignore"):
            return self.without(~(self.inside(self.xy) & (self.score >= self.minimum_score)))

    def added(self, xy: np.ndarray, score: np.ndarray, owner: np.ndarray, kind: np.ndarray, person: np.ndarray):
        """Return the view with these detections added."""
        return replace(
            self,
            xy=np.concatenate([self.xy, xy], 1),
            score=np.concatenate([self.score, score], 1),
            owner=np.concatenate([self.owner, owner.astype(np.int16)], 1),
            kind=np.concatenate([self.kind, kind.astype(np.uint8)], 1),
            person=np.concatenate([self.person, person.astype(np.int16)]),
        )


def box(xy: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return least and greatest coordinates (..., 2) of the known joints (..., J, 2); 0 if none is known."""
    known = np.isfinite(xy)
    any_known = known.any(-2)
    least = np.where(known, xy, np.inf).min(-2)
    greatest = np.where(known, xy, -np.inf).max(-2)
    return np.where(any_known, least, 0), np.where(any_known, greatest, 0)


def height(xy: np.ndarray) -> np.ndarray:
    """Return the longer side (...) of the box around joints (..., J, 2), px."""
    low, high = box(xy)
    return (high - low).max(-1)
