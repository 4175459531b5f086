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
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from dmae.data.cameras import CameraRig
from dmae.data.skeleton import Skeleton
from dmae.numerics.filling import are_stills
from dmae.numerics.statistics import evenly_spaced

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
        turned = Rotation.from_rotvec(step[:, ROTATION]).as_matrix()
        R = rig.cam_from_world[:, :3, :3] @ turned.swapaxes(-1, -2)
        pose = rig.cam_from_world.copy()
        pose[:, :3, :3] = R
        pose[:, :3, 3] = -(R @ (rig.centers + step[:, CENTRE])[..., None])[..., 0]
        K, dist = rig.K.copy(), rig.dist.copy()
        K[:, :2, :2] *= np.exp(step[:, FOCAL])[:, None, None]
        dist[:, 0] += step[:, K1]
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
_MIN_DEPTH, _MIN_SIGMA_PX = 0.1, 1.0


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
        if free[:, K1].any():
            other = self.calibration.changed(np.tile(np.where(np.arange(Q) == K1, small, 0), (len(rig), 1)))
            change = (other.rig.project(xyz)[0] - self.pixels) / small
            by[..., K1] = np.where(self.known[..., None], np.nan_to_num(change), 0)
        if self.problem.timed:
            seconds = self.problem.observations.frame / self.problem.observations.tracks.fps
            by[..., OFFSET] = np.where(self.known[..., None], -self.velocity, 0)
            by[..., DRIFT] = by[..., OFFSET] * seconds[:, None, None, None]
        return by_xyz, by


# The adjustment


@dataclass(frozen=True)
class Adjusted:
    """The outcome of an adjustment."""

    calibration: Calibration  # The cameras
    xyz: np.ndarray  # (M, J, 3) m, the bodies; NaN where fewer than two views see a joint
    # (M, V, J) distance between detection and reprojection, in sigmas; NaN where there is no detection
    error: np.ndarray
    error_px: np.ndarray  # (M, V, J) the same in px
    # (V Q, V Q) information of the parameters, with the bodies eliminated; 0 for fixed parameters
    information: np.ndarray
    gradient: np.ndarray
    cost: np.ndarray  # (M,) robust cost of each body
    scores: np.ndarray  # (M, V Q) contribution of each body to the gradient
    offset_spread: np.ndarray  # (V Q, V Q) covariance of the gradient due to offsets of joints
    curvature: float  # Second derivative of the robust cost, relative to the weights in `information`


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
    origin, damping = calibration, 1e-3
    xyz = observations.start if xyz is None else xyz
    problem = AdjustmentProblem(observations, origin, freedom, bones, offsets)
    state = AdjustmentState(problem, calibration, xyz)
    for _ in range(iterations):
        moved = False
        for _ in range(6):
            step, move, offset = solve(state, damping, move_people)
            cameras = state.calibration.changed(step) if len(problem.free) else state.calibration
            tried = AdjustmentState(problem, cameras, state.xyz + move, state.offset + offset)
            if tried.total <= state.total:
                moved = state.total - tried.total > tolerance * max(state.total, 1e-9)
                state, damping = tried, max(damping / 5, 1e-9)
                break
            damping = max(damping * 8, 1e-6)
        if not moved:
            break
    free, V = problem.free, len(calibration.rig)
    information, gradient = np.zeros((V * Q, V * Q)), np.zeros(V * Q)
    scores, spread = np.zeros((len(xyz), V * Q)), np.zeros((V * Q, V * Q))
    if len(free):
        parts = _derivatives(state)
        found = _reduced(state, parts, *_inverse(state, parts, 0.0))
        information[np.ix_(free, free)], gradient[free] = found.information, found.gradient
        spread[np.ix_(free, free)], scores[:, free] = found.offset_spread, found.scores
    # The mean second derivative of the robust cost over the mean weight: w^2 for a Cauchy weight w.
    weight = np.where(state.known, state.scale**2, 0)
    usual = (weight * state.robust).sum()
    return Adjusted(
        state.calibration,
        np.where(state.known.any(1)[..., None], state.xyz, np.nan),
        np.where(state.known, np.sqrt(state.error2), np.nan),
        np.where(state.known, np.sqrt((state.residual**2).sum(-1)), np.nan),
        information,
        gradient,
        state.cost,
        scores,
        spread,
        float((weight * state.robust**2).sum() / usual) if usual else 1.0,
    )


_CHUNK = 128  # Number of bodies that are eliminated together, to limit memory
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


class _Parts(NamedTuple):
    """Derivatives and weights."""

    by: np.ndarray  # (M, V, J, 2, Q) derivatives of pixels by the parameters of their camera
    weight: np.ndarray  # (M, V, J) 1/px^2
    weighted: np.ndarray  # (M, V, J, 2, 3) derivatives of pixels by the joints, times the weight
    # blocks, gradient: (M, J, 3, 3), (M, J, 3) normal equations of the joints
    blocks: np.ndarray
    gradient: np.ndarray


def _derivatives(state: AdjustmentState) -> _Parts:
    """Return the derivatives, and the normal equations of the joints without bones."""
    by_xyz, by = state.jacobians()
    weight = state.scale**2 * state.robust
    weighted = by_xyz * weight[..., None, None]
    M, V, J = weight.shape
    rows = weighted.transpose(0, 2, 4, 1, 3).reshape(M, J, 3, 2 * V)
    blocks = rows @ by_xyz.transpose(0, 2, 1, 3, 4).reshape(M, J, 2 * V, 3)
    gradient = (rows @ state.residual.transpose(0, 2, 1, 3).reshape(M, J, 2 * V, 1))[..., 0]
    return _Parts(by, weight, weighted, blocks, gradient)


def _inverse(state: AdjustmentState, parts: _Parts, damping: float) -> tuple[np.ndarray, np.ndarray]:
    """Return inverse matrices of the bodies, (M, J, 3, 3) or with bones (M, 3 J, 3 J), and their gradient (M, 3 J)."""
    blocks, gradient = parts.blocks, parts.gradient
    M, J = state.xyz.shape[:2]
    trace = np.trace(blocks, axis1=-2, axis2=-1)[..., None, None]
    blocks = blocks + (damping * _BODY_DAMPING + 1e-9) * (trace + 1) * np.eye(3) + damping * 1e-3 * trace * np.eye(3)
    blocks = np.where(trace > 0, blocks, np.eye(3))
    bones = state.problem.bones
    if not len(bones):
        return np.linalg.inv(blocks), gradient.reshape(M, 3 * J)
    A = np.zeros((M, J, 3, J, 3))
    joint = np.arange(J)
    A[:, joint, :, joint] = blocks.swapaxes(0, 1)
    outer = np.einsum("mb,mbi,mbk->mbik", state.bone_weight, state.bone_unit, state.bone_unit)
    push = (state.bone_weight * state.bone_off)[..., None] * state.bone_unit
    gradient = gradient.copy()
    for index, (a, b) in enumerate(bones):
        part = outer[:, index]
        A[:, a, :, a] += part
        A[:, b, :, b] += part
        A[:, a, :, b] -= part
        A[:, b, :, a] -= part
        gradient[:, b] += push[:, index]
        gradient[:, a] -= push[:, index]
    return np.linalg.inv(A.reshape(M, 3 * J, 3 * J) + 1e-6 * np.eye(3 * J)), gradient.reshape(M, 3 * J)


def _reduced(
    state: AdjustmentState, parts: _Parts, inverse: np.ndarray, flat: np.ndarray, move_people: bool = True
) -> Reduced:
    """Return the equations of the cameras, from matrices and gradient of bodies; fixed bodies and offsets stay in."""
    free, (M, J) = state.problem.free, state.xyz.shape[:2]
    P = len(free)
    information, scores = np.zeros((P, P)), np.zeros((M, P))
    for view in np.unique(free // Q):
        own = np.flatnonzero(free // Q == view)
        columns = parts.by[:, view][..., free[own] % Q].reshape(M, 2 * J, len(own))
        heavy = columns * parts.weight[:, view].repeat(2, -1)[..., None]
        information[np.ix_(own, own)] = np.tensordot(heavy, columns, ((0, 1), (0, 1)))
        scores[:, own] = (state.residual[:, view].reshape(M, 1, 2 * J) @ heavy)[:, 0]
    prior = state.prior_weight.reshape(-1)[free]
    information += np.diag(prior)
    gradient = prior * state.step.reshape(-1)[free]
    spread, eliminated = np.zeros((P, P)), []
    offsets = state.offset.shape[1] > 0
    people = range(len(state.problem.people)) if offsets else [None]
    for person in people if move_people else ():
        rows = np.flatnonzero(state.problem.person == person) if offsets else np.arange(M)
        A, own_scores = _of_person(state, parts, inverse, flat, rows)
        information += A[:P, :P]
        scores[rows] += own_scores[:, :P]
        if offsets:
            weight = state.problem.offset_weight
            own = np.linalg.inv(A[P:, P:] + weight * np.eye(len(A) - P))
            K = A[:P, P:] @ own
            g = own_scores[:, P:].sum(0) + weight * state.offset[person].reshape(-1)
            information -= K @ A[P:, :P]
            scores[rows] -= own_scores[:, P:] @ K.T
            gradient -= weight * K @ state.offset[person].reshape(-1)
            spread += (weight * OFFSET_M) ** 2 * K @ K.T
            eliminated.append((K, own @ g))
    return Reduced(information, gradient + scores.sum(0), scores, spread, eliminated)


def _of_person(state: AdjustmentState, parts: _Parts, inverse: np.ndarray, flat: np.ndarray, rows: np.ndarray):
    """Return what bodies (m,) of one person add to equations of cameras and offsets, except of cameras alone."""
    free, J = state.problem.free, state.xyz.shape[1]
    P, views = len(free), state.problem.offset_views
    L = 2 * J * len(views)
    A, scores = np.zeros((P + L, P + L)), np.zeros((len(rows), P + L))
    heavy = parts.weight[rows][:, views] * state.unit[rows]
    A[P:, P:] = np.diag((heavy * state.unit[rows]).sum(0).repeat(2))
    scores[:, P:] = (heavy[..., None] * state.residual[rows][:, views]).reshape(len(rows), L)
    for i, view in enumerate(views):
        own = np.flatnonzero(free // Q == view)
        columns = parts.by[rows, view][..., free[own] % Q] * heavy[:, i, :, None, None]
        part = slice(P + 2 * J * i, P + 2 * J * (i + 1))
        A[own, part] = columns.sum(0).reshape(2 * J, len(own)).T
        A[part, own] = A[own, part].T
    for start in range(0, len(rows), _CHUNK):
        each = rows[start : start + _CHUNK]
        mixed = _mixed(state, parts, each)
        solved = _solved(inverse[each], mixed)
        A -= np.tensordot(mixed, solved, ((0, 1), (0, 1)))
        scores[start : start + _CHUNK] -= (flat[each, None] @ solved)[:, 0]
    return A, scores


def _mixed(state: AdjustmentState, parts: _Parts, rows: np.ndarray) -> np.ndarray:
    """Return the equations (m, 3 J, P + 2 A J) of bodies with cameras and with offsets of their person."""
    free, J = state.problem.free, state.xyz.shape[1]
    P, views = len(free), state.problem.offset_views
    mixed = np.zeros((len(rows), J, 3, P + 2 * J * len(views)))
    for view in np.unique(free // Q):
        own = np.flatnonzero(free // Q == view)
        columns = parts.by[rows, view][..., free[own] % Q]
        mixed[..., own] = parts.weighted[rows, view].swapaxes(-1, -2) @ columns
    joint = np.arange(J)
    for i, view in enumerate(views):
        for axis in (0, 1):
            column = P + (i * J + joint) * 2 + axis
            part = parts.weighted[rows, view, :, axis] * state.unit[rows, i, :, None]
            mixed[:, joint, :, column] = part.swapaxes(0, 1)
    return mixed.reshape(len(rows), 3 * J, mixed.shape[-1])


_LARGEST = 1.0
"""Largest step of a focal length's logarithm, and of distortion, which little evidence determines badly."""


def solve(state: AdjustmentState, damping: float, move_people: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return a step of the cameras (V, Q), of the bodies (M, J, 3) and of the offsets."""
    free, V = state.problem.free, len(state.calibration.rig)
    parts = _derivatives(state)
    inverse, flat = _inverse(state, parts, damping)
    step, offset = np.zeros(V * Q), np.zeros_like(state.offset)
    if len(free):
        found = _reduced(state, parts, inverse, flat, move_people)
        # The equations are scaled by the diagonal, as parameters have different units.
        scale = 1 / np.sqrt(np.maximum(np.diag(found.information), 1e-9))
        scaled = found.information * scale * scale[:, None] + (damping + 1e-10) * np.eye(len(free))
        step[free] = -scale * np.linalg.lstsq(scaled, scale * found.gradient, rcond=1e-12)[0]
        for person, (K, own) in enumerate(found.eliminated):
            offset[person] = -(own + K.T @ step[free]).reshape(offset.shape[1:])
    step, move = step.reshape(V, Q), np.zeros_like(state.xyz)
    step[:, [FOCAL, K1]] = np.clip(step[:, [FOCAL, K1]], -_LARGEST, _LARGEST)
    if move_people:
        pixels = np.zeros(state.residual.shape)
        for view in np.unique(free // Q):
            pixels[:, view] = parts.by[:, view] @ step[view]
        pixels[:, state.problem.offset_views] += offset[state.problem.person] * state.unit[..., None]
        push = (parts.weighted * pixels[..., None]).sum((1, 3)).reshape(flat.shape)
        move = -_solved(inverse, (flat + push)[..., None])[..., 0].reshape(move.shape)
        length = np.linalg.norm(move, axis=-1, keepdims=True)
        move *= np.minimum(1, 0.5 / np.maximum(length, 1e-9))
    return step, move, offset


def _solved(inverse: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Return the product of inverse matrices of bodies and (m, 3 J, n)."""
    if inverse.ndim == 3:
        return inverse @ right
    m, J = inverse.shape[:2]
    return (inverse @ right.reshape(m, J, 3, right.shape[-1])).reshape(right.shape)


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
        scores, index = adjusted.scores[:, free], np.ix_(free, free)
        scatter = scores.T @ scores
        values, vectors = np.linalg.eigh(scatter)
        root = vectors * np.sqrt(np.maximum(values, 0)) @ vectors.T
        G = _bodies_per_error(observations, scores @ np.linalg.pinv(root)) * scatter + adjusted.offset_spread[index]
        H = np.linalg.pinv(adjusted.information[index] * adjusted.curvature)
        covariance[index] = H @ G @ H
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
