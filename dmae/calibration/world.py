"""The world of a rig: its vertical, its floor and its unit of length, from the people in it.

The floor is one linear least-squares fit. The soles of resting feet are on a plane. A standing person leans forward
by a constant angle, which is the same for all headings.

W windows of time, P people, J joints.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy.spatial.distance import pdist
from scipy.spatial.transform import Rotation
from scipy.special import stdtrit

from dmae.data.cameras import CameraRig
from dmae.data.clip import Clip, Poses3D
from dmae.data.skeleton import Skeleton
from dmae.files.checks import MOST_METRES
from dmae.files.mapped import by_frames, in_steps
from dmae.numerics.body import body_heading
from dmae.numerics.filling import are_stills
from dmae.numerics.statistics import evenly_spaced, mean_known

_ADULT = {("shoulder", "hip"): 0.50, ("hip", "knee"): 0.42, ("knee", "ankle"): 0.41}
"""m, mean of both sides: lengths of the limbs of an adult of 1.72 m."""
_MIN_COUNT = 10  # Smallest number of limbs, or of people, for a result


def relative_size(people: np.ndarray, skeleton: Skeleton) -> float | None:
    """Return the size of people (n, J, 3) relative to adults measured in metres; None if too few limbs are known."""
    ratios = []
    for (start, end), adult in _ADULT.items():
        for side in (side for side in "lr" if {f"{side}_{start}", f"{side}_{end}"} <= set(skeleton.joints)):
            first, second = skeleton.index(f"{side}_{start}", f"{side}_{end}")
            ratios.append(np.linalg.norm(people[:, first] - people[:, second], axis=-1) / adult)
    known = np.concatenate(ratios) if ratios else np.empty(0)
    known = known[np.isfinite(known)]
    return float(np.median(known)) if len(known) >= _MIN_COUNT else None


def upright_direction(people: np.ndarray, skeleton: Skeleton) -> tuple[np.ndarray, float] | None:
    """Find the direction in which people (n, J, 3) stand.

    Returns:
        The unit vector (3,), and the agreement of people on it from 0 to 1; None if too few people are known.
    """
    direction = by_frames(partial(_directions, skeleton), people)
    direction = direction[np.isfinite(direction).all(-1)]
    if len(direction) < _MIN_COUNT:
        return None
    mean = direction.mean(0)
    length = float(np.linalg.norm(mean))
    return mean / max(length, 1e-12), length


def _directions(skeleton: Skeleton, people: np.ndarray) -> np.ndarray:
    """Return the unit vectors (n, 3) from the legs of people (n, J, 3) to their shoulders; NaN where unknown."""
    ends, people = [], people.astype(np.float64)
    for parts in (("shoulder", "neck", "nose"), ("ankle", "knee")):
        joints = [i for i, joint in enumerate(skeleton.joints) if joint.removeprefix("l_").removeprefix("r_") in parts]
        ends.append(mean_known(people[:, joints], 1) if joints else np.full((len(people), 3), np.nan))
    with np.errstate(divide="ignore", invalid="ignore"):
        return (ends[0] - ends[1]) / np.linalg.norm(ends[0] - ends[1], axis=-1, keepdims=True)


SOLE = {"heel": 0.018, "big_toe": 0.016, "small_toe": 0.016, "ankle": 0.075}
"""m; heights of joints above the floor when a foot stands flat."""
_WINDOW_S = 0.32
_KNOWN = 0.7  # Smallest share of the frames of a window in which a joint must be known
_DRIFT, _SCATTER = 0.03, 0.04
"""m; largest apparent movement of a joint at rest through a window, and largest deviation from its median."""
_RAISED = 0.02  # m; a joint that is higher than this above the lowest joint of its foot does not touch the floor
_STRAIGHT = 0.95  # Smallest distance from hip to ankle of a straight leg, as a share of the length of thigh and shank
_LEG = 1.3  # Smallest length of a straight leg, relative to the trunk; adults have 1.7, small children 1.4
_FOOT_SIGMA, _ANKLE_SIGMA = 0.010, 0.015
"""m; error of the height of a sole in a window, by heels and toes or by the ankle alone."""
_STANDING_SIGMA, _STEPPING_SIGMA = float(np.radians(1.5)), float(np.radians(3.5))
"""rad; deviation of a person from the usual posture, when standing and when walking."""
_STANCE_SOLE, _STANCE_POSTURE = 0.005, np.radians(0.8)
"""m, rad; the part of these errors that is common to the windows of one stance."""
_SAME_PLACE_M, _SAME_HEADING = 0.15, np.radians(20)
"""Two windows of a person within these limits are one stance, and share their error."""
_SPOT_M = 0.4  # Places of a person within this distance are one spot: a seat, or where the person stands
_FRAMES = 4096  # Number of frames of a person that are processed together
_WINDOWS = 6_000  # Largest number of windows that are looked at, and of frames for the first guess, evenly spread
_MOST = 1200  # Largest number of windows that are used of each kind, evenly spread


@dataclass(frozen=True)
class Soles:
    """Feet at rest, n of them, each in a window of time."""

    xyz: np.ndarray  # (n, 3) m, the sole
    person: np.ndarray  # (n,) index
    # (n,) m, expected error of its height, enlarged so that windows of one stance count as independent
    sigma: np.ndarray
    same: np.ndarray  # (n,) number of windows of the same stance, including itself
    spot: np.ndarray  # (n,) number of the spot where the person is; errors on a spot may all be the same


@dataclass(frozen=True)
class Postures:
    """Bodies with straight legs, n of them, each in a window of time."""

    direction: np.ndarray  # (n, 3) unit vector from the ankles to the shoulders
    heading: np.ndarray  # (n,) rad
    person: np.ndarray  # (n,) index
    sigma: np.ndarray  # (n,) rad, expected deviation from the person's usual direction, enlarged in the same way
    same: np.ndarray  # (n,) number of windows of the same stance, including itself
    spot: np.ndarray  # (n,) number of the spot where the person is


def soles_and_postures(poses: Poses3D, fps: float, R: np.ndarray) -> tuple[Soles, Postures]:
    """Return the feet at rest and the standing bodies in poses, in a world rotated by R.

    Args:
        R: (3, 3) rotation to a world with a z axis that is roughly vertical.
    """
    skeleton, persons = poses.skeleton, poses.xyz.shape[1]
    length = max(round(_WINDOW_S * fps), 3)
    chosen = evenly_spaced(len(poses.xyz) // length, _WINDOWS)
    step = max(_FRAMES // (length * max(persons, 1)), 1)
    parts = []
    for first in in_steps(range(0, max(len(chosen), 1), step)):
        frames = (length * chosen[first : first + step, None] + np.arange(length)).ravel()
        parts.append(_windows(poses.xyz[frames] @ R.T, R @ poses.cov[frames] @ R.T, length))
    middle, resting, variance = (np.concatenate(part) for part in zip(*parts, strict=True))
    return _soles(middle, resting, variance, skeleton), _postures(middle, resting, skeleton)


def _windows(xyz: np.ndarray, cov: np.ndarray, length: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Cut (W * length, P, J, ...) into windows.

    Returns:
        middle: (W, P, J, 3) m, medians; NaN where too few frames are known.
        resting: (W, P, J) True for joints at rest.
        variance: (W, P, J) m^2, of the height.
    """
    windows = len(xyz) // length
    xyz = xyz.astype(np.float32).astype(np.float64).reshape(windows, length, *xyz.shape[1:])
    middle = np.full((windows, *xyz.shape[2:]), np.nan)
    enough = np.isfinite(xyz[..., 0]).mean(1) >= _KNOWN
    middle[enough] = np.nanmedian(np.moveaxis(xyz, 1, -2)[enough], -2)
    resting = enough & _resting(xyz, middle, enough)
    error = cov[..., 2, 2].astype(np.float32).reshape(windows, length, *cov.shape[1:3])
    return middle, resting, np.where(np.isfinite(error), error, 0).mean(1)


def _resting(xyz: np.ndarray, middle: np.ndarray, enough: np.ndarray) -> np.ndarray:
    """Return whether joints (W, n, P, J, 3) rest in a window, (W, P, J)."""
    half = xyz.shape[1] // 2
    parts = []
    for part in (xyz[:, :half], xyz[:, -half:]):
        known = np.isfinite(part)
        parts.append(np.where(known, part, 0).sum(1) / np.maximum(known.sum(1), 1))
    away = np.linalg.norm(xyz - middle[:, None], axis=-1)
    near = (away < _SCATTER).sum(1) >= 0.8 * np.isfinite(away).sum(1)
    return enough & near & (np.linalg.norm(parts[0] - parts[1], axis=-1) < _DRIFT)


def _soles(middle: np.ndarray, resting: np.ndarray, variance: np.ndarray, skeleton: Skeleton) -> Soles:
    """Return the feet that rest in windows (W, P, J, 3)."""
    found = []
    for foot, side in enumerate("lr"):
        joints = {part: joint for part in SOLE if (joint := _index(skeleton, f"{side}_{part}")) is not None}
        if not joints:
            continue
        index, above = list(joints.values()), np.array([SOLE[part] for part in joints])
        rest = resting[:, :, index]
        points = middle[:, :, index] - above[:, None] * (0, 0, 1)
        # A raised heel can rest, too.
        lowest = np.where(rest, points[..., 2], np.inf).min(-1, keepdims=True)
        rest &= points[..., 2] < lowest + _RAISED
        count = rest.sum(-1)
        window, person = np.nonzero(count)
        mean = np.where(rest[..., None], points, 0).sum(-2) / np.maximum(count, 1)[..., None]
        error = np.where(rest, variance[:, :, index], 0).sum(-1) / np.maximum(count, 1)
        flat = rest[..., [part != "ankle" for part in joints]].any(-1)
        sigma = np.sqrt(np.where(flat, _FOOT_SIGMA, _ANKLE_SIGMA) ** 2 + error)
        rows = window, person
        found.append((mean[rows], person, sigma[rows], np.full(len(person), foot)))
    if not found:
        return Soles(np.empty((0, 3)), np.empty(0, int), np.empty(0), np.empty(0), np.empty(0, int))
    xyz, person, sigma, feet = (np.concatenate(parts) for parts in zip(*found, strict=True))
    chosen = evenly_spaced(len(xyz), _MOST)
    xyz, person, sigma, feet = xyz[chosen], person[chosen], sigma[chosen], feet[chosen]
    near = np.linalg.norm(xyz[:, None, :2] - xyz[None, :, :2], axis=-1) < _SAME_PLACE_M
    same_foot = (person[:, None] == person) & (feet[:, None] == feet)
    same = (near & same_foot).sum(1)
    return Soles(xyz, person, np.sqrt(sigma**2 + same * _STANCE_SOLE**2), same, _spots(xyz, person))


def _postures(middle: np.ndarray, resting: np.ndarray, skeleton: Skeleton) -> Postures:
    """Return the bodies in windows (W, P, J, 3) that stand on straight legs."""
    names = [f"{side}_{part}" for part in ("shoulder", "hip", "knee", "ankle") for side in "lr"]
    index = [joint for name in names if (joint := _index(skeleton, name)) is not None]
    if len(index) < len(names):
        return Postures(np.empty((0, 3)), np.empty(0), np.empty(0, int), np.empty(0), np.empty(0), np.empty(0, int))
    shoulders, hips, knees, ankles = np.split(middle[:, :, index], 4, axis=2)
    bent = np.linalg.norm(hips - ankles, axis=-1) / (
        np.linalg.norm(hips - knees, axis=-1) + np.linalg.norm(knees - ankles, axis=-1)
    )
    line = shoulders.mean(2) - ankles.mean(2)
    # The hidden legs of people who sit are often detected straight, but short.
    legs, trunk = (np.linalg.norm(a - b, axis=-1).mean(-1) for a, b in ((hips, ankles), (shoulders, hips)))
    standing = (bent > _STRAIGHT).all(-1) & (legs > _LEG * trunk) & np.isfinite(line).all(-1)
    heading = body_heading(middle, skeleton)
    window, person = np.nonzero(standing & np.isfinite(heading))
    chosen = evenly_spaced(len(window), _MOST)
    window, person = window[chosen], person[chosen]
    rows = window, person
    direction = line[rows] / np.linalg.norm(line[rows], axis=-1, keepdims=True)
    still = np.all(resting[:, :, index[6:]], -1)[rows]
    place, angle = ankles.mean(2)[rows], heading[rows]
    near = np.linalg.norm(place[:, None, :2] - place[None, :, :2], axis=-1) < _SAME_PLACE_M
    same_heading = np.abs(np.angle(np.exp(1j * (angle[:, None] - angle)))) < _SAME_HEADING
    same = (near & same_heading & (person[:, None] == person)).sum(1)
    sigma = np.sqrt(np.where(still, _STANDING_SIGMA, _STEPPING_SIGMA) ** 2 + same * _STANCE_POSTURE**2)
    return Postures(direction, angle, person, sigma, same, _spots(place, person))


def _spots(place: np.ndarray, person: np.ndarray) -> np.ndarray:
    """Return (n,) the number of the spot of each place (n, 3): places of a person near the first one of a spot."""
    spot, count = np.full(len(place), -1), 0
    while (free := np.flatnonzero(spot < 0)).size:
        first = free[0]
        near = np.linalg.norm(place[free, :2] - place[first, :2], axis=-1) < _SPOT_M
        spot[free[near & (person[free] == person[first])]] = count
        count += 1
    return spot


def _index(skeleton: Skeleton, joint: str) -> int | None:
    """Return the index of a joint; in a fused skeleton, the index in the first part that has the joint."""
    return next((i for i, name in enumerate(skeleton.joints) if name.rpartition(".")[2] == joint), None)


UPRIGHT = 0.7
"""Smallest agreement of people on the vertical direction."""
_PLANES, _STEEPEST = 400, np.tan(np.radians(8))
"""Number of planes that are tried, and their largest slope from the mean direction of the bodies."""
_ON_FLOOR_M, _BELOW_M = 0.03, 0.06
"""m; largest distance of soles on a floor, and distance below it where there are no soles."""
_NEAR_FLOOR_M = 0.06
_LEAN, _LEAN_SIGMA, _SIDE_SIGMA = np.radians(2.0), np.radians(3.0), np.radians(1.5)
"""rad; mean angle by which people lean forward, and its standard deviation between people."""
_SHOE_SIGMA, _SOLE_SIGMA = 0.006, 0.012  # m; common error of the soles of one person, and of all people
_TILT_SIGMA = np.radians(0.15)  # rad; common error of all people
_ROBUST, _ROBUST_RAISED = 2.0, 1.0
"""Sigmas at which the weight of a residual is a half (Cauchy), and the same for a foot above the floor."""
_FEWEST_STANCES, _FEWEST_PLACES_M = 6, 1.0
"""Number of stances, and distance between two, that determine the floor. Standing bodies also count for a tilt."""
_AGREES = 0.5  # Smallest weight of a body that agrees with the tilt
_WIDEST_TILT, _WIDEST_HEIGHT = np.radians(1.2), 0.05
"""Largest half width of an interval; with a wider interval the result is not stated."""
_CLEAR = 2.0  # A tilt with a wider interval is still stated if it is this many times the half width
SIGMAS = 1.96
"""Half width, in standard deviations, of an interval that contains the truth with a probability of 95 %."""


@dataclass(frozen=True)
class Floor:
    """The floor and the vertical, as far as they are determined."""

    # (3,) unit vector against gravity, in the world; None if it is not determined
    up: tuple[float, float, float] | None
    tilt_deg: float | None  # Angle between `up` and z; None if it is not determined
    tilt_interval_deg: tuple[float, float] | None  # Interval that contains the tilt with a probability of 95 %
    # (3,) m, a point of the floor in the middle of the people; None if it is not determined
    place: tuple[float, float, float] | None
    height_m: float | None  # z of this point; None if it is not determined
    height_interval_m: tuple[float, float] | None  # Interval that contains the height with a probability of 95 %
    stances: int  # Number of stances of a foot, each at its own place

    def describe(self) -> str:
        """Return one line on tilt and height."""
        tilt = "tilt not determined: too few people stand upright for long enough"
        height = "height of the floor not determined: feet rest in too few places"
        if self.tilt_deg is not None and self.tilt_interval_deg is not None:
            low, high = self.tilt_interval_deg
            tilt = f"z is tilted by {self.tilt_deg:.1f} degrees (95 %: {low:.1f} to {high:.1f})"
        if self.height_m is not None and self.height_interval_m is not None:
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
    """
    far = by_frames(lambda xyz: ~(np.abs(xyz) < MOST_METRES).all(-1), poses.xyz)
    measured = poses.without(~poses.measured | far)
    people = measured.xyz[evenly_spaced(len(poses.xyz), _WINDOWS)].reshape(-1, *poses.xyz.shape[2:])
    mean = upright_direction(people, poses.skeleton)
    # In stills nobody is known to rest.
    if mean is None or mean[1] < UPRIGHT or are_stills(fps):
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
    spots = np.concatenate([soles.spot[on_floor], *2 * (postures.spot + len(soles.spot),)])
    cov, sigmas = _widened(cov, A, b, sigma, weight, spots)
    # The direction of z in the original world. The tilt is measured from it.
    z = R[:, 2]
    spread = cov[:2, :2] + _TILT_SIGMA**2 * np.eye(2)
    up = tilt = interval = None
    widest = sigmas * np.sqrt(np.linalg.eigvalsh(spread)[-1])
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
        half = float(np.degrees(sigmas * np.sqrt(along @ spread @ along)))
        interval = (max(tilt - half, 0.0), tilt + half)
    point = height = height_interval = None
    half = sigmas * float(np.sqrt(cov[2, 2] + _SOLE_SIGMA**2))
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
    # Priors. Tilt and height have very weak ones.
    prior = np.eye(count)
    means, errors = np.zeros(count), np.ones(count)
    means[lean] = _LEAN
    errors[shoe], errors[lean], errors[side] = _SHOE_SIGMA, _LEAN_SIGMA, _SIDE_SIGMA
    A = np.concatenate([feet, *bodies, prior])
    b = np.concatenate([off[:, 2], postures.direction[:, 0], postures.direction[:, 1], means])
    sigma = np.concatenate([soles.sigma[on_floor], postures.sigma, postures.sigma, errors])
    return A, b, sigma


def _solved(A: np.ndarray, b: np.ndarray, sigma: np.ndarray, feet: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the robust solution, its covariance, and the weights of the equations, 0 to 1, feet first."""
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


def _widened(
    cov: np.ndarray, A: np.ndarray, b: np.ndarray, sigma: np.ndarray, weight: np.ndarray, spots: np.ndarray
) -> tuple[np.ndarray, float]:
    """Return the covariance of tilt and height (3, 3), as wide as the spots disagree, and the sigmas of 95 %.

    Feet that are hidden are guessed, in the same way as long as a person stays. The solution is repeated without each
    spot (delete-one jackknife; Efron & Tibshirani 1993, 11.5). Its covariance is taken in directions in which it
    is larger than the model's covariance, with Student's t for as many degrees of freedom as there are spots that
    matter.

    Args:
        spots: (n,) spot of each of the first n equations, which feet and bodies give; the others are priors.
    """
    order = np.argsort(spots, kind="stable")
    first = np.flatnonzero(np.diff(spots[order], prepend=-1))
    if (count := len(first)) < 3:
        return cov[:3, :3], SIGMAS
    rows = np.column_stack([A, b]) / sigma[:, None] * np.sqrt(weight)[:, None]
    outer = rows[:, :, None] * rows[:, None]
    whole, left = outer.sum(0), outer.sum(0) - np.add.reduceat(outer[: len(spots)][order], first)
    without = np.linalg.solve(left[:, :-1, :-1], left[:, :-1, -1:])[:, :3, 0]
    change = without - np.linalg.solve(whole[:-1, :-1], whole[:-1, -1])[:3]
    root = np.linalg.cholesky(cov[:3, :3])
    change = np.linalg.solve(root, change.T)
    ratio, axes = np.linalg.eigh((count - 1) / count * change @ change.T)
    effect = (change**2).sum(0)
    matter = effect.sum() ** 2 / max((effect**2).sum(), 1e-12)
    wider = root @ axes
    sigmas = SIGMAS if ratio[-1] <= 1 else float(stdtrit(max(matter - 1, 1), 0.975))
    return wider * np.maximum(ratio, 1) @ wider.T, sigmas


_ADULT_STATURE = 1.72  # m, stature of the adult with which `relative_size` compares people
_FLOOR_PERCENTILE, _ANKLE_HEIGHT = 10, 0.09
"""Percentile of the heights of ankles that belongs to feet on the floor; height of an ankle above the floor, m."""


def place_world(
    rig: CameraRig, people: np.ndarray, skeleton: Skeleton, stature: float | None, level: bool
) -> CameraRig:
    """Return the rig in a world with another scale, or in an upright world with its floor at z = 0.

    Args:
        people: (n, J, 3) measured people.
        stature: m, mean stature of the people; None to keep the scale.
        level: Whether to turn the world so that people stand along z, and to move the floor to z = 0.

    Raises:
        ValueError: too few people are measured, or they do not stand.
    """
    world, scale = np.eye(4), 1.0
    if stature is not None:
        size = relative_size(people, skeleton)
        if size is None:
            raise ValueError(f"stature={stature:g}: too few people are measured for a scale; leave stature out")
        scale = stature / (_ADULT_STATURE * size)
    if level:
        up = upright_direction(people, skeleton)
        if up is None or up[1] < UPRIGHT:
            raise ValueError("level=true: too few people stand upright to determine the vertical; leave level out")
        world[:3, :3] = turn_to_z(up[0])
        ankles = [i for i, joint in enumerate(skeleton.joints) if joint.endswith("ankle")]
        if not np.isfinite(people[:, ankles]).any():
            raise ValueError("level=true: no ankle is measured, which the floor is found by; leave level out")
        heights = (people[:, ankles] @ world[2, :3]) * scale
        world[2, 3] = _ANKLE_HEIGHT - np.nanpercentile(heights, _FLOOR_PERCENTILE)
    return place_rig(rig, world, scale)


def upright_world(floor: Floor) -> np.ndarray | None:
    """Return new_from_old (4, 4) of an upright world with its floor at z = 0, as far as these are determined.

    The rotation is about the point on the floor, or about the origin. None if nothing is determined.
    """
    if floor.up is None and floor.height_m is None:
        return None
    world = np.eye(4)
    place = np.array(floor.place or (0, 0, 0))
    if floor.up is not None:
        world[:3, :3] = turn_to_z(np.array(floor.up))
    world[:3, 3] = place - world[:3, :3] @ place
    world[2, 3] -= place[2]
    return world


def place_clip(clip: Clip, world: np.ndarray) -> Clip:
    """Return a clip in another world, new_from_old (4, 4): cameras, truth and poses change, pixels do not."""
    return replace(
        clip,
        rig=place_rig(clip.rig, world),
        true_rig=None if clip.true_rig is None else place_rig(clip.true_rig, world),
        truth=None if clip.truth is None else _placed_poses(clip.truth, world),
        poses=None if clip.poses is None else _placed_poses(clip.poses, world),
    )


def place_rig(rig: CameraRig, world: np.ndarray, scale: float = 1.0) -> CameraRig:
    """Return a rig in another world, new_from_old (4, 4), in which lengths are `scale` times as large."""
    # new = scale * R old + t; the pixels do not change if the translation of the camera is scaled as well.
    pose = rig.cam_from_world.copy()
    R = pose[:, :3, :3] @ world[:3, :3].T
    centres = scale * rig.centers @ world[:3, :3].T + world[:3, 3]
    pose[:, :3, :3], pose[:, :3, 3] = R, -(R @ centres[..., None])[..., 0]
    return replace(rig, cam_from_world=pose)


_ALIGNED_M, _ALIGNED_ROUNDS = 0.005, 20
"""m: cameras nearer to their place than this count alike; number of times that they are weighted again."""


def place_like(rig: CameraRig, other: CameraRig) -> CameraRig:
    """Move, turn and scale a rig as a whole to bring its cameras to the places of those of another rig; return it.

    Sums of distances, not of their squares, are minimised, so that a camera that is elsewhere has no influence on the
    others (iteratively reweighted least squares).
    """
    turns = other.cam_from_world[:, :3, :3].swapaxes(1, 2) @ rig.cam_from_world[:, :3, :3]
    world, scale, weight, placed = np.eye(4), 1.0, np.ones(len(rig)), rig
    for _ in range(_ALIGNED_ROUNDS):
        world[:3, :3] = R = Rotation.from_matrix(turns).mean(weight).as_matrix()
        share = weight[:, None] / weight.sum()
        here, there = rig.centers @ R.T, other.centers
        here, there = here - (share * here).sum(0), there - (share * there).sum(0)
        scale = (weight[:, None] * here * there).sum() / (weight[:, None] * here**2).sum()
        world[:3, 3] = (share * (other.centers - scale * rig.centers @ R.T)).sum(0)
        placed = place_rig(rig, world, scale)
        weight = 1 / np.maximum(np.linalg.norm(placed.centers - other.centers, axis=1), _ALIGNED_M)
    return placed


def _placed_poses(poses: Poses3D, world: np.ndarray) -> Poses3D:
    R, t = world[:3, :3], world[:3, 3]

    def placed(move: Callable[[np.ndarray], np.ndarray], values: np.ndarray) -> np.ndarray:
        return by_frames(lambda values: move(values).astype(np.float32), values)

    return replace(
        poses,
        xyz=placed(lambda xyz: xyz @ R.T + t, poses.xyz),
        cov=placed(lambda cov: R @ cov @ R.T, poses.cov),
        rays=placed(lambda rays: np.stack([rays[..., 0, :] @ R.T + t, rays[..., 1, :] @ R.T], -2), poses.rays),
    )
