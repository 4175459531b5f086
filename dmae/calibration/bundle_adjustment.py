"""Bundle adjustment: the cameras and the bodies that fit the detections best.

First the problem: cameras, the parameters of them that may change, detected bodies, and the cost. A detector displaces
some joints of a person in a view by nearly constant offsets. They are 23 % of the energy of OpenPose's errors on Shelf,
with each view left out in turn. Longer recordings do not average them out. These offsets can therefore be unknowns too,
with a prior.

Then the adjustment: Levenberg-Marquardt on robust reprojection errors and bone lengths. The bodies are eliminated from
the normal equations (Schur complement; Triggs et al., Bundle adjustment - a modern synthesis, 2000). The cost of a step
then depends mostly on the number of cameras, and the covariance of the cameras is a by-product.
`scipy.optimize.least_squares` has no such elimination: with the sparse Jacobian and `lsmr` it takes four times as long
for 1000 bodies in eight cameras, stops centimetres away in directions that only priors hold, and the covariance needs
the elimination anyway.

F frames, P people; M bodies, each a person at one time; V views, J joints, A views with offsets; Q parameters per view:
rotation (3), centre (3), focal length, k1, time offset, drift.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from dmae.data.cameras import CameraRig
from dmae.data.skeleton import Skeleton
from dmae.numerics.compiled import compiled
from dmae.numerics.filling import are_stills
from dmae.numerics.statistics import evenly_spaced, median_over_frames

_FINE = ("eye", "ear", "toe", "heel")  # Joints that are too near to other joints to add information


def coarse_skeleton(skeleton: Skeleton) -> tuple[Skeleton, list[int]]:
    """Return the skeleton without the small joints of face and feet, and the indices of the remaining joints."""
    kept = [i for i, joint in enumerate(skeleton.joints) if not joint.endswith(_FINE)]
    parents = []
    for joint in kept:
        parent = skeleton.parents[joint]
        while parent >= 0 and parent not in kept:
            parent = skeleton.parents[parent]
        parents.append(kept.index(parent) if parent >= 0 else -1)
    return Skeleton(skeleton.name, tuple(skeleton.joints[i] for i in kept), tuple(parents)), kept


ROTATION, CENTRE = slice(0, 3), slice(3, 6)
FOCAL, K1, OFFSET, DRIFT = range(6, 10)
Q = 10
"""Number of parameters of a camera."""
PARTS = {"rotation": ROTATION, "centre": CENTRE, "focal": FOCAL, "k1": K1, "offset": OFFSET, "drift": DRIFT}
"""Parameters of a camera by name."""


@dataclass(frozen=True)
class Calibration:
    """Cameras and their clocks."""

    rig: CameraRig  # V cameras, m
    # (V,) s by which the images of a camera are later than its frame numbers say: frame (t + offset) fps of the camera
    # shows a body at time t
    offset: np.ndarray
    drift: np.ndarray  # (V,) growth of the offset, s/s from the start of the clip

    @classmethod
    def of(cls, rig: CameraRig) -> Calibration:
        """Return synchronised cameras."""
        return cls(rig, np.zeros(len(rig)), np.zeros(len(rig)))

    def changed(self, step: np.ndarray) -> Calibration:
        """Return the calibration changed by a step (V, Q).

        The first entries are a rotation vector in the axes of the world, rad, about the centre of the camera, a
        movement of the centre in the world, m, and a change of the logarithm of the focal length. Offset and drift are
        in s and s/s.
        """
        rig = self.rig
        if step[:, :OFFSET].any():
            turned = Rotation.from_rotvec(step[:, ROTATION]).as_matrix()
            pose, K, dist = rig.cam_from_world.copy(), rig.K.copy(), rig.dist.copy()
            pose[:, :3, :3] = R = pose[:, :3, :3] @ turned.swapaxes(-1, -2)
            pose[:, :3, 3] = -(R @ (rig.centers + step[:, CENTRE])[..., None])[..., 0]
            K[:, :2, :2] *= np.exp(step[:, FOCAL])[:, None, None]
            dist[:, 0] += step[:, K1]
            rig = replace(rig, K=K, dist=dist, cam_from_world=pose)
        return Calibration(rig, self.offset + step[:, OFFSET], self.drift + step[:, DRIFT])

    def with_step(self, view: int, step: np.ndarray) -> Calibration:
        """Return the calibration with one camera changed by a step (Q,)."""
        steps = np.zeros((len(self.rig), Q))
        steps[view] = step
        return self.changed(steps)

    def difference(self, other: Calibration) -> np.ndarray:
        """Return the step (V, Q) from this calibration to another one."""
        a, b = self.rig, other.rig
        step = np.zeros((len(a), Q))
        turned = b.cam_from_world[:, :3, :3].swapaxes(-1, -2) @ a.cam_from_world[:, :3, :3]
        step[:, ROTATION] = Rotation.from_matrix(turned).as_rotvec()
        step[:, CENTRE] = b.centers - a.centers
        step[:, FOCAL] = np.log(b.K[:, 0, 0] / a.K[:, 0, 0])
        step[:, K1] = b.dist[:, 0] - a.dist[:, 0]
        step[:, OFFSET], step[:, DRIFT] = other.offset - self.offset, other.drift - self.drift
        return step


@dataclass(frozen=True)
class Freedom:
    """The parameters that may change, and the expected size of their changes."""

    free: np.ndarray  # (V, Q) True for parameters that may change
    prior: np.ndarray  # (V, Q) standard deviation of their change, inf where nothing is known

    @classmethod
    def of(cls, views: int, only: list[int] | None = None, **wanted: bool) -> Freedom:
        """Return the freedom of the parameters, named as in `PARTS`, that are True, of all views or of some."""
        free = np.zeros((views, Q), bool)
        for name, each in wanted.items():
            part: Any = PARTS[name]
            free[slice(None) if only is None else only, part] = each
        return cls(free, np.full((views, Q), np.inf))


@dataclass(frozen=True)
class ImageTracks:
    """The image positions of tracked people."""

    skeleton: Skeleton  # J joints
    fps: float  # 1/s
    xy: np.ndarray  # (F, P, V, J, 2) px, distorted; NaN where absent
    sigma: np.ndarray  # (F, P, V, J) m, expected error of each position at the depth of the person; NaN where absent
    start: np.ndarray  # (F, P, J, 3) m, a first estimate of the joints; NaN where unknown


_LINE_FRAMES = 2  # Number of frames before and after a time to which a line is fitted
_MOST_SHARE = 0.04  # Largest movement of a joint from frame to frame, as a share of the image's diagonal


@dataclass(frozen=True)
class Observations:
    """Detections of M bodies."""

    tracks: ImageTracks  # The tracks that contain the bodies
    # frame, person: (M,) indices of each body
    frame: np.ndarray
    person: np.ndarray
    start: np.ndarray  # (M, J, 3) m, a first estimate of the joints; NaN where unknown

    @classmethod
    def of(cls, tracks: ImageTracks, most: int) -> Observations:
        """Return up to `most` bodies that two views or more see, evenly spread over all frames."""
        seen = np.isfinite(tracks.sigma).sum(-1) >= 4
        usable = (seen.sum(-1) >= 2) & np.isfinite(tracks.start[..., 0]).any(-1)
        frame, person = np.nonzero(usable)
        chosen = evenly_spaced(len(frame), most)
        frame, person = frame[chosen], person[chosen]
        return cls(tracks, frame, person, tracks.start[frame, person])

    def __len__(self) -> int:
        return len(self.frame)

    def at(self, bodies: np.ndarray) -> Observations:
        """Return some of the bodies."""
        return replace(self, frame=self.frame[bodies], person=self.person[bodies], start=self.start[bodies])

    def seen(self, calibration: Calibration) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return each body's detections given the cameras' clocks, (M, V, J, 2) px, and velocities, px/s, 0 if
        unknown.

        Also returns their expected error (M, V, J) m at the depth of the body, NaN where there is no detection.
        """
        tracks, rig = self.tracks, calibration.rig
        shift = calibration.offset * tracks.fps + calibration.drift * self.frame[:, None]
        most = _MOST_SHARE * np.linalg.norm(rig.size, axis=-1)
        around = 0 if are_stills(tracks.fps) else _LINE_FRAMES
        found = _lines(tracks.xy, tracks.sigma, self.frame, self.person, shift, most, around)
        return found[0], found[1] * tracks.fps, found[2]


@compiled()
def _lines(xy, sigma, frame, person, shift, most, around):
    """Return position (M, V, J, 2), px, velocity, px/frame, and sigma of a line fitted to the frames around each time.

    Its noise is the same between frames as on them. An interpolation has the least noise half way between two frames,
    so that any camera would seem to be half a frame late.

    Args:
        shift: (M, V) frames by which each camera is late.
        most: (V,) px, largest movement from frame to frame; a jump means another person or a gross error.
        around: Number of frames before and after that are used.
    """
    shape = (*shift.shape, xy.shape[3])
    place, velocity = np.full((*shape, 2), np.nan), np.zeros((*shape, 2))
    error = np.full(shape, np.nan)
    for m in range(shape[0]):
        for v in range(shape[1]):
            whole = int(np.rint(shift[m, v]))
            row = frame[m] + whole
            if row < 0 or row >= len(xy):
                continue
            error[m, v] = sigma[row, person[m], v]
            for j in range(shape[2]):
                for axis in range(2):
                    middle = xy[row, person[m], v, j, axis]
                    n = k1 = k2 = 0
                    x = kx = 0.0
                    for k in range(-around, around + 1):
                        if 0 <= row + k < len(xy):
                            off = xy[row + k, person[m], v, j, axis] - middle
                            if abs(off) < most[v] * (abs(k) + 1):
                                n, k1, k2, x, kx = n + 1, k1 + k, k2 + k * k, x + off, kx + k * off
                    spread = n * k2 - k1 * k1
                    slope = (n * kx - k1 * x) / spread if spread > 0 else 0.0
                    place[m, v, j, axis] = middle + (x - slope * k1) / max(n, 1) + slope * (shift[m, v] - whole)
                    velocity[m, v, j, axis] = slope
    return place, velocity, error


class _Cameras(NamedTuple):
    """What the kernels read of V cameras, or of one, whose entries lack the first axis."""

    K: np.ndarray  # (V, 3, 3)
    lens: np.ndarray  # (V, 8) distortion as in `CameraRig`, zeros at the end
    pose: np.ndarray  # (V, 4, 4) `cam_from_world`
    fisheye: np.ndarray  # (V,)
    reach: np.ndarray  # (V,) largest distance from the axis, at depth 1, that has a pixel
    centre: np.ndarray  # (V, 3) m

    @classmethod
    def of(cls, rig: CameraRig) -> _Cameras:
        lens = np.pad(rig.dist, ((0, 0), (0, 8 - rig.dist.shape[1])))
        return cls(
            rig.K.copy(), lens, rig.cam_from_world.copy(), rig.fisheye.copy(), rig.reach.copy(), rig.centers.copy()
        )


@compiled()
def _camera(cameras, v):
    """Return one of the cameras."""
    K, lens, pose, fisheye, reach, centre = cameras
    return _Cameras(K[v], lens[v], pose[v], fisheye[v], reach[v], centre[v])


@compiled()
def _project(camera, point, slope):
    """Return x and y, px, and depth, m, of a point, as `CameraRig.project` does: NaN for points that have no pixel.

    Args:
        camera: One of `_Cameras`.
        point: (3,) m.
        slope: (2, 4) becomes the derivatives of x and y by the point and by k1.
    """
    K, lens, pose, fisheye, reach, _ = camera
    depth = pose[2, 0] * point[0] + pose[2, 1] * point[1] + pose[2, 2] * point[2] + pose[2, 3]
    if not depth > 0:
        return np.nan, np.nan, depth
    x = (pose[0, 0] * point[0] + pose[0, 1] * point[1] + pose[0, 2] * point[2] + pose[0, 3]) / depth
    y = (pose[1, 0] * point[0] + pose[1, 1] * point[1] + pose[1, 2] * point[2] + pose[1, 3]) / depth
    square = x * x + y * y
    if not square < reach * reach:
        return np.nan, np.nan, depth
    # The lens multiplies x and y by a ratio, which changes with the square of the radius and with k1.
    k1, k2, p1, p2, k3, k4, k5, k6 = lens[0], lens[1], lens[2], lens[3], lens[4], lens[5], lens[6], lens[7]
    if not fisheye:
        below = 1 + square * (k4 + square * (k5 + square * k6))
        ratio = (1 + square * (k1 + square * (k2 + square * k3))) / below
        growth = k1 + square * (2 * k2 + square * 3 * k3) - ratio * (k4 + square * (2 * k5 + square * 3 * k6))
        growth, by_k1 = growth / below, square / below
    elif square < 1e-8:
        ratio, growth, by_k1, p1, p2 = 1.0, k1 - 1 / 3, square, 0.0, 0.0
    else:
        radius = np.sqrt(square)
        angle = np.arctan(radius)
        t = angle * angle
        ratio = angle * (1 + t * (k1 + t * (k2 + t * (p1 + t * p2)))) / radius
        growth = (1 + t * (3 * k1 + t * (5 * k2 + t * (7 * p1 + t * 9 * p2)))) / (1 + square)
        growth, by_k1, p1, p2 = (growth - ratio) / (2 * square), angle * t / radius, 0.0, 0.0
    across = 2 * (x * y * growth + p1 * x + p2 * y)
    xx, yy = ratio + 2 * x * x * growth + 2 * p1 * y + 6 * p2 * x, ratio + 2 * y * y * growth + 6 * p1 * y + 2 * p2 * x
    u = x * ratio + 2 * p1 * x * y + p2 * (square + 2 * x * x)
    w = y * ratio + 2 * p2 * x * y + p1 * (square + 2 * y * y)
    for axis in range(2):
        by_x, by_y = K[axis, 0] * xx + K[axis, 1] * across, K[axis, 0] * across + K[axis, 1] * yy
        for k in range(3):
            slope[axis, k] = (by_x * (pose[0, k] - x * pose[2, k]) + by_y * (pose[1, k] - y * pose[2, k])) / depth
        slope[axis, 3] = (K[axis, 0] * x + K[axis, 1] * y) * by_k1
    return K[0, 0] * u + K[0, 1] * w + K[0, 2], K[1, 0] * u + K[1, 1] * w + K[1, 2], depth


ROBUST = 2.0
"""Sigmas at which the weight of a residual is a half (Cauchy)."""
_BONE_SIGMA = 0.08  # Standard deviation of the measured length of a bone between frames, as a share of its length
OFFSET_M, _ALIKE_S = 0.02, 1.0
"""m at the depth of the person, standard deviation of constant offsets; s, duration of the other errors."""
_MIN_DEPTH, _MIN_SIGMA_PX = 0.1, 1.0
_LOST = 25.0  # Cost of a detection of a joint without a pixel: of an outlier


class AdjustmentProblem:
    """The constants of an adjustment.

    Attributes:
        observations, origin: The detections, and the cameras at the start.
        offsets: Whether constant offsets of a person's joints in each view are unknowns.
        people, person: Numbers of the people, and (M,) index into them of each body.
        offset_weight: 1/m^2, weight of the square of an offset.
        free: Indices of the free parameters in (V, Q), flattened.
        prior: (V, Q) weights of the squares of changes from `origin`; 0 for none.
        bones: (B, 2) joints of bones of constant length.
        fixed_seen: `observations.seen` if no clock changes, else None.
        depth: (M, V, J) m, of the joints at the start.
    """

    def __init__(
        self, observations: Observations, origin: Calibration, xyz: np.ndarray, freedom: Freedom, bones: bool,
        offsets: bool,
    ):  # fmt: skip
        self.observations, self.origin, self.offsets = observations, origin, offsets
        self.people, self.person = np.unique(observations.person, return_inverse=True)
        # An error that lasts for several frames counts once, for any number of these frames.
        fps = observations.tracks.fps
        seconds = np.ptp(observations.frame) / fps + 1 / fps if len(observations) else 1.0
        bodies_a_second = len(observations) / max(len(self.people), 1) / seconds
        self.offset_weight = bodies_a_second * _ALIKE_S / OFFSET_M**2
        self.free = np.flatnonzero(freedom.free)
        self.bones = np.array(observations.tracks.skeleton.bones).reshape(-1, 2) if bones else np.empty((0, 2), int)
        self.fixed_seen = None if freedom.free[:, [OFFSET, DRIFT]].any() else observations.seen(origin)
        self.prior = np.where(freedom.free, 1 / freedom.prior**2, 0)
        # The depth at the start is used: if errors grew with nearness, a smaller world would fit better.
        pose = origin.rig.cam_from_world
        self.depth = np.ascontiguousarray((xyz @ pose[:, 2, :3].T + pose[:, 2, 3]).swapaxes(1, 2))
        near = self.depth <= _MIN_DEPTH
        for view in np.flatnonzero(near.any((0, 2))):
            depth = self.depth[:, view]
            usual = depth[depth > _MIN_DEPTH]
            depth[near[:, view]] = np.median(usual) if len(usual) else 1.0


class Adjusted:
    """Cameras and bodies, the outcome of an adjustment or of one of its steps.

    Attributes:
        calibration: The cameras.
        cost: (M,) robust cost of each body.
    """

    def __init__(
        self, problem: AdjustmentProblem, calibration: Calibration, xyz: np.ndarray, offset: np.ndarray | None = None
    ):
        """
        Args:
            offset: (people, V, J, 2) m at the depth of the person; None for zeros.
        """
        self.problem, self.calibration, self.points = problem, calibration, xyz
        shape = (len(problem.people) * problem.offsets, len(calibration.rig), xyz.shape[1], 2)
        self.offset = np.zeros(shape) if offset is None else offset
        xy, self.velocity, sigma = problem.fixed_seen or problem.observations.seen(calibration)
        self.cameras = _Cameras.of(calibration.rig)
        self.unit = calibration.rig.focal[:, None] / problem.depth
        self.residual, self.scale, self.error2, self.cost = _measure(
            self.cameras, xyz, xy, sigma, self.unit, self.offset, problem.person
        )
        self.known = self.scale > 0
        self.weight = self.scale**2 / (1 + self.error2 / ROBUST**2)
        self.bone_cost = self._bones()
        self.step = problem.origin.difference(calibration) if problem.prior.any() else np.zeros(problem.prior.shape)
        rest = self.bone_cost + (problem.prior * self.step**2).sum() + problem.offset_weight * (self.offset**2).sum()
        self.total = float(self.cost.sum() + rest)

    @property
    def xyz(self) -> np.ndarray:
        """(M, J, 3) m, the bodies; NaN where fewer than two views see a joint."""
        return np.where(self.known.any(1)[..., None], self.points, np.nan)

    @property
    def error_px(self) -> np.ndarray:
        """(M, V, J) distance between detection and reprojection, px; NaN where there is no detection."""
        return np.where(self.known, np.linalg.norm(self.residual, axis=-1), np.nan)

    @cached_property
    def reduced(self) -> Reduced:
        """The normal equations of the cameras."""
        return _reduced(self, 0.0)

    def _bones(self) -> float:
        bones = self.problem.bones
        if not len(bones):
            return 0.0
        vector = self.points[:, bones[:, 1]] - self.points[:, bones[:, 0]]
        length = np.linalg.norm(vector, axis=-1)
        # Two views must measure both ends.
        measured = self.known.any(1)
        ok = measured[:, bones[:, 0]] & measured[:, bones[:, 1]] & np.isfinite(length)
        usual = np.full(length.shape, np.nan)
        for person in range(len(self.problem.people)):
            rows = self.problem.person == person
            values = np.where(ok[rows], length[rows], np.nan)
            usual[rows] = np.where(ok[rows].sum(0) >= 3, median_over_frames(values), np.nan)
        # The error is relative to the length, so that a smaller world does not fit better.
        sigma = _BONE_SIGMA * np.maximum(np.nan_to_num(usual, nan=1.0), 1e-6)
        off = np.where(ok & np.isfinite(usual), length - usual, 0) / sigma
        self.bone_off, self.bone_weight = off, np.where(ok & np.isfinite(usual), 1 / (1 + off**2 / ROBUST**2), 0)
        self.bone_unit = np.nan_to_num(vector / np.maximum(length, 1e-6)[..., None]) / sigma[..., None]
        return float((ROBUST**2 * np.log1p(off**2 / ROBUST**2)).sum())


@compiled()
def _measure(cameras, xyz, xy, sigma, unit, offset, person):
    """Return residuals (M, V, J, 2), px, and 1/sigma, 1/px, both 0 where unknown; squared errors in sigmas; costs (M,).

    `unit` (M, V, J) is px/m; `offset` (people, V, J, 2), m, may be empty.
    """
    M, V, J = sigma.shape
    residual, scale, error2 = np.zeros((M, V, J, 2)), np.zeros((M, V, J)), np.zeros((M, V, J))
    cost, slope, detected, known = np.zeros(M), np.empty((2, 4)), np.zeros((M, J)), np.zeros((M, J))
    for v in range(V):
        camera = _camera(cameras, v)
        for m in range(M):
            for j in range(J):
                if np.isnan(sigma[m, v, j]):
                    continue
                detected[m, j] += 1
                x, y, depth = _project(camera, xyz[m, j], slope)
                x, y = x - xy[m, v, j, 0], y - xy[m, v, j, 1]
                if len(offset):
                    x += offset[person[m], v, j, 0] * unit[m, v, j]
                    y += offset[person[m], v, j, 1] * unit[m, v, j]
                if depth > _MIN_DEPTH and not np.isnan(x + y):
                    known[m, j] += 1
                    residual[m, v, j, 0], residual[m, v, j, 1] = x, y
                    scale[m, v, j] = 1 / max(sigma[m, v, j] * unit[m, v, j], _MIN_SIGMA_PX)
                    error2[m, v, j] = (x * x + y * y) * scale[m, v, j] ** 2
    for m in range(M):
        for j in range(J):
            # One view alone says nothing about cameras.
            if known[m, j] == 1:
                known[m, j], residual[m, :, j], scale[m, :, j], error2[m, :, j] = 0, 0, 0, 0
            # Joints that are behind a camera that detected them, or at unknown places, cost as much as an outlier.
            if detected[m, j] >= 2:
                cost[m] += _LOST * (detected[m, j] - known[m, j])
        for v in range(V):
            for j in range(J):
                if error2[m, v, j] > 0:
                    cost[m] += ROBUST**2 * np.log1p(error2[m, v, j] / ROBUST**2)
    return residual, scale, error2, cost


class _Fit(NamedTuple):
    """How the detections of M bodies fit, in V views and J joints; what `_differentiate` reads of it."""

    xyz: np.ndarray  # (M, J, 3) m, the bodies
    weight: np.ndarray  # (M, V, J) 1/px^2; 0 where unknown
    residual: np.ndarray  # (M, V, J, 2) px
    velocity: np.ndarray  # (M, V, J, 2) px/s, of the detections
    unit: np.ndarray  # (M, V, J) px/m
    seconds: np.ndarray  # (M,) s, times of the bodies


class _Columns(NamedTuple):
    """Which unknown has which of the C columns of the normal equations: parameters of cameras, then offsets."""

    cameras: np.ndarray  # (V, Q) column of each parameter of a camera; -1 if it does not change
    free: int  # Number of these columns
    offsets: bool  # Whether offsets of one person, (V, J, 2), have columns


@compiled()
def _by_camera(camera, columns, point, pixel, slope, velocity, seconds, by, index):
    """Write the derivatives of a residual by the free parameters of its camera into `by`, their columns into `index`.

    Args:
        camera: One of `_Cameras`.
        columns: (Q,) of the camera, see `_Columns`.
        point, pixel: (3,) m, the joint, and (2,) px, where the camera sees it.
        slope: (2, 4) of `_project`.
        velocity: (2,) px/s, of the detection.
        seconds: Time of the body, s.
        by, index: (Q, 2) or longer.

    Returns:
        The number of derivatives.
    """
    count = 0
    for q in range(Q):
        if columns[q] < 0:
            continue
        for axis in range(2):
            if q < 3:
                # A rotation by w about the centre C moves X, relative to the camera, by (X - C) x w.
                a, b = (q + 1) % 3, (q + 2) % 3
                off_a, off_b = point[a] - camera.centre[a], point[b] - camera.centre[b]
                by[count, axis] = off_b * slope[axis, a] - off_a * slope[axis, b]
            elif q < FOCAL:
                by[count, axis] = -slope[axis, q - 3]
            elif q == FOCAL:
                by[count, axis] = pixel[axis] - camera.K[axis, 2]
            elif q == K1:
                by[count, axis] = slope[axis, 3]
            else:
                by[count, axis] = -velocity[axis] * (seconds if q == DRIFT else 1.0)
        index[count] = columns[q]
        count += 1
    return count


@compiled()
def _differentiate(cameras, columns, fit, rows):
    """Return the normal equations of bodies `rows` (m,) of a fit: cameras and perhaps offsets in C columns.

    Returns:
        information, scores: (C, C), and (m, C) gradient of each body.
        mixed: (m, J, 3, C + 1) of joints and columns; the last column is the gradient of the joints.
        blocks: (m, J, 3, 3) of joints.
    """
    _, V, J = fit.weight.shape
    C = columns.free + 2 * V * J * columns.offsets
    information, scores = np.zeros((C, C)), np.zeros((len(rows), C))
    mixed, blocks = np.zeros((len(rows), J, 3, C + 1)), np.zeros((len(rows), J, 3, 3))
    slope, by, index = np.empty((2, 4)), np.zeros((Q + 2, 2)), np.empty(Q + 2, np.int64)
    for v in range(V):
        camera = _camera(cameras, v)
        for i, m in enumerate(rows):
            for j in range(J):
                heavy = fit.weight[m, v, j]
                if heavy == 0:
                    continue
                point, off, velocity = fit.xyz[m, j], fit.residual[m, v, j], fit.velocity[m, v, j]
                x, y, _ = _project(camera, point, slope)
                count = _by_camera(
                    camera, columns.cameras[v], point, (x, y), slope, velocity, fit.seconds[m], by, index
                )
                for axis in range(2 * columns.offsets):
                    by[count, axis], by[count, 1 - axis] = fit.unit[m, v, j], 0.0
                    index[count] = columns.free + 2 * (v * J + j) + axis
                    count += 1
                for k in range(3):
                    s0, s1 = heavy * slope[0, k], heavy * slope[1, k]
                    mixed[i, j, k, C] += s0 * off[0] + s1 * off[1]
                    for a in range(3):
                        blocks[i, j, k, a] += s0 * slope[0, a] + s1 * slope[1, a]
                    for a in range(count):
                        mixed[i, j, k, index[a]] += s0 * by[a, 0] + s1 * by[a, 1]
                for a in range(count):
                    b0, b1 = heavy * by[a, 0], heavy * by[a, 1]
                    scores[i, index[a]] += b0 * off[0] + b1 * off[1]
                    for b in range(count):
                        information[index[a], index[b]] += b0 * by[b, 0] + b1 * by[b, 1]
    return information, scores, mixed, blocks


# The adjustment


def adjust(
    observations: Observations,
    calibration: Calibration,
    freedom: Freedom | None = None,
    *,
    move_people: bool = True,
    iterations: int = 20,
    bones: bool = False,
    offsets: bool = False,
    xyz: np.ndarray | None = None,
    tolerance: float = 1e-5,
) -> Adjusted:
    """Return the cameras and bodies with the least robust cost, from cameras and perhaps bodies `xyz` (M, J, 3) m.

    Args:
        freedom: The parameters that may change; by default only the bodies change.
        iterations: Largest number of steps.
        bones: Whether the bones of a person have a constant length.
        offsets: Whether to estimate a constant offset of each joint of a person in each view.
        tolerance: Relative decrease of the cost below which the search ends.
    """
    freedom = freedom or Freedom.of(len(calibration.rig))
    damping = 1e-3
    xyz = observations.start if xyz is None else xyz
    problem = AdjustmentProblem(observations, calibration, xyz, freedom, bones, offsets)
    state = Adjusted(problem, calibration, xyz)
    for _ in range(iterations):
        moved = False
        for _ in range(6):
            step, move, offset = solve(state, damping, move_people)
            cameras = state.calibration.changed(step) if len(problem.free) else state.calibration
            tried = Adjusted(problem, cameras, state.points + move, state.offset + offset)
            if tried.total <= state.total:
                moved = state.total - tried.total > tolerance * max(state.total, 1e-9)
                state, damping = tried, max(damping / 5, 1e-9)
                break
            damping = max(damping * 8, 1e-6)
        if not moved:
            break
    return state


_BODY_DAMPING = 1e-3
"""1/m^2, relative to the information of a joint: it regularises a joint that only one view sees along its ray."""


class Reduced(NamedTuple):
    """Normal equations of the cameras, with bodies and offsets eliminated."""

    # information, gradient: (P, P), (P,)
    information: np.ndarray
    gradient: np.ndarray
    scores: np.ndarray  # (M, P) contribution of each body to the gradient
    offset_spread: np.ndarray  # (P, P) covariance of the gradient due to offsets with the spread of their prior
    # For each person with offsets, their dependence on the cameras, and their step if these stay
    eliminated: list[tuple[np.ndarray, np.ndarray]]
    # For some bodies, factors (n, k, k) of their equations, and these solved by half for columns and gradient (n, k, C)
    bodies: list[tuple[np.ndarray, np.ndarray, np.ndarray]]


def _reduced(state: Adjusted, damping: float, move_people: bool = True) -> Reduced:
    """Return the equations of the cameras; fixed bodies and offsets stay in."""
    problem, M = state.problem, len(state.points)
    P, weight = len(problem.free), problem.offset_weight
    columns = _Columns(np.full(problem.prior.shape, -1), P, problem.offsets)
    columns.cameras.flat[problem.free] = np.arange(P)
    seconds = problem.observations.frame / problem.observations.tracks.fps
    fit = _Fit(state.points, state.weight, state.residual, state.velocity, state.unit, seconds)
    prior = problem.prior.flat[problem.free]
    information, scores, spread = np.diag(prior), np.zeros((M, P)), np.zeros((P, P))
    gradient, eliminated, bodies = prior * state.step.flat[problem.free], [], []
    people = range(len(problem.people)) if problem.offsets else [None]
    for person in people:
        rows = np.flatnonzero(problem.person == person) if problem.offsets else np.arange(M)
        A, own, mixed, blocks = _differentiate(state.cameras, columns, fit, rows)
        if move_people:
            blocks = _body_equations(state, rows, blocks, mixed[..., -1], damping)
            half = mixed.reshape(-1, blocks.shape[-1], mixed.shape[-1])
            _eliminate(blocks, half)
            bodies.append((rows, blocks, half))
            flat = half.reshape(-1, half.shape[-1])
            A -= (flat.T @ flat)[:-1, :-1]
            flat = half.reshape(len(rows), -1, half.shape[-1])
            own -= (flat[:, None, :, -1] @ flat[..., :-1])[:, 0]
        information += A[:P, :P]
        scores[rows] = own[:, :P]
        if problem.offsets:
            inverse = np.linalg.inv(A[P:, P:] + weight * np.eye(len(A) - P))
            offset, K = state.offset[person].reshape(-1), A[:P, P:] @ inverse
            information -= K @ A[P:, :P]
            scores[rows] -= own[:, P:] @ K.T
            gradient -= weight * K @ offset
            spread += (weight * OFFSET_M) ** 2 * K @ K.T
            eliminated.append((K, inverse @ (own[:, P:].sum(0) + weight * offset)))
    return Reduced(information, gradient + scores.sum(0), scores, spread, eliminated, bodies)


def _body_equations(
    state: Adjusted, rows: np.ndarray, blocks: np.ndarray, gradient: np.ndarray, damping: float
) -> np.ndarray:
    """Return damped equations of bodies (m,): (m J, 3, 3), or with bones (m, 3 J, 3 J). Bones change the gradient."""
    m, J = blocks.shape[:2]
    trace = np.trace(blocks, axis1=-2, axis2=-1)[..., None, None]
    blocks = blocks + ((damping * _BODY_DAMPING + 1e-9) * (trace + 1) + damping * 1e-3 * trace) * np.eye(3)
    blocks[trace[..., 0, 0] <= 0] = np.eye(3)
    bones = state.problem.bones
    if not len(bones):
        return blocks.reshape(-1, 3, 3)
    A = np.zeros((m, J, 3, J, 3))
    joint = np.arange(J)
    A[:, joint, :, joint] = blocks.swapaxes(0, 1)
    heavy, unit, off = state.bone_weight[rows], state.bone_unit[rows], state.bone_off[rows]
    outer = np.einsum("mb,mbi,mbk->mbik", heavy, unit, unit)
    push = (heavy * off)[..., None] * unit
    for index, (a, b) in enumerate(bones):
        part = outer[:, index]
        A[:, a, :, a] += part
        A[:, b, :, b] += part
        A[:, a, :, b] -= part
        A[:, b, :, a] -= part
        gradient[:, b] += push[:, index]
        gradient[:, a] -= push[:, index]
    return A.reshape(m, 3 * J, 3 * J) + 1e-6 * np.eye(3 * J)


@compiled()
def _eliminate(blocks, right):
    """Replace positive definite matrices (n, k, k) by their lower factors L, and right sides b (n, k, c) by L^-1 b."""
    for i in range(len(blocks)):
        A, b = blocks[i], right[i]
        for row in range(A.shape[0]):
            for column in range(row + 1):
                total = A[row, column]
                for k in range(column):
                    total -= A[row, k] * A[column, k]
                A[row, column] = total / A[column, column] if column < row else np.sqrt(total)
            for k in range(row):
                for c in range(b.shape[1]):
                    b[row, c] -= A[row, k] * b[k, c]
            for c in range(b.shape[1]):
                b[row, c] /= A[row, row]


@compiled()
def _solved(blocks, half):
    """Return the solutions (n, k) of equations that `_eliminate` left, with right sides `half` (n, k)."""
    found = half.copy()
    for i in range(len(blocks)):
        for row in range(half.shape[1] - 1, -1, -1):
            for k in range(row + 1, half.shape[1]):
                found[i, row] -= blocks[i, k, row] * found[i, k]
            found[i, row] /= blocks[i, row, row]
    return found


_LARGEST = 1.0
"""Largest step of a focal length's logarithm, and of distortion, which little evidence determines badly."""


def solve(state: Adjusted, damping: float, move_people: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return a step of the cameras (V, Q), of the bodies (M, J, 3) and of the offsets."""
    free, found = state.problem.free, _reduced(state, damping, move_people)
    step, move, offset = np.zeros(state.step.shape), np.zeros_like(state.points), np.zeros_like(state.offset)
    if len(free):
        # The equations are scaled by the diagonal, as parameters have different units.
        scale = 1 / np.sqrt(np.maximum(np.diag(found.information), 1e-9))
        scaled = found.information * scale * scale[:, None] + (damping + 1e-10) * np.eye(len(free))
        step.flat[free] = -scale * np.linalg.lstsq(scaled, scale * found.gradient, rcond=1e-12)[0]
    for person, (K, own) in enumerate(found.eliminated):
        offset[person] = -(own + K.T @ step.flat[free]).reshape(offset.shape[1:])
    step[:, [FOCAL, K1]] = np.clip(step[:, [FOCAL, K1]], -_LARGEST, _LARGEST)
    for person, (rows, blocks, half) in enumerate(found.bodies):
        columns = np.concatenate([step.flat[free], offset[person].reshape(-1) if len(offset) else [], [1.0]])
        move[rows] = -_solved(blocks, half @ columns).reshape(len(rows), -1, 3)
    length = np.linalg.norm(move, axis=-1, keepdims=True)
    return step, move * np.minimum(1, 0.5 / np.maximum(length, 1e-9)), offset


_INDEPENDENT_S = 3.0
"""s; errors of detections at this distance in time are assumed to be independent, except for constant offsets."""


def covariance_of_cameras(observations: Observations, adjusted: Adjusted, freedom: Freedom) -> np.ndarray:
    """Return the covariance (V, Q, Q) of each camera: H^-1 G H^-1, with the curvature H of the robust cost.

    G is the covariance of the gradient: the scatter of the contributions of bodies, times the number of bodies with the
    same error, plus the contribution of constant offsets of joints.
    """
    views, free = len(adjusted.calibration.rig), np.flatnonzero(freedom.free)
    covariance = np.zeros((views * Q, views * Q))
    if len(free):
        found = adjusted.reduced
        scores = found.scores
        scatter = scores.T @ scores
        values, vectors = np.linalg.eigh(scatter)
        root = vectors * np.sqrt(np.maximum(values, 0)) @ vectors.T
        G = _bodies_per_error(observations, scores @ np.linalg.pinv(root)) * scatter + found.offset_spread
        # The mean second derivative of the robust cost over the mean weight: w^2 for a Cauchy weight w.
        weight, robust = adjusted.weight, 1 / (1 + adjusted.error2 / ROBUST**2)
        H = np.linalg.pinv(found.information * ((weight * robust).sum() / max(weight.sum(), 1e-300)))
        covariance[np.ix_(free, free)] = H @ G @ H
    blocks = covariance.reshape(views, Q, views, Q)
    return blocks[np.arange(views), :, np.arange(views)]


def _bodies_per_error(observations: Observations, scores: np.ndarray) -> float:
    """Return the number of bodies of a person that have the same error, from decorrelated gradients (M, P) of M bodies.

    It is the energy of the sums over stretches of time, relative to the sum of energies.
    """
    seconds = (observations.frame - observations.frame.min()) / observations.tracks.fps
    duration = float(seconds.max()) + 1 / observations.tracks.fps
    count = max(int(duration / _INDEPENDENT_S), 4)
    stretch = np.minimum((seconds / duration * count).astype(int), count - 1)
    group = np.unique(observations.person * count + stretch, return_inverse=True)[1]
    sums = np.zeros((group.max() + 1, scores.shape[1]))
    np.add.at(sums, group, scores)
    # At the minimum all contributions add up to zero, so that one stretch fewer is independent.
    return max(float((sums**2).sum() / (scores**2).sum()) * len(sums) / max(len(sums) - 1, 1), 1.0)
