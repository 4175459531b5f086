"""Read the numbers of each camera in a calibration file, with errors that name file, camera and key."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from dmae.data.cameras import CameraRig

# CameraRig accepts the same rounding of published rotations. The error raised here names the key.
_ROUNDING = 1e-3
_LARGEST = 1e10
"""Largest absolute value of any number: ten thousand kilometres in millimetres."""


class ParsedCamera(NamedTuple):
    """One camera in the convention of its file, with its pose as [R | t]."""

    name: str
    K: np.ndarray
    dist: np.ndarray
    R: np.ndarray
    t: np.ndarray
    size: np.ndarray | None
    """Width and height, px; None if the file does not state them."""
    fisheye: bool = False


@dataclass(frozen=True)
class CameraTable:
    """The values of one camera in a calibration file, by key.

    Every method raises ValueError that names file, camera and key, the expected value and the value found.
    """

    path: Path
    camera: str
    values: dict

    def __post_init__(self):
        if not isinstance(self.values, dict):
            raise ValueError(
                f"{self.path}: camera {self.camera!r}: expected a table of its values, found {self.values!r:.60}"
            )

    def error(self, key: str, expected: str, found) -> ValueError:
        return ValueError(f"{self.path}: camera {self.camera!r}: expected {key} {expected}, found {found}")

    def numbers(self, key: str, *counts: int) -> np.ndarray:
        """Return the finite numbers of a key as a flat array. Their count must be one of `counts`."""
        wanted = f"of {' or '.join(map(str, counts))} numbers"
        if key not in self.values:
            raise self.error(key, wanted, f"no such key among {sorted(map(str, self.values))}")
        found = self.values[key]
        try:
            array = np.ravel(np.asarray(found))
        except ValueError:
            raise self.error(key, wanted, f"{found!r:.60}") from None
        if array.dtype.kind not in "iuf" or array.size not in counts:
            raise self.error(key, wanted, f"{found!r:.60}")
        if not np.isfinite(array).all():
            raise self.error(key, "of finite numbers", f"{found!r:.60}")
        if (np.abs(array.astype(np.float64)) > _LARGEST).any():
            raise self.error(key, f"of numbers up to {_LARGEST:g}", f"{found!r:.60}")
        return array.astype(np.float64)

    def intrinsics(self, key: str) -> np.ndarray:
        """Return a camera matrix (3, 3), px."""
        K = self.numbers(key, 9).reshape(3, 3)
        if not np.allclose(K[2], (0, 0, 1)) or not np.isclose(K[1, 0], 0):
            raise self.error(key, "to be a camera matrix (fx s cx, 0 fy cy, 0 0 1)", K.tolist())
        self.check_focal(key, K[0, 0], K[1, 1])
        return K

    def check_focal(self, key: str, *lengths: float) -> None:
        if min(lengths) <= 0:
            raise self.error(key, "of positive focal lengths", ", ".join(f"{length:g}" for length in lengths))

    def rotation(self, key: str, matrix: np.ndarray | None = None) -> np.ndarray:
        """Return the checked rotation matrix (3, 3) of a key.

        Args:
            key: The key.
            matrix: The matrix, if it is a part of a larger array of this key.
        """
        R = self.numbers(key, 9).reshape(3, 3) if matrix is None else matrix
        # The file can contain numbers that overflow.
        with np.errstate(all="ignore"):
            error, determinant = np.abs(R @ R.T - np.eye(3)).max(), np.linalg.det(R)
        if not (error <= _ROUNDING and determinant > 0):
            found = f"a matrix with R R^T off by {error:.1e} and determinant {determinant:+.3f}"
            raise self.error(key, "to be a right-handed rotation", found)
        return R

    def rodrigues(self, key: str) -> np.ndarray:
        """Return the rotation matrix (3, 3) of a Rodrigues vector, rad."""
        return Rotation.from_rotvec(self.numbers(key, 3)).as_matrix()

    def size(self, *keys: str) -> np.ndarray:
        """Return image width and height, px, from one key or from two."""
        size = np.concatenate([self.numbers(key, 2 // len(keys)) for key in keys])
        if not ((size >= 1) & (size < 1e6) & (size == np.round(size))).all():
            raise self.error(", ".join(keys), "to be a positive whole width and height", size.tolist())
        return size.astype(np.int64)


class LacksSize(ValueError):
    """Raised when a calibration file states no image size and none is given; names the option that gives it."""

    def __init__(self, what: str, option: str = "size"):
        super().__init__(f"{what}; give it as {option}=[width,height], px")
        self.what = what


def make_rig(path: Path, cameras: Iterable[ParsedCamera], size: tuple[int, int] | None) -> CameraRig:
    """Return the rig of the cameras in a file, in the units and world axes of the file.

    Args:
        path: Path of the file, for messages.
        cameras: The cameras in the file.
        size: Image width and height, px, of cameras for which the file states no size.

    Raises:
        LacksSize: the image size of a camera is unknown.
        ValueError: there are no cameras, two cameras have the same name, or `size` contradicts the file.
    """
    cameras = list(cameras)
    if not cameras:
        raise ValueError(f"{path}: expected cameras, found none")
    names = [camera.name for camera in cameras]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise ValueError(f"{path}: expected cameras of different names, found {', '.join(map(repr, twice))} twice")
    for camera in cameras:
        if camera.size is None and size is None:
            raise LacksSize(f"{path}: camera {camera.name!r}: the file holds no image size")
        if camera.size is not None and size is not None and tuple(camera.size) != tuple(size):
            raise ValueError(
                f"{path}: camera {camera.name!r}: the file says that images are of {camera.size.tolist()} px, "
                f"which contradicts size={list(size)}"
            )
    longest = max(len(camera.dist) for camera in cameras)
    cam_from_world = np.tile(np.eye(4), (len(cameras), 1, 1))
    cam_from_world[:, :3, :3] = [camera.R for camera in cameras]
    cam_from_world[:, :3, 3] = [camera.t for camera in cameras]
    try:
        return CameraRig(
            tuple(names),
            np.array([camera.K for camera in cameras]),
            np.array([np.pad(camera.dist, (0, max(longest, 5) - len(camera.dist))) for camera in cameras]),
            cam_from_world,
            np.array([size if camera.size is None else camera.size for camera in cameras]),
            np.array([camera.fisheye for camera in cameras]),
        )
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def require(format: str, rig: CameraRig, *, coefficients: int, fisheye: bool = False, skew: bool = True) -> None:
    """Check that a format can store the lenses of a rig.

    Args:
        format: Name of the format, for messages.
        rig: The cameras.
        coefficients: Number of OpenCV's distortion coefficients that the format stores.
        fisheye: Whether the format stores fisheye lenses.
        skew: Whether the format stores the skew of K.

    Raises:
        ValueError: the format cannot store a lens; the message names the camera and the values that would be lost.
    """
    for view, name in enumerate(rig.names):
        lost = None
        if rig.fisheye[view] and not fisheye:
            lost = "a fisheye lens"
        elif not rig.fisheye[view] and rig.dist[view, coefficients:].any():
            beyond = f" beyond {coefficients} coefficients" if coefficients else ""
            lost = f"distortion{beyond}, {rig.dist[view, coefficients:].tolist()}"
        elif rig.K[view, 0, 1] and not skew:
            lost = f"the skew {rig.K[view, 0, 1]} of K"
        if lost:
            raise ValueError(f"camera {name!r}: {format} cannot hold {lost}; choose another format or undistort first")


def orthonormal(rig: CameraRig) -> tuple[np.ndarray, np.ndarray]:
    """Return the exact rotations (V, 3, 3) nearest to those of a rig, and translations (V, 3) m for the same centres.

    Published rotation matrices are rounded. A Rodrigues vector can only describe an exact rotation.
    """
    R = Rotation.from_matrix(rig.cam_from_world[:, :3, :3]).as_matrix()
    return R, -np.einsum("vij,vj->vi", R, rig.centers)
