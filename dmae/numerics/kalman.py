"""A Kalman smoother: paths of points from measurements with known covariance."""

import numpy as np

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
