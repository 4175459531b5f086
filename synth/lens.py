"""Lenses in MuJoCo, which only has pinholes, and the only place where OpenCV's convention meets MuJoCo's."""

from dataclasses import replace

import cv2
import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from dmae.cameras import CameraRig

# MuJoCo's camera looks along -z with y up, OpenCV's along +z with y down.
_OPENCV_FROM_MUJOCO = np.diag([1.0, -1.0, -1.0])
_METRES_PER_PIXEL = 1e-5
_WIDEST = 4.0
_WIDEST_FISHEYE = 2.0
_OVERLAP = 4
"""By which the pictures of a wide lens reach over each other, px."""
_ELSEWHERE = -10.0
"""A pixel that no picture has."""
_QUARTER = np.pi / 2
_SIDES = {"": (0, 0), "right": (0, -_QUARTER), "left": (0, _QUARTER), "down": (_QUARTER, 0), "up": (-_QUARTER, 0)}
"""Turns about the camera's x and y that bring what is on a side before the camera, rad."""


def pinholes(rig: CameraRig) -> list[CameraRig]:
    """The cameras without distortion that are rendered in place of each of `rig`'s, and see all that it sees.

    An undistorted camera is its own. A distorted one gets an image large enough to be warped from, its principal
    point moved by whole pixels; a fisheye whose image would be more than twice as wide or high gets five of a right
    angle: ahead and to all sides, called `<name>`, `<name>/left` and so on.

    Raises:
        ValueError: a lens that is no fisheye is so wide that its pinhole image would be over four times as wide or
            high, or bends back what is in its image.
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
    # Beyond the radius where a distortion polynomial turns around it is no camera's.
    if not np.allclose(again, edge, atol=0.1):
        raise _unfit(camera)
    K = camera.K.copy()
    K[0, :2, 2] -= low
    return replace(camera.undistorted, K=K, size=[high - low + 1])


def _unfit(camera: CameraRig) -> ValueError:
    width, height = camera.size[0]
    return ValueError(
        f"camera {camera.names[0]!r}: no pinhole image of up to {_WIDEST:.0f} times {width} x {height} px "
        f"holds what a lens of distortion {camera.dist[0]} sees; such a camera cannot be rendered"
    )


def _cube(camera: CameraRig) -> CameraRig:
    """Five cameras of a right angle, as fine as the fisheye in its middle."""
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
    """(5, 3, 3) rotations from a camera to the cameras of `_SIDES`."""
    return np.array([Rotation.from_euler("xy", turn).as_matrix() for turn in _SIDES.values()])


def _edge(width: int, height: int) -> np.ndarray:
    """(1, 1, E, 2) pixels just outside an image, all around it."""
    x, y = np.arange(-1, width + 1), np.arange(-1, height + 1)
    rows = [np.stack(np.broadcast_arrays(x, row), -1) for row in (-1, height)]
    columns = [np.stack(np.broadcast_arrays(column, y), -1) for column in (-1, width)]
    return np.concatenate(rows + columns)[None, None].astype(float)


def warps(camera: CameraRig) -> list[np.ndarray] | None:
    """Where the pixels of one camera's image are in those of its `pinholes`; None where they are the same.

    Returns:
        One (H, W, 2) float32 array for each of the pinholes, px; negative where the pixel is to be taken from
        another, or where the lens shows nothing.
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
        maps.append(np.where(shown[..., None], pixels, _ELSEWHERE).astype(np.float32))
    return maps


class LensPainter:
    """Pictures through the lenses of a rig, warped from those of its `pinholes`.

    Args:
        painter: Paints the pinholes of all views, in order: see `synth.render.Renderer`.
        rig: V cameras.
    """

    def __init__(self, painter, rig: CameraRig):
        self._painter, self._maps = painter, [warps(rig[view : view + 1]) for view in range(len(rig))]
        counts = [len(cameras) for cameras in pinholes(rig)]
        self._parts = [range(end - count, end) for end, count in zip(np.cumsum(counts).tolist(), counts, strict=True)]

    def paint(self, data: mujoco.MjData, view: int, kinds: tuple[str, ...]) -> tuple[np.ndarray | None, ...]:
        """Images of the painter's kinds; nothing is where the lens shows nothing."""
        pictures = [self._painter.paint(data, part, kinds) for part in self._parts[view]]
        return tuple(self._bent(list(images), view) for images in zip(*pictures, strict=True))

    def paint_alone(self, data: mujoco.MjData, view: int, owner: int) -> np.ndarray:
        """(H, W) True for the pixels that what has the id `owner` would cover if nothing else were there."""
        pictures = [self._painter.paint_alone(data, part, owner) for part in self._parts[view]]
        return self._bent([picture.astype(np.uint16) for picture in pictures], view) > 0

    def _bent(self, images: list[np.ndarray | None], view: int) -> np.ndarray | None:
        """One image made of those of the pinholes. Only colours may be mixed."""
        if images[0] is None or self._maps[view] is None:
            return images[0]
        how = cv2.INTER_LINEAR if images[0].ndim == 3 else cv2.INTER_NEAREST
        nothing = np.nan if images[0].dtype == np.float32 else 0
        bent = None
        for image, pixels in zip(images, self._maps[view], strict=True):
            part = cv2.remap(image, pixels, None, how, borderMode=cv2.BORDER_CONSTANT, borderValue=nothing)
            if bent is None:
                bent = part
            else:
                shown = pixels[..., 0] > _ELSEWHERE
                bent[shown] = part[shown]
        return bent

    def close(self) -> None:
        """Hand back what the painter holds."""
        self._painter.close()


def joined(rigs: list[CameraRig]) -> CameraRig:
    """One rig of the cameras of several."""
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
    """Put the rig's `pinholes` into a scene, in order, named by `camera_name`, and make room for their images.

    Raises:
        ValueError: a camera has skew, which MuJoCo cannot render, or a lens that `pinholes` refuses.
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
    """What a camera of the rig is called within the scene."""
    return f"rig/{name}"
