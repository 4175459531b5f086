"""Lenses for MuJoCo, which only has pinhole cameras. Only this module converts OpenCV's convention to MuJoCo's."""

from dataclasses import replace

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from dmae.data.cameras import CameraRig

# MuJoCo's camera looks along -z with y up, OpenCV's along +z with y down.
_OPENCV_FROM_MUJOCO = np.diag([1.0, -1.0, -1.0])
_METRES_PER_PIXEL = 1e-5
_WIDEST = 4.0
_WIDEST_FISHEYE = 2.0
_OVERLAP = 4
"""Overlap of the pinhole images that replace a wide lens, px."""
ELSEWHERE = -10.0
"""Coordinate that marks a pixel outside every pinhole image, px."""
_QUARTER = np.pi / 2
_SIDES = {"": (0, 0), "right": (0, -_QUARTER), "left": (0, _QUARTER), "down": (_QUARTER, 0), "up": (-_QUARTER, 0)}
"""Rotations about the camera's x and y axes that turn it to each side, rad."""


def pinholes(rig: CameraRig) -> list[CameraRig]:
    """Return the pinhole cameras that are rendered in place of each camera. Together they see everything that it sees.

    An undistorted camera does not change. A distorted camera is replaced by a pinhole with a larger image, from which
    the distorted image is warped; its principal point is moved by whole pixels. If this image would be more than twice
    as wide or high, a fisheye is replaced by five cameras with a 90 degree view each, one ahead and four to the sides.
    They are called `<name>`, `<name>/left` and so on.

    Raises ValueError if the pinhole image of a lens other than a fisheye would be over four times as wide or high, or
    the distortion polynomial of the lens is not invertible within its image.
    """
    return [_pinholes(rig[view : view + 1]) for view in range(len(rig))]


def _pinholes(camera: CameraRig) -> CameraRig:
    if not camera.distorted[0]:
        return camera
    edge = _edge(*camera.size[0])
    ideal = camera.undistort(edge)
    widest = (_WIDEST_FISHEYE if camera.fisheye[0] else _WIDEST) * camera.size[0]
    low, high = np.floor(ideal.min((0, 1, 2))), np.ceil(ideal.max((0, 1, 2)))
    if not (high - low < widest).all():
        if camera.fisheye[0]:
            return _cube(camera)
        raise _unfit(camera)
    again, _ = camera.project(camera.centers + camera.rays(edge)[0])
    # Beyond the radius at which a distortion polynomial turns around, it is invalid.
    if not np.allclose(again, edge, atol=0.1):
        raise _unfit(camera)
    K = camera.K.copy()
    K[0, :2, 2] -= low
    return replace(camera.undistorted, K=K, size=np.array([high - low + 1]))


def _unfit(camera: CameraRig) -> ValueError:
    width, height = camera.size[0]
    return ValueError(
        f"camera {camera.names[0]!r}: no pinhole image of up to {_WIDEST:.0f} times {width} x {height} px "
        f"holds what a lens of distortion {camera.dist[0]} sees; such a camera cannot be rendered"
    )


def _cube(camera: CameraRig) -> CameraRig:
    """Return five cameras with a 90 degree view each, with the resolution of the fisheye at its image centre."""
    focal = np.ceil(max(camera.K[0, 0, 0], camera.K[0, 1, 1]))
    side = 2 * (focal + _OVERLAP) + 1
    pose = np.tile(camera.cam_from_world, (len(_SIDES), 1, 1))
    pose[:, :3] = _turns() @ pose[:, :3]
    return CameraRig(
        tuple(camera.names[0] + (f"/{name}" if name else "") for name in _SIDES),
        np.tile([[focal, 0, side // 2], [0, focal, side // 2], [0, 0, 1]], (len(_SIDES), 1, 1)),
        np.zeros((len(_SIDES), 5)),
        pose,
        np.full((len(_SIDES), 2), side),
    )


def _turns() -> np.ndarray:
    """Return (5, 3, 3) rotations from a camera to the cameras of `_SIDES`."""
    return np.array([Rotation.from_euler("xy", turn).as_matrix() for turn in _SIDES.values()])


def _edge(width: int, height: int) -> np.ndarray:
    """Return (1, 1, E, 2) pixels just outside an image, all around it."""
    x, y = np.arange(-1, width + 1), np.arange(-1, height + 1)
    rows = [np.stack(np.broadcast_arrays(x, row), -1) for row in (-1, height)]
    columns = [np.stack(np.broadcast_arrays(column, y), -1) for column in (-1, width)]
    return np.concatenate(rows + columns)[None, None].astype(float)


def warps(camera: CameraRig) -> list[np.ndarray] | None:
    """Return the positions of one camera's pixels in the images of its `pinholes`; None if they are the same.

    Each pinhole has an (H, W, 2) float32 array, px. It is negative where the pixel comes from another pinhole or where
    the lens shows nothing.
    """
    if not camera.distorted[0]:
        return None
    (cameras,) = pinholes(camera)
    grid = np.stack(np.meshgrid(*(np.arange(n, dtype=float) for n in camera.size[0])), -1)
    ideal = camera.undistort(grid[None, None])[0, 0]
    if len(cameras) == 1:
        return [(ideal + cameras.K[0, :2, 2] - camera.K[0, :2, 2]).astype(np.float32)]
    K = camera.K[0]
    x, y = np.moveaxis((ideal - K[:2, 2]) @ np.linalg.inv(K[:2, :2]).T, -1, 0)
    rays = np.stack([x, y, np.ones_like(x)], -1)
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    turned = np.einsum("sij,hwj->shwi", _turns(), rays)
    nearest = turned[..., 2].argmax(0)
    maps = []
    for number, (toward, intrinsics) in enumerate(zip(turned, cameras.K, strict=True)):
        shown = (nearest == number) & np.isfinite(x)
        ahead = np.where(shown, toward[..., 2], 1)[..., None]
        pixels = toward[..., :2] / ahead * intrinsics[0, 0] + intrinsics[:2, 2]
        maps.append(np.where(shown[..., None], pixels, ELSEWHERE).astype(np.float32))
    return maps


def joined(rigs: list[CameraRig]) -> CameraRig:
    """Return one rig with the cameras of all `rigs`, in order."""
    longest = max(rig.dist.shape[1] for rig in rigs)
    return CameraRig(
        sum((rig.names for rig in rigs), ()),
        np.concatenate([rig.K for rig in rigs]),
        np.concatenate([np.pad(rig.dist, ((0, 0), (0, longest - rig.dist.shape[1]))) for rig in rigs]),
        np.concatenate([rig.cam_from_world for rig in rigs]),
        np.concatenate([rig.size for rig in rigs]),
        np.concatenate([rig.fisheye for rig in rigs]),
    )


def add_cameras(spec: mujoco.MjSpec, rig: CameraRig) -> None:
    """Add the rig's `pinholes` to a scene in order, named by `camera_name`, and set the size of the image buffer.

    Raises ValueError if a camera has skew, which MuJoCo cannot render, or a lens that `pinholes` refuses.
    """
    largest = np.zeros(2, int)
    for cameras in pinholes(rig):
        for view, name in enumerate(cameras.names):
            K, (width, height) = cameras.K[view], cameras.size[view]
            if abs(K[0, 1]) > 1e-6 * K[0, 0]:
                raise ValueError(f"camera {name!r}: MuJoCo renders no skew, K[0, 1] is {K[0, 1]}; expected 0")
            quat = Rotation.from_matrix(cameras.cam_from_world[view, :3, :3].T @ _OPENCV_FROM_MUJOCO).as_quat()
            spec.worldbody.add_camera(
                name=camera_name(name),
                pos=cameras.centers[view],
                quat=np.roll(quat, 1),
                resolution=[width, height],
                sensor_size=[width * _METRES_PER_PIXEL, height * _METRES_PER_PIXEL],
                focal_pixel=[K[0, 0], K[1, 1]],
                principal_pixel=[width / 2 - 0.5 - K[0, 2], height / 2 - 0.5 - K[1, 2]],
            )
        largest = np.maximum(largest, cameras.size.max(0))
    spec.visual.global_.offwidth, spec.visual.global_.offheight = largest


def camera_name(name: str) -> str:
    """Return the name in the scene of a camera of the rig."""
    return f"rig/{name}"
