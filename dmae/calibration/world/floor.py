"""The floor: its place in the world and the vertical direction, from the feet and bodies of people.

The method is one linear least-squares fit. The soles of resting feet are on a plane. A standing person leans forward by
a constant angle, which is the same for all headings.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.distance import pdist

from dmae.calibration.world.gravity_and_scale import upright_direction
from dmae.calibration.world.standing import Postures, Soles, soles_and_postures
from dmae.data.clip import Poses3D
from dmae.files.checks import MOST_METRES
from dmae.files.mapped import by_frames

_ROUGHLY_UPRIGHT = 0.7
"""Smallest agreement of people on the vertical direction."""
_PLANES, _STEEPEST = 400, np.tan(np.radians(8))
"""Number of planes that are tried, and their largest slope from the mean direction of the bodies."""
_ON_FLOOR_M, _BELOW_M = 0.03, 0.06
"""m; largest distance of soles on a floor, and distance below it where there are no soles."""
_NEAR_FLOOR_M = 0.06
_LEAN, _LEAN_SIGMA, _SIDE_SIGMA = np.radians(2.0), np.radians(3.0), np.radians(1.5)
"""rad; mean angle by which people lean forward, and its standard deviation between people."""
_SHOE_SIGMA, _SOLE_SIGMA = 0.006, 0.012
"""m; common error of the soles of one person, and of all people."""
_TILT_SIGMA = np.radians(0.15)
"""rad; common error of all people."""
_ROBUST, _ROBUST_RAISED = 2.0, 1.0
"""Sigmas at which the weight of a residual is a half (Cauchy), and the same for a foot above the floor."""
_FEWEST_STANCES, _FEWEST_PLACES_M = 6, 1.0
"""Number of stances, and distance between two, that determine the floor. Standing bodies also count for a tilt."""
_AGREES = 0.5
"""Smallest weight of a body that agrees with the tilt."""
_WIDEST_TILT, _WIDEST_HEIGHT = np.radians(1.2), 0.05
"""Largest half width of an interval; with a wider interval the result is not stated."""
_CLEAR = 2.0
"""A tilt with a wider interval is still stated if it is this many times the half width."""
SIGMAS = 1.96
"""Half width, in standard deviations, of an interval that contains the truth with a probability of 95 %."""


@dataclass(frozen=True)
class Floor:
    """The floor and the vertical, as far as they are determined.

    Attributes:
        up: (3,) unit vector against gravity, in the world; None if it is not determined.
        tilt_deg: Angle between `up` and z; None if it is not determined.
        tilt_interval_deg: Interval that contains the tilt with a probability of 95 %.
        place: (3,) m, a point of the floor in the middle of the people; None if it is not determined.
        height_m: z of this point; None if it is not determined.
        height_interval_m: Interval that contains the height with a probability of 95 %.
        stances: Number of stances of a foot, each at its own place.
    """

    up: tuple[float, float, float] | None
    tilt_deg: float | None
    tilt_interval_deg: tuple[float, float] | None
    place: tuple[float, float, float] | None
    height_m: float | None
    height_interval_m: tuple[float, float] | None
    stances: int

    def describe(self) -> str:
        """Return one line on tilt and height."""
        tilt = "tilt not determined: too few people stand upright for long enough"
        height = "height of the floor not determined: feet rest in too few places"
        if self.tilt_deg is not None:
            low, high = self.tilt_interval_deg
            tilt = f"z is tilted by {self.tilt_deg:.1f} degrees (95 %: {low:.1f} to {high:.1f})"
        if self.height_m is not None:
            low, high = self.height_interval_m
            height = f"the floor is at z = {_cm(self.height_m)} cm (95 %: {_cm(low)} to {_cm(high)})"
        return f"{tilt}; {height}"


def _cm(metres: float) -> str:
    """Return whole centimetres with their sign; less than half a centimetre is +0, not -0."""
    return f"{round(100 * metres):+d}"


_NOTHING = Floor(None, None, None, None, None, None, 0)


def find_floor(poses: Poses3D, fps: float) -> Floor:
    """Return the floor and the vertical direction, from people in a world in metres. Any axis may be the vertical.

    Args:
        poses: (F, P, J) measured people; joints without a measurement are left out.
        fps: 1/s.
    """
    far = by_frames(lambda xyz: ~(np.abs(xyz) < MOST_METRES).all(-1), poses.xyz)
    measured = poses.without(~poses.measured | far)
    people = measured.xyz.reshape(-1, *measured.xyz.shape[2:])
    mean = upright_direction(people, poses.skeleton)
    if mean is None or mean[1] < _ROUGHLY_UPRIGHT:
        return _NOTHING
    up, found = mean[0], _NOTHING
    for _ in range(2):
        R = turn_to_z(up)
        soles, postures = soles_and_postures(measured, fps, R)
        found = _fit(soles, postures, R)
        if found.up is None:
            return found
        up = np.array(found.up)
    return found


def turn_to_z(up: np.ndarray) -> np.ndarray:
    """Return the smallest rotation (3, 3) that turns a direction (3,) to z."""
    x, y, z = up / np.linalg.norm(up)
    if z < -1 + 1e-9:
        return np.diag((1.0, -1.0, -1.0))
    cross = np.array([[0, 0, -x], [0, 0, -y], [x, y, 0]])
    return np.eye(3) + cross + cross @ cross / (1 + z)


def _fit(soles: Soles, postures: Postures, R: np.ndarray) -> Floor:
    """Return the floor by soles and postures in a world turned by R."""
    on_floor = _on_floor(soles)
    place = soles.xyz[on_floor]
    centre = place.mean(0) if len(place) else np.zeros(3)
    A, b, sigma = _equations(soles, postures, on_floor, centre)
    solution, cov, weight = _solved(A, b, sigma, len(place))
    # The direction of z in the original world. The tilt is measured from it.
    z = R[:, 2]
    spread = cov[:2, :2] + _TILT_SIGMA**2 * np.eye(2)
    up = tilt = interval = None
    widest = SIGMAS * np.sqrt(np.linalg.eigvalsh(spread)[-1])
    direction = np.array([*solution[:2], 1.0]) / np.sqrt(1 + solution[:2] @ solution[:2])
    angle = np.arccos(np.clip(direction @ z, -1, 1))
    on = weight[: len(place)] > 0.2
    stances = float((1 / soles.same[on_floor][on]).sum())
    # Both components of a body's direction must agree with the other bodies.
    agree = (weight[len(place) : len(place) + 2 * len(postures.same)].reshape(2, -1) > _AGREES).all(0)
    seen = stances + float((1 / postures.same[agree]).sum())
    if seen >= _FEWEST_STANCES and (widest <= _WIDEST_TILT or angle > _CLEAR * widest):
        up, tilt = tuple((R.T @ direction).tolist()), float(np.degrees(angle))
        away = direction[:2] - z[:2] / max(z[2], 0.1)
        along = away / max(np.linalg.norm(away), 1e-9)
        half = float(np.degrees(SIGMAS * np.sqrt(along @ spread @ along)))
        interval = (max(tilt - half, 0.0), tilt + half)
    point = height = height_interval = None
    half = SIGMAS * float(np.sqrt(cov[2, 2] + _SOLE_SIGMA**2))
    apart = pdist(place[on, :2]).max(initial=0)
    if stances >= _FEWEST_STANCES and apart >= _FEWEST_PLACES_M and half <= _WIDEST_HEIGHT:
        where = R.T @ (*centre[:2], centre[2] + solution[2])
        point, height = tuple(where.tolist()), float(where[2])
        height_interval = (height - half, height + half)
    return Floor(up, tilt, interval, point, height, height_interval, round(stances))


def _on_floor(soles: Soles) -> np.ndarray:
    """Return (n,) True for soles on the floor, which is the plane with the most soles on it and few below it."""
    xyz, count = soles.xyz, len(soles.xyz)
    if not count:
        return np.zeros(0, bool)
    rng = np.random.default_rng(0)
    picks = rng.integers(count, size=(_PLANES, 3))
    points = xyz[picks]
    normal = np.cross(points[:, 1] - points[:, 0], points[:, 2] - points[:, 0])
    with np.errstate(divide="ignore", invalid="ignore"):
        slope = -normal[:, :2] / normal[:, 2:]
    steep = ~(np.linalg.norm(slope, axis=-1) < _STEEPEST)
    slope = np.where(steep[:, None], 0, slope)
    height = points[:, 0, 2] - (slope * points[:, 0, :2]).sum(-1)
    off = xyz[:, 2] - height[:, None] - slope @ xyz[:, :2].T
    near = np.maximum(1 - (off / (2 * _ON_FLOOR_M)) ** 2, 0) - (off < -_BELOW_M)
    best = (near / soles.same).sum(1).argmax()
    return np.abs(off[best]) < _NEAR_FLOOR_M


def _equations(
    soles: Soles, postures: Postures, on_floor: np.ndarray, centre: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the equations A x = b with standard errors; x: tilt (2), height, and for each person shoe, lean, side."""
    people = 1 + max(soles.person.max(initial=-1), postures.person.max(initial=-1))
    rows_feet, rows_bodies = int(on_floor.sum()), len(postures.person)
    count = 3 + 3 * people
    shoe, lean, side = (3 + 3 * np.arange(people) + k for k in range(3))
    feet = np.zeros((rows_feet, count))
    off = soles.xyz[on_floor] - centre
    feet[:, :2], feet[:, 2] = -off[:, :2], 1
    feet[np.arange(rows_feet), shoe[soles.person[on_floor]]] = 1
    bodies = np.zeros((2, rows_bodies, count))
    row, person = np.arange(rows_bodies), postures.person
    cos, sin = np.cos(postures.heading), np.sin(postures.heading)
    bodies[0, :, 0] = bodies[1, :, 1] = 1
    bodies[0, row, lean[person]], bodies[1, row, lean[person]] = cos, sin
    bodies[0, row, side[person]], bodies[1, row, side[person]] = -sin, cos
    # Priors; those of tilt and height are very weak.
    prior = np.eye(count)
    means, errors = np.zeros(count), np.ones(count)
    means[lean] = _LEAN
    errors[shoe], errors[lean], errors[side] = _SHOE_SIGMA, _LEAN_SIGMA, _SIDE_SIGMA
    A = np.concatenate([feet, *bodies, prior])
    b = np.concatenate([off[:, 2], postures.direction[:, 0], postures.direction[:, 1], means])
    sigma = np.concatenate([soles.sigma[on_floor], postures.sigma, postures.sigma, errors])
    return A, b, sigma


def _solved(A: np.ndarray, b: np.ndarray, sigma: np.ndarray, feet: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the robust solution, its covariance, and the weight of each equation, from 0 to 1; those of feet first."""
    weight = np.ones(len(b))
    # A foot at rest can be above the floor, but not below it.
    raised = np.where(np.arange(len(b)) < feet, _ROBUST_RAISED, _ROBUST)
    for _ in range(10):
        rows = A / sigma[:, None] * weight[:, None]
        normal = np.linalg.inv(rows.T @ (A / sigma[:, None]))
        x = normal @ (rows.T @ (b / sigma))
        off = (b - A @ x) / sigma
        weight = 1 / (1 + (off / np.where(off > 0, raised, _ROBUST)) ** 2)
    return x, normal, weight
