"""Calibrated cameras: project points to pixels, cast rays through pixels."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from math import prod

import cv2
import numpy as np

from dmae.data.array_fields import UNSET, same_fields, set_array, short_repr
from dmae.files.checks import LEAST_FOCAL, MOST_DISTORTION, MOST_FOCAL, MOST_METRES, MOST_SIZE, check_numbers

# OpenCV's default criteria leave up to 0.07 px; these converge to 1e-10.
_UNDISTORT_CRITERIA = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 200, 1e-12)
_RIGHT = 1e-3  # Focal lengths; an undistorted point is distorted to within this distance of where it was


def camera_label(name: str) -> str:
    """Return how texts call a camera: `camera left`, but `cam_02` alone, as this name says that it is one."""
    return name if name.lower().startswith("cam") else f"camera {name}"


@dataclass(frozen=True)
class CameraRig:
    """V calibrated cameras in OpenCV's convention (x right, y down, z forward).

    Pixel (0, 0) is the centre of the first pixel. World is metres, z up.

    Attributes:
        names: V camera names, unique.
        K: (V, 3, 3) intrinsics, px.
        dist: (V, 4..8) OpenCV distortion k1 k2 p1 p2 [k3 [k4 k5 k6]]; zeros or None for pinhole
            cameras. For a fisheye, k1 k2 k3 k4. Stored with zeros after four coefficients, as (V, 5..8).
        cam_from_world: (V, 4, 4) rigid transforms, m.
        size: (V, 2) image width and height, px.
        fisheye: (V,) True for lenses of OpenCV's fisheye model (Kannala & Brandt, PAMI 2006); by default all False.
    """

    names: tuple[str, ...]
    K: np.ndarray
    dist: np.ndarray
    cam_from_world: np.ndarray
    size: np.ndarray
    fisheye: np.ndarray = UNSET

    __repr__, __eq__ = short_repr, same_fields

    def __post_init__(self):
        if isinstance(self.names, str) or not isinstance(self.names, Iterable):
            raise TypeError(f"CameraRig.names: expected a list of names, one for each camera, found {self.names!r}")
        object.__setattr__(self, "names", tuple(str(name) for name in self.names))
        views = len(self.names)
        if len(set(self.names)) != views:
            raise ValueError(f"camera names must be unique, found {self.names}")
        set_array(self, "K", np.float64, (views, 3, 3))
        if self.dist is None:
            object.__setattr__(self, "dist", np.zeros((views, 5)))
        set_array(self, "dist", np.float64, (views, "4..8"))
        set_array(self, "cam_from_world", np.float64, (views, 4, 4))
        set_array(self, "size", np.int64, (views, 2))
        set_array(self, "fisheye", bool, (views,), False)
        if self.dist.shape[1] == 4:
            object.__setattr__(self, "dist", np.pad(self.dist, ((0, 0), (0, 1))))
        if not 5 <= self.dist.shape[1] <= 8:
            raise ValueError(f"CameraRig.dist: expected shape ({views}, 4..8), found {self.dist.shape}")
        for view, name in enumerate(self.names):
            K, T = self.K[view], self.cam_from_world[view]
            if not (np.isfinite(K).all() and np.isfinite(T).all() and np.isfinite(self.dist[view]).all()):
                raise ValueError(f"camera {name!r}: calibration has values that are not finite")
            if K[0, 0] <= 0 or K[1, 1] <= 0:
                raise ValueError(f"camera {name!r}: focal lengths must be positive, found {K[0, 0]}, {K[1, 1]}")
            check_numbers(f"camera {name!r}: focal lengths, px", K[[0, 1], [0, 1]], MOST_FOCAL, LEAST_FOCAL)
            check_numbers(f"camera {name!r}: K, px", K, MOST_FOCAL)
            check_numbers(f"camera {name!r}: distortion", self.dist[view], MOST_DISTORTION)
            check_numbers(f"camera {name!r}: cam_from_world, m", T, MOST_METRES)
            if np.abs(K[2] - (0, 0, 1)).max() > 1e-5 or np.abs(T[3] - (0, 0, 0, 1)).max() > 1e-5:
                raise ValueError(f"camera {name!r}: last rows must be K (0 0 1) and cam_from_world (0 0 0 1)")
            # Published calibrations round their rotations to about 1e-4.
            error = np.abs(T[:3, :3] @ T[:3, :3].T - np.eye(3)).max()
            if error > 1e-3 or np.linalg.det(T[:3, :3]) < 0:
                raise ValueError(
                    f"camera {name!r}: cam_from_world holds no rotation (R R^T is off by {error:.1e}, "
                    f"det {np.linalg.det(T[:3, :3]):+.3f}); expected an orthonormal right-handed 3x3"
                )
            if (self.size[view] <= 0).any():
                raise ValueError(f"camera {name!r}: image size must be positive, found {tuple(self.size[view])}")
            check_numbers(f"camera {name!r}: image size, px", self.size[view], MOST_SIZE)
            if self.fisheye[view] and self.dist[view, 4:].any():
                raise ValueError(f"camera {name!r}: a fisheye has four coefficients, found {self.dist[view]}")

    def __len__(self) -> int:
        return len(self.names)

    def __getitem__(self, views) -> "CameraRig":
        """Return the rig of some views: a slice, or a list of names or indices. One camera is `rig[2:3]`."""
        index = self.indices(views)
        if index.ndim != 1:
            raise TypeError(f"a rig is indexed by a slice or a list; for one camera use rig[[{views}]]")
        return CameraRig(
            tuple(self.names[i] for i in index),
            self.K[index],
            self.dist[index],
            self.cam_from_world[index],
            self.size[index],
            self.fisheye[index],
        )

    def indices(self, views) -> np.ndarray:
        """Return the indices (n,) of some views: a slice, or a list of names or indices.

        Raises IndexError if there is no such camera.
        """
        try:
            if isinstance(views, list | tuple) and any(isinstance(each, str) for each in views):
                views = [self.names.index(each) for each in views]
            return np.arange(len(self))[views]
        except (IndexError, ValueError):
            if isinstance(views, str) and views in self.names:
                raise TypeError(f"a rig is indexed by a slice or a list; for one camera use rig[[{views!r}]]") from None
            views = repr(views) if isinstance(views, str) else views
            named = ", ".join(f"{index} ({name})" for index, name in enumerate(self.names))
            raise IndexError(
                f"cameras {views}: expected a slice, or a list of names or indices; there are {named}"
            ) from None

    @property
    def distorted(self) -> np.ndarray:
        """(V,) True for cameras with distortion."""
        return self.dist.any(-1) | self.fisheye

    @cached_property
    def undistorted(self) -> "CameraRig":
        """The pinhole cameras with the same K, for the pixels that `undistort` returns."""
        return replace(self, dist=np.zeros((len(self), 5)), fisheye=UNSET) if self.distorted.any() else self

    @cached_property
    def centers(self) -> np.ndarray:
        """(V, 3) camera centres in the world, m."""
        R, t = self.cam_from_world[:, :3, :3], self.cam_from_world[:, :3, 3]
        return _read_only(np.linalg.solve(R, -t[..., None])[..., 0])

    @cached_property
    def focal(self) -> np.ndarray:
        """(V,) focal lengths, px: the geometric mean of fx and fy."""
        return _read_only(np.sqrt(self.K[:, 0, 0] * self.K[:, 1, 1]))

    @cached_property
    def projections(self) -> np.ndarray:
        """(V, 3, 4) pinhole projection matrices K [R | t], for undistorted pixels."""
        return _read_only(self.K @ self.cam_from_world[:, :3])

    @cached_property
    def world_from_pixel(self) -> np.ndarray:
        """(V, 3, 3) matrices that turn undistorted homogeneous pixels into directions in the world, of any length."""
        return _read_only(np.linalg.inv(self.K @ self.cam_from_world[:, :3, :3]))

    def project(self, xyz: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the projections of points (F, ..., 3) m, world, into each camera.

        Returns:
            xy: (F, V, ..., 2) px; NaN for points that are NaN, not in front of the camera, or farther from its axis
                than `reach`.
            depth: (F, V, ...) distance along the optical axis, m.
        """
        shape = np.shape(xyz)
        if len(shape) < 2 or shape[-1] != 3:
            raise ValueError(f"xyz: expected points (F, ..., 3), as poses.xyz, found {type(xyz).__name__} {shape}")
        xyz = np.asarray(xyz, np.float64)
        flat = xyz.reshape(len(xyz), 1, prod(xyz.shape[1:-1]), 3)
        R, t = self.cam_from_world[:, :3, :3], self.cam_from_world[:, :3, 3]
        in_camera = flat @ R.transpose(0, 2, 1) + t[:, None]
        depth = in_camera[..., 2]
        with np.errstate(divide="ignore", invalid="ignore"):
            normalised = np.where(depth[..., None] > 0, in_camera[..., :2] / depth[..., None], np.nan)
        xy = self._pixels(normalised)
        shape = (len(xyz), len(self), *xyz.shape[1:-1])
        return xy.reshape(*shape, 2), depth.reshape(shape)

    def _pixels(self, normalised: np.ndarray) -> np.ndarray:
        """Return the pixels (F, V, N, 2) of normalised image points: distort them and apply K."""
        if self.distorted.any() and normalised.size:
            # OpenCV ignores the skew of K, so it is only used for the distortion.
            xy = np.empty_like(normalised)
            for view in range(len(self)):
                xy[:, view] = self._distort(view, normalised[:, view].reshape(-1, 1, 2)).reshape(xy[:, view].shape)
            radius = np.linalg.norm(normalised, axis=-1, keepdims=True)
            normalised = np.where(radius < self.reach[:, None, None], xy, np.nan)
        return normalised @ self.K[:, :2, :2].swapaxes(-1, -2) + self.K[:, None, :2, 2]

    def _distort(self, view: int, points: np.ndarray) -> np.ndarray:
        if self.fisheye[view]:
            # OpenCV reads the points as if they followed each other in memory.
            return cv2.fisheye.distortPoints(np.ascontiguousarray(points), np.eye(3), self.dist[view, :4])
        rays = np.concatenate([points, np.ones_like(points[..., :1])], -1)
        return cv2.projectPoints(rays, np.zeros(3), np.zeros(3), np.eye(3), self._opencv_dist(view))[0]

    @cached_property
    def reach(self) -> np.ndarray:
        """(V,) tangent of the largest angle off axis up to which distortion is monotonic; inf if it always is.

        Beyond this angle the distortion polynomial decreases, and would project points far outside the image into it.
        """
        return np.array(
            [
                np.tan(_fisheye_reach(tuple(dist[:4]))) if fisheye else _radial_reach(tuple(dist))
                for dist, fisheye in zip(self.dist, self.fisheye, strict=True)
            ]
        )

    def _opencv_dist(self, view: int) -> np.ndarray:
        """Return 5 or 8 coefficients: OpenCV accepts neither 6 nor 7."""
        dist = self.dist[view]
        return dist if len(dist) == 5 else np.pad(dist, (0, 8 - len(dist)))

    def undistort(self, xy: np.ndarray) -> np.ndarray:
        """Return distorted pixels (F, V, ..., 2) as in ideal pinhole cameras with the same K.

        NaN stays NaN, and pixels to which no point within `reach` is projected become NaN.
        """
        xy = np.asarray(xy, np.float64)
        if xy.ndim < 3 or xy.shape[1] != len(self) or xy.shape[-1] != 2:
            raise ValueError(f"expected pixels of shape (F, {len(self)}, ..., 2), found {xy.shape}")
        if not self.distorted.any():
            return xy
        ideal = np.full_like(xy, np.nan)
        for view in range(len(self)):
            seen = np.isfinite(xy[:, view]).all(-1)
            if seen.any():
                K = self.K[view, :2]
                distorted = np.linalg.solve(K[:, :2], (xy[:, view][seen] - K[:, 2]).T).T
                points = self._undistort(view, distorted[:, None])[:, 0]
                ideal[:, view][seen] = points @ K[:, :2].T + K[:, 2]
        return ideal

    def _undistort(self, view: int, points: np.ndarray) -> np.ndarray:
        if self.fisheye[view]:
            # OpenCV's own inverse clips distorted angles at 90 degrees.
            return points * _undistorted_ratio(self.dist[view, :4], np.linalg.norm(points, axis=-1, keepdims=True))
        K, dist = np.eye(3), self._opencv_dist(view)
        if hasattr(cv2, "undistortPointsIter"):  # OpenCV 4
            found = cv2.undistortPointsIter(points, K, dist, None, None, _UNDISTORT_CRITERIA)
        else:
            found = cv2.undistortPoints(points, K, dist, criteria=_UNDISTORT_CRITERIA)
        if self.reach[view] == np.inf:
            return found
        # Where there is no such point OpenCV returns another one.
        right = np.abs(self._distort(view, found) - points).max(-1) < _RIGHT
        return np.where((right & (np.linalg.norm(found, axis=-1) < self.reach[view]))[..., None], found, np.nan)

    def rays(self, xy: np.ndarray) -> np.ndarray:
        """Return unit directions (F, V, ..., 3), world, from the camera centres through pixels (F, V, ..., 2)."""
        ideal = self.undistort(xy)
        flat = ideal.reshape(*ideal.shape[:2], prod(ideal.shape[2:-1]), 2)
        homogeneous = np.concatenate([flat, np.ones_like(flat[..., :1])], -1)
        direction = homogeneous @ self.world_from_pixel.swapaxes(-1, -2)
        direction /= np.linalg.norm(direction, axis=-1, keepdims=True)
        return direction.reshape(*ideal.shape[:-1], 3)

    def inside(self, xy: np.ndarray) -> np.ndarray:
        """Return (F, V, ...) True where pixels (F, V, ..., 2) are in the image; False for NaN."""
        xy = np.asarray(xy)
        size = self.size.reshape(1, len(self), *(1,) * (xy.ndim - 3), 2)
        with np.errstate(invalid="ignore"):
            return np.all((xy >= -0.5) & (xy <= size - 0.5), -1)


def _read_only(values: np.ndarray) -> np.ndarray:
    """Return the array after making it read-only, because all users of a rig share it."""
    values.flags.writeable = False
    return values


@lru_cache(maxsize=1000)
def _radial_reach(dist: tuple[float, ...]) -> float:
    """Return the tangent of the angle off axis up to which OpenCV's rational polynomial increases, or inf."""
    square = np.linspace(0, 10, 10001) ** 2
    k1, k2, _, _, k3, k4, k5, k6 = np.pad(dist, (0, 8 - len(dist)))
    above, below = (1 + square * (a + square * (b + square * c)) for a, b, c in ((k1, k2, k3), (k4, k5, k6)))
    growing = (np.diff(np.sqrt(square) * above / below) > 0) & (below[1:] > 0)
    return np.inf if growing.all() else np.sqrt(square[growing.argmin()])


def _distorted_angle(k: np.ndarray | tuple[float, ...], angle: np.ndarray) -> np.ndarray:
    """Return the distorted angles, rad, of angles off axis, rad, for a fisheye with coefficients k1..k4."""
    square = angle**2
    return angle * (1 + square * (k[0] + square * (k[1] + square * (k[2] + square * k[3]))))


@lru_cache(maxsize=1000)
def _fisheye_reach(k: tuple[float, ...]) -> float:
    """Return the angle off axis, rad, up to which a fisheye is monotonic; at most pi / 2 - 0.001."""
    angle = np.linspace(0, np.pi / 2 - 1e-3, 10001)
    growing = np.diff(_distorted_angle(k, angle)) > 0
    return angle[-1] if growing.all() else angle[growing.argmin()]


def _undistorted_ratio(k: np.ndarray, distorted: np.ndarray) -> np.ndarray:
    """Return the ratio of ideal to distorted radius, NaN beyond the lens: four Newton steps from a table."""
    table = np.linspace(0, _fisheye_reach(tuple(k)), 1001)
    angle = np.interp(distorted, _distorted_angle(k, table), table, right=np.nan)
    for _ in range(4):
        square = angle**2
        slope = 1 + square * (3 * k[0] + square * (5 * k[1] + square * (7 * k[2] + square * 9 * k[3])))
        angle -= (_distorted_angle(k, angle) - distorted) / slope
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(distorted > 0, np.tan(angle) / distorted, 1.0)
