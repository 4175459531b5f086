"""Actions on the spot as functions of time: offsets from standing at ease, given as smooth curves through keyframes."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import PchipInterpolator

from synth.motion.easing import minimum_jerk


@dataclass(frozen=True)
class PoseOffsets:
    """Offsets from standing at ease over F frames, in the frame of the stance: x ahead, y left, z up, m; angles in rad.

    Attributes:
        hips: (F, 3) displacement of the mid hip.
        pelvis, chest: (F, 3) turn to the left, lean to the front, lean to the right.
        head: (F, 2) turn to the left, nod.
        arms: (F, 2, 5) angles of left and right arm, as `upper_body.HANGING`.
        raised: (F, 2) weight of these angles against those of an arm at ease, 0 to 1.
        feet: (F, 2, 5) displacement of the ankle, turn to the left, and the pitch, toes up, by which the foot rolls.
        leg: (F, 2, 4) of a leg in the air: thigh forward and outward of the vertical, knee flexion, dorsiflexion.
        air: (F, 2) weight of `leg` against standing, 0 to 1.
        supported: (F,) share of the weight that a seat carries, 0 to 1; balance does not move hips that are supported.
    """

    hips: np.ndarray
    pelvis: np.ndarray
    chest: np.ndarray
    head: np.ndarray
    arms: np.ndarray
    raised: np.ndarray
    feet: np.ndarray
    leg: np.ndarray
    air: np.ndarray
    supported: np.ndarray

    @staticmethod
    def zeros(frames: int) -> "PoseOffsets":
        """Return the offsets of standing at ease."""
        shapes = ((3,), (3,), (3,), (2,), (2, 5), (2,), (2, 5), (2, 4), (2,), ())
        return PoseOffsets(*(np.zeros((frames, *shape)) for shape in shapes))

    def mirrored(self) -> "PoseOffsets":
        """Return the offsets with left and right exchanged."""
        turned = np.array((-1, 1, -1))
        feet = self.feet[:, ::-1] * (1, -1, 1, -1, 1)
        return PoseOffsets(
            self.hips * (1, -1, 1), self.pelvis * turned, self.chest * turned, self.head * (-1, 1),
            self.arms[:, ::-1], self.raised[:, ::-1], feet, self.leg[:, ::-1], self.air[:, ::-1], self.supported,
        )  # fmt: skip


@dataclass(frozen=True)
class Seat:
    """A seat in use: from `begin` to `end`, s, at a distance `behind` the middle of the feet, m."""

    begin: float
    end: float
    behind: float


@dataclass(frozen=True)
class Action:
    """An action on the spot.

    Attributes:
        name: Label for reports.
        lasts: Time from the first key to the last, s.
        pose: Function of times (F,) since the first key, s, that returns `PoseOffsets`, zero at both ends.
        seat: The seat that the action uses, if any; its times count from the first key.
    """

    name: str
    lasts: float
    pose: Callable[[np.ndarray], PoseOffsets]
    seat: Seat | None = None

    @property
    def seconds(self) -> float:
        """Duration, s. Curves through keys are rounded, and therefore begin a little before the first key."""
        return self.lasts + 2 * _ROUND

    def offsets(self, times: np.ndarray) -> PoseOffsets:
        """Return the pose at times (F,) since the action began, s."""
        return self.pose(times - _ROUND)

    def seated(self, times: np.ndarray) -> np.ndarray:
        """Return whether the body sits, (F,) bool, at times (F,) since the action began, s."""
        if self.seat is None:
            return np.zeros(len(times), bool)
        return (times - _ROUND >= self.seat.begin) & (times - _ROUND <= self.seat.end)

    def mirrored(self) -> "Action":
        """Return the action with left and right exchanged."""
        return replace(self, pose=lambda times: self.pose(times).mirrored())


_NODES, _WEIGHTS = np.polynomial.hermite.hermgauss(5)
_SOFT = 0.03
"""Standard deviation of the Gaussian that rounds curves through keys, s."""
_ROUND = float(np.sqrt(2) * _SOFT * _NODES.max())


def keyframes(times: np.ndarray, *keys: tuple) -> np.ndarray:
    """Return a smooth curve through keys (time, value), monotone between them and constant outside them, (F, ...)."""
    # Constant ends make the curve start and end at rest.
    (first, start), (last, end) = keys[0], keys[-1]
    keys = ((first - 1, start), *keys, (last + 1, end))
    at = np.array([key[0] for key in keys], np.float64)
    values = np.array([key[1] for key in keys], np.float64)
    curve = PchipInterpolator(at, values, axis=0)
    rounded = curve(np.clip(times + np.sqrt(2) * _SOFT * _NODES[:, None], at[0], at[-1]))
    return np.tensordot(_WEIGHTS / _WEIGHTS.sum(), rounded, axes=1)


def plateau(times: np.ndarray, begin: float, end: float, move: float, back: float | None = None) -> np.ndarray:
    """Return a curve (F,) that rises from 0 at `begin` to 1 within `move`, s, and is back at 0 at `end`.

    Args:
        times: (F,) s.
        begin, end: Where the curve leaves 0 and returns to it, s.
        move: Duration of the rise, s.
        back: Duration of the fall, s; the same as the rise if not given.
    """
    move = min(move, (end - begin) / 2)
    back = min(back or move, (end - begin) / 2)
    return keyframes(times, (begin, 0), (begin + move, 1), (max(end - back, begin + move + 1e-3), 1), (end, 0))


def scaled(share: np.ndarray, angles: tuple) -> np.ndarray:
    """Return the angles (n,) times a share (F,), (F, n)."""
    return share[:, None] * np.array(angles)


def step_profile(times: np.ndarray, begin: float, end: float, lift: float = 0.05) -> tuple[np.ndarray, np.ndarray]:
    """Return the progress of a foot in a step from `begin` to `end`, s: (F,) share of the way, and (F,) height, m."""
    u = np.clip((times - begin) / (end - begin), 0, 1)
    return minimum_jerk(u), lift * 16 * u**2 * (1 - u) ** 2
