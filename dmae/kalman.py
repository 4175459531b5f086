"""Paths of joints from measurements of known covariance: a Kalman smoother."""

import numpy as np

_LOST = 10.0
"""m; deviation of a position of which nothing is known yet."""
_PACE = 2.0
"""m/s; deviation of a velocity of which nothing is known yet."""


def smooth_paths(xyz: np.ndarray, cov: np.ndarray, fps: float, agility: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where points were at each time, and how sure that is, given all measurements before and after.

    Points move at constant velocity but for white noise of acceleration (Bar-Shalom, Li & Kirubarajan 2001, 6.2.2).
    This is the fixed-interval smoother of Rauch, Tung & Striebel (1965) in the form of Bierman (1973), which inverts
    no covariance but that of innovations.

    Args:
        xyz: (F, n, 3) m, NaN where not measured.
        cov: (F, n, 3, 3) m^2, positive definite where measured.
        agility: (n,) spectral density of acceleration, m^2/s^3.

    Returns:
        xyz: (F, n, 3) m and cov: (F, n, 3, 3) m^2; NaN for points never measured.
    """
    mean, spread = np.full(xyz.shape, np.nan), np.full(cov.shape, np.nan)
    ever = ~np.isnan(xyz).any(-1).all(0)
    if ever.any():
        mean[:, ever], spread[:, ever] = _smooth(xyz[:, ever], cov[:, ever], 1 / fps, agility[ever])
    return mean, spread


def _smooth(xyz: np.ndarray, cov: np.ndarray, dt: float, agility: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """`smooth_paths` of points that are all measured at some time. States are position and velocity, (n, 6)."""
    frames, points = xyz.shape[:2]
    seen = ~np.isnan(xyz).any(-1)
    move = np.kron([[1, dt], [0, 1]], np.eye(3))
    stir = agility[:, None, None] * np.kron([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]], np.eye(3))
    state = np.concatenate([xyz[seen.argmax(0), np.arange(points)], np.zeros((points, 3))], -1)
    P = np.tile(np.kron(np.diag([_LOST**2, _PACE**2]), np.eye(3)), (points, 1, 1))

    states, covs, keeps = np.empty((frames, points, 6)), *np.empty((2, frames, points, 6, 6))
    pull, weight = np.empty((frames, points, 3)), np.empty((frames, points, 3, 3))
    for frame in range(frames):
        if frame:
            state, P = state @ move.T, move @ P @ move.T + stir
        here = seen[frame, :, None]
        innovation = P[:, :3, :3] + np.where(here[..., None], cov[frame], np.eye(3))
        # What is not seen is measured with no weight.
        weight[frame] = np.where(here[..., None], np.linalg.inv(innovation), 0)
        pull[frame] = _times(weight[frame], np.where(here, xyz[frame] - state[:, :3], 0))
        state = state + _times(P[..., :3], pull[frame])
        keep = np.tile(np.eye(6), (points, 1, 1))
        keep[..., :3] -= P[..., :3] @ weight[frame]
        P = keep @ P
        P = (P + P.swapaxes(-1, -2)) / 2
        states[frame], covs[frame], keeps[frame] = state, P, keep

    # What later measurements say of a state, and with what weight.
    later, sure = np.zeros((points, 6)), np.zeros((points, 6, 6))
    mean, spread = np.empty(xyz.shape), np.empty(cov.shape)
    for frame in range(frames - 1, -1, -1):
        P, keep = covs[frame], keeps[frame].swapaxes(-1, -2)
        mean[frame] = states[frame, :, :3] + _times(P[:, :3], later)
        spread[frame] = P[:, :3, :3] - P[:, :3] @ sure @ P[..., :3]
        later, sure = _times(keep, later), keep @ sure @ keeps[frame]
        later[:, :3] += pull[frame]
        sure[:, :3, :3] += weight[frame]
        later, sure = later @ move, move.T @ sure @ move
    return mean, spread


def _times(matrices: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    return np.einsum("nij,nj->ni", matrices, vectors)
