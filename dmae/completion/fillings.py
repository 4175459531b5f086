"""Completion methods that fill joints without a network.

The first ones interpolate each joint over time, in the world (`dmae.numerics.filling.fill_world`) or relative to the
body (`fill_body_frame`). Then come the rejection of joints that other frames contradict, and a Kalman smoother.
"""

from __future__ import annotations

from dataclasses import replace
from math import prod

import numpy as np
from scipy.ndimage import maximum_filter1d

from dmae.completion.methods import completion_method
from dmae.data.clip import Poses3D, Source
from dmae.data.skeleton import Skeleton
from dmae.numerics.compiled import compiled
from dmae.numerics.filling import fill_body_frame, fill_world, keep_rejected, take_estimate, without_infinite
from dmae.numerics.paths import cubic_between, hold, linear, neighbours, pchip


@completion_method("measured", smooths=True)
def fill_nothing(poses: Poses3D, fps: float) -> Poses3D:
    """Fill nothing."""
    return poses


@completion_method("hold")
def fill_hold(poses: Poses3D, fps: float) -> Poses3D:
    """Hold each joint where it was last measured."""
    return fill_world(poses, fps, hold)


@completion_method("linear")
def fill_linear(poses: Poses3D, fps: float) -> Poses3D:
    """Straight lines through the world."""
    return fill_world(poses, fps, linear)


@completion_method("linear_body")
def fill_linear_body(poses: Poses3D, fps: float) -> Poses3D:
    """Straight lines of offsets between joints, in a frame that turns with the body."""
    return fill_body_frame(poses, fps, linear)


@completion_method("pchip")
def fill_pchip(poses: Poses3D, fps: float) -> Poses3D:
    """Monotone cubics through the world."""
    return fill_world(poses, fps, pchip)


@completion_method("pchip_body")
def fill_pchip_body(poses: Poses3D, fps: float) -> Poses3D:
    """Monotone cubics of offsets between joints, in a frame that turns with the body."""
    return fill_body_frame(poses, fps, pchip)


@completion_method("rays")
def fill_rays(poses: Poses3D, fps: float) -> Poses3D:
    """As pchip_body, with joints that a single camera detected put on its ray."""
    return fill_body_frame(poses, fps, pchip, by_rays=True)


# Rejection: measured joints that cannot be right, because the frames around contradict them.

_REACHES = (0.04, 0.1, 0.2)  # s that are left out on either side of a sample with it: errors last for several frames
_LONGEST = 0.6  # s; samples farther apart than this do not predict what is between them
_ERROR = 0.05  # m; a deviation that measurement noise explains
ACCELERATION = 20.0
"""m/s^2; a deviation that motion explains has at most this acceleration."""


def contradicted(xyz: np.ndarray, fps: float, acceleration: float = ACCELERATION) -> np.ndarray:
    """Find samples that monotone cubics through the other frames contradict.

    A sample is predicted from the two samples before and the two after it, leaving out those nearest to it. It is
    contradicted when its deviation exceeds measurement noise plus the greatest acceleration over that time. Of
    samples near each other only the worst is dropped, and the others are judged again without it. The constants are
    those with which simulated captures came out nearest the truth.

    Args:
        xyz: (F, ..., 3) m, NaN where not measured.
        acceleration: m/s^2, the greatest that people are assumed to reach.

    Returns:
        (F, ...) True where a sample is contradicted.
    """
    flat = xyz.reshape(len(xyz), prod(xyz.shape[1:-1]), 3).astype(np.float64)
    near = 2 * max(round(max(_REACHES) * fps), 1) + 1
    found = np.zeros(flat.shape[:2], bool)
    remaining = np.arange(flat.shape[1])
    while len(remaining):
        paths = np.ascontiguousarray(np.where(found[:, remaining, None], np.nan, flat[:, remaining]))
        samples = paths, *neighbours(~np.isnan(paths).any(-1))
        reaches = (max(round(reach * fps), 1) for reach in _REACHES)
        worst = np.max([_deviation(*samples, reach, float(fps), float(acceleration)) for reach in reaches], axis=0)
        bad = (worst > 1) & (worst == maximum_filter1d(worst, near, axis=0, mode="constant"))
        found[:, remaining] |= bad
        remaining = remaining[bad.any(0)]
    return found.reshape(xyz.shape[:-1])


@compiled()
def _deviation(paths, before, after, reach, fps, acceleration):
    """Return the deviation of samples of paths (F, n, 3) as a multiple of the tolerance, (F, n); 0 where unknown.

    `before` and `after` (F, n) are as of `neighbours`; samples nearer than `reach` frames are left out.
    """
    frames, columns = before.shape
    found = np.zeros((frames, columns))
    for frame in range(reach, frames - reach):
        for column in range(columns):
            low, high = before[frame - reach, column], after[frame + reach, column]
            if before[frame, column] != frame or low < 0 or high == frames or high - low > _LONGEST * fps:
                continue
            square = 0.0
            for k in range(3):
                predicted = cubic_between(paths, before, after, low, high, column, k, frame)
                square += (paths[frame, column, k] - predicted) ** 2
            tolerance = _ERROR + acceleration / 2 * (frame - low) * (high - frame) / fps**2
            found[frame, column] = np.sqrt(square) / tolerance
    return found


def reject(poses: Poses3D, fps: float) -> Poses3D:
    """Return the poses without measured joints that the frames around contradict (`dmae.completion.fillings`)."""
    poses = without_infinite(poses, fps)
    return poses.without(poses.measured & contradicted(poses.xyz, fps, ACCELERATION / poses.skeleton.scale))


@completion_method("reject_pchip")
def fill_reject_pchip(poses: Poses3D, fps: float) -> Poses3D:
    """Drop joints that the frames around contradict, then fill as pchip_body.

    What was rejected and filled again is `COMPLETED`.
    """
    return keep_rejected(fill_pchip_body(reject(poses, fps), fps), poses)


# A Kalman smoother of each joint's path through the world: fills and denoises, with covariances.

UNKNOWN_DEVIATION = 0.02
"""m along each axis; assumed of measured joints without a covariance."""

_LIMB = ("elbow", "wrist", "knee", "ankle", "heel", "toe")


@completion_method("kalman")
def fill_kalman(poses: Poses3D, fps: float) -> Poses3D:
    """A Kalman smoother of each joint, which denoises measured joints too.

    See `smooth_paths`. Measured joints are moved to their smoothed path and become `DENOISED`. All joints get
    covariances, computed from measured ones. Where a measurement has none, `UNKNOWN_DEVIATION` is assumed.
    """
    poses = without_infinite(poses, fps)
    frames, persons, joints = poses.source.shape
    known = np.isfinite(poses.cov).all((-1, -2))
    cov = np.where(known[..., None, None], poses.cov, UNKNOWN_DEVIATION**2 * np.eye(3)).astype(np.float64)
    # Measurements are never exact, and rounding must not make a covariance singular.
    cov = cov + 1e-6 * np.eye(3)
    xyz, spread = smooth_paths(
        poses.xyz.astype(np.float64).reshape(frames, persons * joints, 3),
        cov.reshape(frames, persons * joints, 3, 3),
        fps,
        np.tile(_acceleration_density(poses.skeleton), persons),
    )
    filled = take_estimate(poses, fps, xyz.reshape(poses.xyz.shape))
    known = (filled.source != Source.ABSENT)[..., None]
    return replace(
        filled,
        xyz=np.where(known, xyz.reshape(poses.xyz.shape), np.nan),
        source=np.where(filled.source == Source.MEASURED, Source.DENOISED, filled.source),
        cov=np.where(known[..., None], spread.reshape(poses.cov.shape), np.nan),
    )


def _acceleration_density(skeleton: Skeleton) -> np.ndarray:
    """Return spectral densities of acceleration, (J,) m^2/s^3, with which simulated people are followed best."""
    if skeleton.defined:
        # In a world in which the body is as large as a person, it accelerates unlike people.
        limbs = np.isin(np.arange(len(skeleton)), skeleton.trunk, invert=True)
        return np.where(limbs, 10.0, 1.0) / skeleton.scale**2
    return np.array([10.0 if joint.endswith(_LIMB) else 1.0 for joint in skeleton.joints])


_POSITION = 10.0  # m; standard deviation of a position before the first measurement
_VELOCITY = 2.0  # m/s; standard deviation of a velocity before the first measurement


def smooth_paths(
    xyz: np.ndarray, cov: np.ndarray, fps: float, acceleration_density: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the position of points in each frame, with its covariance, estimated from the measurements of all frames.

    Points move at constant velocity plus white noise of acceleration (Bar-Shalom, Li & Kirubarajan 2001, 6.2.2). This
    is the fixed-interval smoother of Rauch, Tung & Striebel (1965) in the form of Bierman (1973), which inverts only
    the covariance of innovations. Results have the shapes of `xyz` and `cov`; NaN for points never measured.

    Args:
        xyz: (F, n, 3) m; NaN where not measured.
        cov: (F, n, 3, 3) m^2, positive definite where measured.
        acceleration_density: (n,) spectral density of acceleration, m^2/s^3.
    """
    mean, spread = np.full(xyz.shape, np.nan), np.full(cov.shape, np.nan)
    ever = ~np.isnan(xyz).any(-1).all(0)
    if ever.any():
        mean[:, ever], spread[:, ever] = _smooth(xyz[:, ever], cov[:, ever], 1 / fps, acceleration_density[ever])
    return mean, spread


def _smooth(xyz: np.ndarray, cov: np.ndarray, dt: float, density: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the result of `smooth_paths` for points all measured once. States: position and velocity, (n, 6)."""
    frames, points = xyz.shape[:2]
    measured = ~np.isnan(xyz).any(-1)
    move = np.kron([[1, dt], [0, 1]], np.eye(3))
    noise = density[:, None, None] * np.kron([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]], np.eye(3))
    state = np.concatenate([xyz[measured.argmax(0), np.arange(points)], np.zeros((points, 3))], -1)
    P = np.tile(np.kron(np.diag([_POSITION**2, _VELOCITY**2]), np.eye(3)), (points, 1, 1))

    states, covs, updates = np.empty((frames, points, 6)), *np.empty((2, frames, points, 6, 6))
    weighted, weight = np.empty((frames, points, 3)), np.empty((frames, points, 3, 3))
    for frame in range(frames):
        if frame:
            state, P = state @ move.T, move @ P @ move.T + noise
        here = measured[frame, :, None]
        innovation = P[:, :3, :3] + np.where(here[..., None], cov[frame], np.eye(3))
        # A missing measurement has no weight.
        weight[frame] = np.where(here[..., None], np.linalg.inv(innovation), 0)
        weighted[frame] = _times(weight[frame], np.where(here, xyz[frame] - state[:, :3], 0))
        state = state + _times(P[..., :3], weighted[frame])
        # I - K H, where K is the Kalman gain.
        update = np.tile(np.eye(6), (points, 1, 1))
        update[..., :3] -= P[..., :3] @ weight[frame]
        P = update @ P
        P = (P + P.swapaxes(-1, -2)) / 2
        states[frame], covs[frame], updates[frame] = state, P, update

    # The adjoint of the state, and its covariance, contain the information of later measurements.
    adjoint, information = np.zeros((points, 6)), np.zeros((points, 6, 6))
    mean, spread = np.empty(xyz.shape), np.empty(cov.shape)
    for frame in range(frames - 1, -1, -1):
        P, update = covs[frame], updates[frame].swapaxes(-1, -2)
        mean[frame] = states[frame, :, :3] + _times(P[:, :3], adjoint)
        spread[frame] = P[:, :3, :3] - P[:, :3] @ information @ P[..., :3]
        adjoint, information = _times(update, adjoint), update @ information @ updates[frame]
        adjoint[:, :3] += weighted[frame]
        information[:, :3, :3] += weight[frame]
        adjoint, information = adjoint @ move, move.T @ information @ move
    return mean, spread


def _times(matrices: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    return np.einsum("nij,nj->ni", matrices, vectors)
