"""Where the cameras are, and the only place where OpenCV's convention meets MuJoCo's."""

from dataclasses import dataclass, field, replace

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from dmae.cameras import CameraRig

# MuJoCo's camera looks along -z with y up, OpenCV's along +z with y down.
_OPENCV_FROM_MUJOCO = np.diag([1.0, -1.0, -1.0])
_METRES_PER_PIXEL = 1e-5
_WIDEST = 4.0


@dataclass(frozen=True)
class CameraConfig:
    """One calibrated camera, in the numbers of `dmae.cameras.CameraRig`.

    Attributes:
        name: Unique in its rig.
        size: Image width and height, px.
        K: 9 numbers, row major, px.
        cam_from_world: 12 numbers, [R | t] row major, t in m.
        dist: 5 to 8 OpenCV distortion coefficients.
    """

    name: str
    size: list[int]
    K: list[float]
    cam_from_world: list[float]
    dist: list[float] = field(default_factory=lambda: [0.0] * 5)


@dataclass(frozen=True)
class RingConfig:
    """Cameras evenly around the vertical through the origin, looking at it; the ring's phase is random.

    Attributes:
        views: How many.
        radius: Least and greatest distance of a camera from the vertical, m.
        height: Least and greatest height of a camera, m.
        target_height: Height of the point they look at, m.
        focal: Focal length, px.
        size: Image width and height, px.
    """

    views: int = 5
    radius: list[float] = field(default_factory=lambda: [3.5, 4.5])
    height: list[float] = field(default_factory=lambda: [1.0, 2.7])
    target_height: float = 0.9
    focal: float = 1080.0
    size: list[int] = field(default_factory=lambda: [1032, 776])


@dataclass(frozen=True)
class RigConfig:
    """Which cameras there are: those listed, or else those of a ring.

    Attributes:
        name: For people to read.
        cameras: Calibrated cameras; empty for a ring.
        ring: Used where no cameras are listed.
    """

    name: str = "ring"
    cameras: list[CameraConfig] = field(default_factory=list)
    ring: RingConfig = field(default_factory=RingConfig)


def make_rig(config: RigConfig, *, rng: np.random.Generator) -> CameraRig:
    """The cameras of a clip. Rotations are made exactly orthonormal; only a ring draws from `rng`.

    Raises:
        ValueError: numbers are missing or make no camera; the message names the camera.
    """
    return _listed(config) if config.cameras else _ring(config.ring, rng)


def _listed(config: RigConfig) -> CameraRig:
    for camera in config.cameras:
        for name, lengths in (("size", (2,)), ("K", (9,)), ("cam_from_world", (12,)), ("dist", range(5, 9))):
            found = len(getattr(camera, name))
            if found not in lengths:
                raise ValueError(
                    f"rig {config.name!r}, camera {camera.name!r}: expected {' or '.join(map(str, lengths))} "
                    f"numbers of {name}, found {found}"
                )
    cam_from_world = np.tile(np.eye(4), (len(config.cameras), 1, 1))
    cam_from_world[:, :3] = [np.reshape(camera.cam_from_world, (3, 4)) for camera in config.cameras]
    longest = max(len(camera.dist) for camera in config.cameras)
    rig = CameraRig(
        tuple(camera.name for camera in config.cameras),
        np.array([np.reshape(camera.K, (3, 3)) for camera in config.cameras]),
        np.array([np.pad(camera.dist, (0, longest - len(camera.dist))) for camera in config.cameras]),
        cam_from_world,
        np.array([camera.size for camera in config.cameras]),
    )
    # Published rotations are rounded; MuJoCo's are quaternions. The nearest rotation, about the same centre,
    # is what both can hold.
    rotation = Rotation.from_matrix(rig.cam_from_world[:, :3, :3]).as_matrix()
    return replace(rig, cam_from_world=_pose(rotation, rig.centers))


def _ring(config: RingConfig, rng: np.random.Generator) -> CameraRig:
    if config.views < 1:
        raise ValueError(f"rig.ring.views: expected at least one camera, found {config.views}")
    angle = 2 * np.pi * (np.arange(config.views) + rng.uniform()) / config.views
    radius = rng.uniform(*config.radius, config.views)
    height = rng.uniform(*config.height, config.views)
    centers = np.stack([radius * np.cos(angle), radius * np.sin(angle), height], -1)
    forward = np.array([0, 0, config.target_height]) - centers
    forward /= np.linalg.norm(forward, axis=-1, keepdims=True)
    right = np.cross(forward, [0, 0, 1])
    right /= np.linalg.norm(right, axis=-1, keepdims=True)
    rotation = np.stack([right, np.cross(forward, right), forward], 1)
    width, rows = config.size
    K = np.array([[config.focal, 0, (width - 1) / 2], [0, config.focal, (rows - 1) / 2], [0, 0, 1]])
    return CameraRig(
        tuple(f"ring{view}" for view in range(config.views)),
        np.tile(K, (config.views, 1, 1)),
        np.zeros((config.views, 5)),
        _pose(rotation, centers),
        np.tile(config.size, (config.views, 1)),
    )


def _pose(rotation: np.ndarray, centers: np.ndarray) -> np.ndarray:
    """(V, 4, 4) cam_from_world of cameras at (V, 3) centres."""
    pose = np.tile(np.eye(4), (len(rotation), 1, 1))
    pose[:, :3, :3] = rotation
    pose[:, :3, 3] = -np.einsum("vij,vj->vi", rotation, centers)
    return pose


def pinhole(rig: CameraRig) -> CameraRig:
    """The cameras without distortion that are rendered in place of `rig`'s, and see all that it sees.

    An undistorted camera is its own; a distorted one gets an image large enough to be warped from, its
    principal point moved by whole pixels.

    Raises:
        ValueError: a lens is so wide that its pinhole image would be over four times as wide or high.
    """
    K, size = rig.K.copy(), rig.size.copy()
    for view in range(len(rig)):
        if not rig.distorted[view]:
            continue
        camera, (width, height) = rig[view : view + 1], rig.size[view]
        edge = _edge(width, height)
        ideal = camera.undistort(edge)
        low, high = np.floor(ideal.min((0, 1, 2))), np.ceil(ideal.max((0, 1, 2)))
        again, _ = camera.project(camera.centers + camera.rays(edge)[0])
        # Beyond the radius where a distortion polynomial turns around it is no camera's.
        if not (np.allclose(again, edge, atol=0.1) and (high - low < _WIDEST * rig.size[view]).all()):
            raise ValueError(
                f"camera {rig.names[view]!r}: no pinhole image of up to {_WIDEST:.0f} times {width} x {height} px "
                f"holds what a lens of distortion {rig.dist[view]} sees; such a camera cannot be rendered"
            )
        K[view, :2, 2] -= low
        size[view] = high - low + 1
    return replace(rig.undistorted, K=K, size=size)


def _edge(width: int, height: int) -> np.ndarray:
    """(1, 1, E, 2) pixels just outside an image, all around it."""
    x, y = np.arange(-1, width + 1), np.arange(-1, height + 1)
    rows = [np.stack(np.broadcast_arrays(x, row), -1) for row in (-1, height)]
    columns = [np.stack(np.broadcast_arrays(column, y), -1) for column in (-1, width)]
    return np.concatenate(rows + columns)[None, None].astype(float)


def warp(rig: CameraRig, view: int) -> np.ndarray | None:
    """(H, W, 2) float32 pixel of the `pinhole` image that each pixel of a view shows; None where they are the same."""
    if not rig.distorted[view]:
        return None
    camera = rig[view : view + 1]
    grid = np.stack(np.meshgrid(*(np.arange(n, dtype=float) for n in rig.size[view])), -1)
    shift = pinhole(camera).K[0, :2, 2] - camera.K[0, :2, 2]
    return (camera.undistort(grid[None, None])[0, 0] + shift).astype(np.float32)


def add_cameras(spec: mujoco.MjSpec, rig: CameraRig) -> None:
    """Put the rig's `pinhole` cameras into a scene, in order, named by `camera_name`, and make room for their images.

    Raises:
        ValueError: a camera has skew, which MuJoCo cannot render.
    """
    pinholes = pinhole(rig)
    for view, name in enumerate(rig.names):
        K, (width, height) = pinholes.K[view], pinholes.size[view]
        if abs(K[0, 1]) > 1e-6 * K[0, 0]:
            raise ValueError(f"camera {name!r}: MuJoCo renders no skew, K[0, 1] is {K[0, 1]}; expected 0")
        quat = Rotation.from_matrix(rig.cam_from_world[view, :3, :3].T @ _OPENCV_FROM_MUJOCO).as_quat()
        spec.worldbody.add_camera(
            name=camera_name(name),
            pos=rig.centers[view],
            quat=np.roll(quat, 1),
            resolution=[width, height],
            sensor_size=[width * _METRES_PER_PIXEL, height * _METRES_PER_PIXEL],
            focal_pixel=[K[0, 0], K[1, 1]],
            principal_pixel=[width / 2 - 0.5 - K[0, 2], height / 2 - 0.5 - K[1, 2]],
        )
    spec.visual.global_.offwidth, spec.visual.global_.offheight = pinholes.size.max(0)


def camera_name(name: str) -> str:
    """What a camera of the rig is called within the scene."""
    return f"rig/{name}"
