"""Rotation matrices from angles and directions."""

import numpy as np
from scipy.spatial.transform import Rotation

UPRIGHT = {
    "x": np.array([[0.0, 1, 0], [0, 0, 1], [1, 0, 0]]),
    "y": np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]]),
    "z": np.eye(3),
}
"""For each axis that may point up in a source world, the (3, 3) rotation from that world to a world with z up."""


def about(axis: str, angle: np.ndarray | float) -> np.ndarray:
    """Return rotations (..., 3, 3) by angles (...), rad, about axis x, y or z."""
    angle = np.asarray(angle, np.float64)
    return Rotation.from_euler(axis, angle.reshape(-1, 1)).as_matrix().reshape(*angle.shape, 3, 3)


def aligned(along: np.ndarray, forward: np.ndarray, axis: tuple[float, float, float]) -> np.ndarray:
    """Return rotations that turn `axis` to one direction, and x as close as possible to another direction.

    Args:
        along: (F, 3) directions of any length.
        forward: (F, 3) directions of any length, not parallel to `along`.
        axis: Unit vector orthogonal to x.

    Returns:
        (F, 3, 3) rotations.
    """
    along = along / np.linalg.norm(along, axis=1, keepdims=True)
    forward = forward - (forward * along).sum(1, keepdims=True) * along
    forward /= np.linalg.norm(forward, axis=1, keepdims=True)
    canonical = np.stack([axis, (1, 0, 0), np.cross(axis, (1, 0, 0))])
    return np.stack([along, forward, np.cross(along, forward)], axis=2) @ canonical
