"""Standing: feet that rest, and bodies that stand on them, as measurements of the floor and the vertical.

W windows of time, P people, J joints.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dmae.data.clip import Poses3D
from dmae.data.skeleton import Skeleton
from dmae.files.mapped import release
from dmae.numerics.body import body_heading

SOLE = {"heel": 0.018, "big_toe": 0.016, "small_toe": 0.016, "ankle": 0.075}
"""m; heights of joints above the floor when a foot stands flat."""
_WINDOW_S = 0.32
_KNOWN = 0.7
"""Smallest share of the frames of a window in which a joint must be known."""
_DRIFT, _SCATTER = 0.03, 0.04
"""m; largest apparent movement of a joint at rest through a window, and largest deviation from its median."""
_RAISED = 0.02
"""m; a joint that is higher than this above the lowest joint of its foot does not touch the floor."""
_STRAIGHT = 0.95
"""Smallest distance from hip to ankle of a straight leg, as a share of the length of thigh and shank."""
_FOOT_SIGMA, _ANKLE_SIGMA = 0.010, 0.015
"""m; error of the height of a sole in a window, by heels and toes or by the ankle alone."""
_STANDING_SIGMA, _STEPPING_SIGMA = np.radians(1.5), np.radians(3.5)
"""rad; deviation of a person from the usual posture, when standing and when walking."""
_STANCE_SOLE, _STANCE_POSTURE = 0.005, np.radians(0.8)
"""m, rad; the part of these errors that is common to the windows of one stance."""
_SAME_PLACE_M, _SAME_HEADING = 0.15, np.radians(20)
"""Two windows of a person within these limits are one stance, and share their error."""
_FRAMES = 4096
"""Number of frames of a person that are processed together."""
_MOST = 1200
"""Largest number of windows that are used of each kind, evenly spread."""


@dataclass(frozen=True)
class Soles:
    """Feet at rest, n of them, each in a window of time.

    Attributes:
        xyz: (n, 3) m, the sole.
        person: (n,) index.
        sigma: (n,) m, expected error of its height, enlarged so that windows of one stance count as independent.
        same: (n,) number of windows of the same stance, including itself.
    """

    xyz: np.ndarray
    person: np.ndarray
    sigma: np.ndarray
    same: np.ndarray


@dataclass(frozen=True)
class Postures:
    """Bodies with straight legs, n of them, each in a window of time.

    Attributes:
        direction: (n, 3) unit vector from the ankles to the shoulders.
        heading: (n,) rad.
        person: (n,) index.
        sigma: (n,) rad, expected deviation from the person's usual direction, enlarged in the same way.
        same: (n,) number of windows of the same stance, including itself.
    """

    direction: np.ndarray
    heading: np.ndarray
    person: np.ndarray
    sigma: np.ndarray
    same: np.ndarray


def soles_and_postures(poses: Poses3D, fps: float, R: np.ndarray) -> tuple[Soles, Postures]:
    """Return the feet at rest and the standing bodies in poses, in a world rotated by R.

    Args:
        R: (3, 3) rotation to a world with a z axis that is roughly vertical.
    """
    skeleton, persons = poses.skeleton, poses.xyz.shape[1]
    length = max(round(_WINDOW_S * fps), 3)
    windows = len(poses.xyz) // length
    step = max(_FRAMES // (length * max(persons, 1)), 1)
    parts = []
    for first in range(0, max(windows, 1), step):
        frames = slice(first * length, min(first + step, windows) * length)
        parts.append(_windows(poses.xyz[frames] @ R.T, R @ poses.cov[frames] @ R.T, length))
        release(poses.xyz, poses.cov)
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
        joints = {part: _index(skeleton, f"{side}_{part}") for part in SOLE}
        joints = {part: joint for part, joint in joints.items() if joint is not None}
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
        return Soles(np.empty((0, 3)), *(np.empty(0, int), np.empty(0), np.empty(0)))
    xyz, person, sigma, foot = (np.concatenate(parts) for parts in zip(*found, strict=True))
    chosen = _spread(len(xyz))
    xyz, person, sigma, foot = xyz[chosen], person[chosen], sigma[chosen], foot[chosen]
    near = np.linalg.norm(xyz[:, None, :2] - xyz[None, :, :2], axis=-1) < _SAME_PLACE_M
    same_foot = (person[:, None] == person) & (foot[:, None] == foot)
    same = (near & same_foot).sum(1)
    return Soles(xyz, person, np.sqrt(sigma**2 + same * _STANCE_SOLE**2), same)


def _postures(middle: np.ndarray, resting: np.ndarray, skeleton: Skeleton) -> Postures:
    """Return the bodies in windows (W, P, J, 3) that stand on straight legs."""
    names = [f"{side}_{part}" for part in ("shoulder", "hip", "knee", "ankle") for side in "lr"]
    index = [_index(skeleton, name) for name in names]
    if None in index:
        return Postures(np.empty((0, 3)), np.empty(0), np.empty(0, int), np.empty(0), np.empty(0))
    shoulders, hips, knees, ankles = np.split(middle[:, :, index], 4, axis=2)
    bent = np.linalg.norm(hips - ankles, axis=-1) / (
        np.linalg.norm(hips - knees, axis=-1) + np.linalg.norm(knees - ankles, axis=-1)
    )
    line = shoulders.mean(2) - ankles.mean(2)
    standing = (bent > _STRAIGHT).all(-1) & np.isfinite(line).all(-1)
    heading = body_heading(middle, skeleton)
    window, person = np.nonzero(standing & np.isfinite(heading))
    chosen = _spread(len(window))
    rows = window, person = window[chosen], person[chosen]
    direction = line[rows] / np.linalg.norm(line[rows], axis=-1, keepdims=True)
    still = resting[:, :, index[6:]].all(-1)[rows]
    sigma, place, angle = np.where(still, _STANDING_SIGMA, _STEPPING_SIGMA), ankles.mean(2)[rows], heading[rows]
    near = np.linalg.norm(place[:, None, :2] - place[None, :, :2], axis=-1) < _SAME_PLACE_M
    same_heading = np.abs(np.angle(np.exp(1j * (angle[:, None] - angle)))) < _SAME_HEADING
    same = (near & same_heading & (person[:, None] == person)).sum(1)
    return Postures(direction, angle, person, np.sqrt(sigma**2 + same * _STANCE_POSTURE**2), same)


def _spread(count: int) -> np.ndarray:
    return np.unique(np.linspace(0, count - 1, min(count, _MOST)).astype(int)) if count else np.empty(0, int)


def _index(skeleton: Skeleton, joint: str) -> int | None:
    """Return the index of a joint; in a fused skeleton, the index in the first part that has the joint."""
    return next((i for i, name in enumerate(skeleton.joints) if name.rpartition(".")[2] == joint), None)
