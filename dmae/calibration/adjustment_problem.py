"""The problem of bundle adjustment: cameras, the parameters of them that may change, detected bodies, and the cost.

A detector displaces some joints of a person in a view by nearly constant offsets. They are 23 % of the energy of
OpenPose's errors on Shelf, with each view left out in turn. Longer recordings do not average them out. These offsets
can therefore be unknowns too, with a prior.

F frames, P people; M bodies, each a person at one time; V views, J joints, A views with offsets; Q parameters per view:
rotation (3), centre (3), focal length, k1, k2, time offset, drift.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from dmae.data.cameras import CameraRig
from dmae.data.skeleton import Skeleton
from dmae.numerics.filling import are_stills

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
FOCAL, K1, K2, OFFSET, DRIFT = range(6, 11)
Q = 11
"""Number of parameters of a camera."""
PARTS = {
    "rotation": ROTATION, "centre": CENTRE, "focal": FOCAL, "k1": K1, "k2": K2, "offset": OFFSET, "drift": DRIFT,
}  # fmt: skip
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

    def __getitem__(self, views: list[int]) -> Calibration:
        return Calibration(self.rig[views], self.offset[views], self.drift[views])

    def changed(self, step: np.ndarray) -> Calibration:
        """Return the calibration changed by a step (V, Q).

        The first entries are a rotation vector in the axes of the world, rad, about the centre of the camera, a
        movement of the centre in the world, m, and a change of the logarithm of the focal length. Offset and drift are
        in s and s/s.
        """
        rig = self.rig
        turned = Rotation.from_rotvec(step[:, ROTATION]).as_matrix()
        R = rig.cam_from_world[:, :3, :3] @ turned.swapaxes(-1, -2)
        pose = rig.cam_from_world.copy()
        pose[:, :3, :3] = R
        pose[:, :3, 3] = -(R @ (rig.centers + step[:, CENTRE])[..., None])[..., 0]
        K, dist = rig.K.copy(), rig.dist.copy()
        K[:, :2, :2] *= np.exp(step[:, FOCAL])[:, None, None]
        dist[:, 0] += step[:, K1]
        dist[:, 1] += step[:, K2]
        changed = replace(rig, K=K, dist=dist, cam_from_world=pose)
        return Calibration(changed, self.offset + step[:, OFFSET], self.drift + step[:, DRIFT])

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
        step[:, [K1, K2]] = b.dist[:, :2] - a.dist[:, :2]
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
            free[slice(None) if only is None else only, PARTS[name]] = each
        return cls(free, np.full((views, Q), np.inf))


@dataclass(frozen=True)
class ImageTracks:
    """The image positions of tracked people."""

    skeleton: Skeleton  # J joints
    fps: float  # 1/s
    xy: np.ndarray  # (F, P, V, J, 2) px, distorted; NaN where absent
    sigma: np.ndarray  # (F, P, V, J) m, expected error of each position at the depth of the person; NaN where absent
    start: np.ndarray  # (F, P, J, 3) m, a first estimate of the joints; NaN where unknown
    aligned: Calibration  # V cameras, each aligned separately with these people

    def select(self, views: list[int]) -> ImageTracks:
        """Return the tracks in some views."""
        return replace(self, xy=self.xy[:, :, views], sigma=self.sigma[:, :, views], aligned=self.aligned[views])


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
    def of(cls, tracks: ImageTracks, calibration: Calibration, most: int, frames: np.ndarray | None = None):
        """Return up to `most` bodies, in the most views, evenly spread over all frames or the given ones."""
        seen = np.isfinite(tracks.sigma).sum(-1) >= 4
        usable = (seen.sum(-1) >= 2) & np.isfinite(tracks.start[..., 0]).any(-1)
        if frames is not None:
            usable &= np.isin(np.arange(len(usable)), frames)[:, None]
        frame, person = np.nonzero(usable)
        chosen = np.unique(np.linspace(0, len(frame) - 1, min(most, len(frame))).astype(int)) if len(frame) else []
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
        tracks, fps = self.tracks, self.tracks.fps
        view = np.arange(len(calibration.rig))
        shift = (calibration.offset + calibration.drift * self.frame[:, None] / fps) * fps
        whole = np.rint(shift).astype(int)
        place, velocity = self._line(whole, view, np.linalg.norm(calibration.rig.size, axis=-1)[:, None, None])
        xy = place + velocity * (shift - whole)[..., None, None]
        sigma = self._sample(tracks.sigma, whole, view)
        velocity = np.nan_to_num(velocity) * fps
        return xy, velocity, sigma

    def _line(self, shift: np.ndarray, view: np.ndarray, diagonal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return position (M, V, J, 2), px, and velocity, px/frame, of a line fitted to the frames around each time.

        Its noise is the same between frames as on them. An interpolation has the least noise half way between two
        frames, so that any camera would seem to be half a frame late.
        """
        middle = self._sample(self.tracks.xy, shift, view)
        if are_stills(self.tracks.fps):
            return middle, np.zeros_like(middle)
        n = k1 = k2 = x = kx = 0
        for k in range(-_LINE_FRAMES, _LINE_FRAMES + 1):
            off = self._sample(self.tracks.xy, shift + k, view) - middle
            # A jump means another person or a gross error.
            known = np.abs(off) < _MOST_SHARE * diagonal * (abs(k) + 1)
            off = np.where(known, off, 0)
            n, k1, k2, x, kx = n + known, k1 + k * known, k2 + k * k * known, x + off, kx + k * off
        spread = n * k2 - k1 * k1
        velocity = np.where(spread > 0, (n * kx - k1 * x) / np.maximum(spread, 1), 0)
        return middle + (x - velocity * k1) / np.maximum(n, 1), velocity

    def _sample(self, array: np.ndarray, shift: np.ndarray, view: np.ndarray) -> np.ndarray:
        """Return (M, V, ...) of an array (F, P, V, ...), shifted by frames (M, V); NaN outside of the clip."""
        row = self.frame[:, None] + shift
        inside = (row >= 0) & (row < len(array))
        found = array[np.where(inside, row, 0), self.person[:, None], view]
        return np.where(inside.reshape(*inside.shape, *(1,) * (found.ndim - 2)), found, np.nan)


ROBUST = 2.0
"""Sigmas at which the weight of a residual is a half (Cauchy)."""


_BONE_SIGMA = 0.08  # Standard deviation of the measured length of a bone between frames, as a share of its length


OFFSET_M, _ALIKE_S = 0.02, 1.0
"""m at the depth of the person, standard deviation of constant offsets; s, duration of the other errors."""


_MIN_DEPTH = 0.1


_MIN_SIGMA_PX = 1.0


class AdjustmentProblem:
    """The constants of an adjustment."""

    def __init__(
        self, observations: Observations, origin: Calibration, freedom: Freedom, bones: bool, offsets: bool = False
    ):
        self.observations, self.origin, self.freedom = observations, origin, freedom
        self.offset_views = np.arange(len(freedom.free)) if offsets else np.empty(0, int)
        self.people, self.person = np.unique(observations.person, return_inverse=True)
        # An error that lasts for several frames counts once, for any number of these frames.
        fps = observations.tracks.fps
        seconds = np.ptp(observations.frame) / fps + 1 / fps if len(observations) else 1.0
        bodies_a_second = len(observations) / max(len(self.people), 1) / seconds
        self.offset_weight = bodies_a_second * _ALIKE_S / OFFSET_M**2
        self.free = np.flatnonzero(freedom.free)
        self.bones = np.array(observations.tracks.skeleton.bones).reshape(-1, 2) if bones else np.empty((0, 2), int)
        self.timed = freedom.free[:, [OFFSET, DRIFT]].any()
        self.fixed_seen = None if self.timed else observations.seen(origin)
        self.depth: np.ndarray | None = None


class AdjustmentState:
    """Cost and normal equations at one set of cameras and bodies."""

    def __init__(
        self, problem: AdjustmentProblem, calibration: Calibration, xyz: np.ndarray, offset: np.ndarray | None = None
    ):
        """
        Args:
            offset: (people, A, J, 2) m at the depth of the person; None for zeros.
        """
        self.problem, self.calibration, self.xyz = problem, calibration, xyz
        shape = (len(problem.people), len(problem.offset_views), xyz.shape[1], 2)
        self.offset = np.zeros(shape) if offset is None else offset
        rig = calibration.rig
        xy, self.velocity, sigma = problem.fixed_seen or problem.observations.seen(calibration)
        pixels, depth = rig.project(xyz)
        self.pixels, depth = pixels, np.where(depth > _MIN_DEPTH, depth, np.nan)
        focal = rig.focal[:, None]
        self.residual = pixels - xy
        if problem.depth is None:
            known = np.where(np.isnan(depth).all((0, 2))[:, None], 1.0, depth)
            usual = np.nanmedian(known, (0, 2)) if known.size else np.ones(depth.shape[1])
            problem.depth = np.where(np.isnan(depth), usual[:, None], depth)
        self.unit = (focal / problem.depth)[:, problem.offset_views]
        self.residual[:, problem.offset_views] += self.offset[problem.person] * self.unit[..., None]
        # The depth at the start is used: if errors grew with nearness, a smaller world would fit better.
        scale = 1 / np.maximum(sigma * focal / problem.depth, _MIN_SIGMA_PX)
        known = np.isfinite(self.residual).all(-1) & np.isfinite(scale) & np.isfinite(depth)
        # One view alone says nothing about cameras.
        known &= known.sum(1, keepdims=True) >= 2
        self.known, self.scale = known, np.where(known, scale, 0)
        self.residual = np.where(known[..., None], self.residual, 0)
        self.error2 = (self.residual**2).sum(-1) * self.scale**2
        self.robust = 1 / (1 + self.error2 / ROBUST**2)
        cost = ROBUST**2 * np.log1p(self.error2 / ROBUST**2)
        self.cost = np.where(known, cost, 0).sum((1, 2))
        # Joints that are behind a camera that detected them, and joints at unknown places, cost as much as an outlier.
        lost = np.isfinite(sigma) & ~known & (np.isfinite(sigma).sum(1, keepdims=True) >= 2)
        self.cost = self.cost + 25.0 * lost.sum((1, 2))
        self.bone_cost = self._bones()
        self.step = problem.origin.difference(calibration)
        self.prior_weight = 1 / problem.freedom.prior**2
        prior_cost = float(((self.step / problem.freedom.prior) ** 2).sum())
        offset_cost = problem.offset_weight * (self.offset**2).sum()
        self.total = float(self.cost.sum() + self.bone_cost + prior_cost + offset_cost)

    def _bones(self) -> float:
        bones, person = self.problem.bones, self.problem.observations.person
        if not len(bones):
            return 0.0
        vector = self.xyz[:, bones[:, 1]] - self.xyz[:, bones[:, 0]]
        length = np.linalg.norm(vector, axis=-1)
        # Two views must measure both ends.
        measured = self.known.any(1)
        ok = measured[:, bones[:, 0]] & measured[:, bones[:, 1]] & np.isfinite(length)
        usual = np.full(length.shape, np.nan)
        for each in np.unique(person):
            rows = person == each
            values = np.where(ok[rows], length[rows], np.nan)
            enough = np.isfinite(values).sum(0) >= 3
            if enough.any():
                usual[np.ix_(rows, enough)] = np.nanmedian(values[:, enough], 0)
        # The error is relative to the length, so that a smaller world does not fit better.
        sigma = _BONE_SIGMA * np.maximum(np.nan_to_num(usual, nan=1.0), 1e-6)
        off = np.where(ok & np.isfinite(usual), length - usual, 0) / sigma
        self.bone_off, self.bone_weight = off, np.where(ok & np.isfinite(usual), 1 / (1 + off**2 / ROBUST**2), 0)
        self.bone_unit = np.nan_to_num(vector / np.maximum(length, 1e-6)[..., None]) / sigma[..., None]
        return float((ROBUST**2 * np.log1p(off**2 / ROBUST**2)).sum())

    def jacobians(self) -> tuple[np.ndarray, np.ndarray]:
        """Return derivatives of the pixels by the joints (M, V, J, 2, 3) and by the parameters (M, V, J, 2, Q).

        Those by parameters that no view may change are 0.
        """
        rig, xyz, small = self.calibration.rig, self.xyz, 1e-5
        by_xyz = np.stack([(rig.project(xyz + small * axis)[0] - self.pixels) / small for axis in np.eye(3)], -1)
        by_xyz = np.where(self.known[..., None, None], by_xyz, 0)
        by, free = np.zeros((*by_xyz.shape[:-1], Q)), self.problem.freedom.free
        if free[:, ROTATION].any():
            away = np.nan_to_num(xyz[:, None] - rig.centers[:, None])
            # A rotation of the camera by w about its centre moves X, relative to it, by -w x (X - C): d = (X - C) x w.
            by[..., ROTATION] = -np.cross(away[..., None, :], by_xyz)
        if free[:, CENTRE].any():
            by[..., CENTRE] = -by_xyz
        if free[:, FOCAL].any():
            by[..., FOCAL] = np.where(self.known[..., None], self.pixels - rig.K[:, None, :2, 2], 0)
        for parameter in (K1, K2):
            if free[:, parameter].any():
                step = np.zeros((len(rig), Q))
                step[:, parameter] = small
                other = self.calibration.changed(step).rig.project(xyz)[0]
                by[..., parameter] = np.where(self.known[..., None], np.nan_to_num((other - self.pixels) / small), 0)
        if self.problem.timed:
            seconds = self.problem.observations.frame / self.problem.observations.tracks.fps
            by[..., OFFSET] = np.where(self.known[..., None], -self.velocity, 0)
            by[..., DRIFT] = by[..., OFFSET] * seconds[:, None, None, None]
        return by_xyz, by
