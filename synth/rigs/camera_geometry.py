"""Intrinsics and poses of cameras, and checks of the numbers that define them."""

import numpy as np


def intrinsics(focal: float, size: list[int]) -> np.ndarray:
    """Return the (3, 3) K of a camera with its principal point in the middle of the image, px."""
    width, rows = size
    return np.array([[focal, 0, (width - 1) / 2], [0, focal, (rows - 1) / 2], [0, 0, 1]])


def look_at(centers: np.ndarray, target: np.ndarray) -> np.ndarray:
    """Return (V, 3, 3) rotations cam_from_world of upright cameras.

    Args:
        centers: (V, 3) centres of the cameras, m, world.
        target: (3,) or (V, 3) points that they look at, m, world.
    """
    forward = target - centers
    forward /= np.linalg.norm(forward, axis=-1, keepdims=True)
    right = np.cross(forward, [0, 0, 1])
    # For cameras that look straight up or down, the world's x axis points to the right of the image.
    right[np.linalg.norm(right, axis=-1) < 1e-9] = (1, 0, 0)
    right /= np.linalg.norm(right, axis=-1, keepdims=True)
    return np.stack([right, np.cross(forward, right), forward], 1)


def pose(rotation: np.ndarray, centers: np.ndarray) -> np.ndarray:
    """Return (V, 4, 4) cam_from_world of cameras with (V, 3, 3) rotations cam_from_world and (V, 3) centres, m."""
    matrix = np.tile(np.eye(4), (len(rotation), 1, 1))
    matrix[:, :3, :3] = rotation
    matrix[:, :3, 3] = -np.einsum("vij,vj->vi", rotation, centers)
    return matrix


def check_pairs(group: str, config, names: tuple[str, ...]) -> None:
    """Raise ValueError if a field is not an ascending pair of numbers above 0; the message names the field."""
    for name in names:
        pair = getattr(config, name)
        if len(pair) != 2 or not 0 < pair[0] <= pair[1] < np.inf:
            raise ValueError(f"{group}.{name}: expected [least, greatest], more than 0, got {list(pair)}")


def check_views(group: str, views: int) -> None:
    """Raise ValueError if there is no camera."""
    if views < 1:
        raise ValueError(f"{group}.views: expected at least one camera, found {views}")


def check_picture(group: str, focal: float, size: list[int]) -> None:
    """Raise ValueError if these are not a focal length, px, and an image size, px; the message names the field."""
    if not 0 < focal < np.inf:
        raise ValueError(f"{group}.focal: expected more than 0 px, got {focal}")
    if len(size) != 2 or min(size) < 1:
        raise ValueError(f"{group}.size: expected [width, height], at least 1 px each, got {list(size)}")
