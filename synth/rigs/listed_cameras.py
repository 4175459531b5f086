"""Cameras that the configuration lists in `rig.cameras`."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from dmae.data.cameras import CameraRig
from synth.rigs.camera_geometry import check_picture, intrinsics, look_at, pose


@dataclass(frozen=True)
class CameraConfig:
    """One camera, by its matrices or by its position and target.

    Attributes:
        name: Name, unique in its rig.
        size: Image width and height, px.
        K: Intrinsic matrix: 9 numbers, row major, px; or give `focal`.
        cam_from_world: Pose [R | t]: 12 numbers, row major, t in m; or give `position` and `target`.
        dist: OpenCV distortion: 5 to 8 coefficients; for a fisheye its four, and zeros.
        fisheye: Whether the lens follows OpenCV's fisheye model.
        focal: Focal length, px; the principal point is the middle of the image.
        position: Centre of an upright camera: x, y, z, m.
        target: Point that the camera looks at: x, y, z, m.
    """

    name: str
    size: list[int]
    K: list[float] = field(default_factory=list)
    cam_from_world: list[float] = field(default_factory=list)
    dist: list[float] = field(default_factory=lambda: [0.0] * 5)
    fisheye: bool = False
    focal: float | None = None
    position: list[float] = field(default_factory=list)
    target: list[float] = field(default_factory=list)


def listed_cameras(cameras: Sequence[CameraConfig], source: str) -> CameraRig:
    """Return the rig of listed cameras.

    Args:
        cameras: At least one.
        source: Name of the rig, for messages.

    Raises:
        ValueError: numbers are missing or do not define a camera; the message names the rig, the camera and the field.
    """
    parts = [_numbers(camera, f"{source}, camera {camera.name!r}") for camera in cameras]
    longest = max(len(camera.dist) for camera in cameras)
    try:
        return CameraRig(
            tuple(camera.name for camera in cameras),
            [K for K, _ in parts],
            [np.pad(camera.dist, (0, longest - len(camera.dist))) for camera in cameras],
            [cam_from_world for _, cam_from_world in parts],
            [camera.size for camera in cameras],
            [camera.fisheye for camera in cameras],
        )
    except ValueError as error:
        raise ValueError(f"{source}: {error}") from None


def _numbers(camera: CameraConfig, where: str) -> tuple[np.ndarray, np.ndarray]:
    """Return K (3, 3), px, and cam_from_world (4, 4), m, of a listed camera."""
    placed = bool(camera.position or camera.target)
    expected = {"size": (2,), "dist": range(5, 9)}
    expected |= {"position": (3,), "target": (3,)} if placed else {"cam_from_world": (12,)}
    expected |= {"K": (9,)} if camera.focal is None else {}
    for name, lengths in expected.items():
        found = len(getattr(camera, name))
        if found not in lengths:
            raise ValueError(f"{where}: expected {' or '.join(map(str, lengths))} numbers of {name}, found {found}")
    for first, second, both in (
        ("K", "focal", camera.K and camera.focal is not None),
        ("cam_from_world", "position and target", camera.cam_from_world and placed),
    ):
        if both:
            raise ValueError(f"{where}: expected either {first} or {second}, found both")
    if camera.focal is None:
        K = np.reshape(camera.K, (3, 3))
    else:
        check_picture(where, camera.focal, camera.size)
        K = intrinsics(camera.focal, camera.size)
    if not placed:
        return K, np.vstack([np.reshape(camera.cam_from_world, (3, 4)), (0, 0, 0, 1)])
    center, target = np.array([camera.position], float), np.array(camera.target, float)
    if np.allclose(center, target):
        raise ValueError(f"{where}: expected a target that is not the position, found both at {camera.target}")
    return K, pose(look_at(center, target), center)[0]
