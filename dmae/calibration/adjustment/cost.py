"""The cost of an adjustment, and its derivatives.

A detector displaces some joints of a person in a view by nearly constant offsets. They are 23 % of the energy of
OpenPose's errors on Shelf, with each view left out in turn. Longer recordings do not average them out. These offsets
can therefore be unknowns too, with a prior.

M bodies, V views, J joints, Q parameters per view, A views with offsets.
"""

from __future__ import annotations

import numpy as np

from dmae.calibration.adjustment.freedom import Freedom
from dmae.calibration.adjustment.observations import Observations
from dmae.calibration.adjustment.parameters import CENTRE, DRIFT, FOCAL, K1, K2, OFFSET, ROTATION, Calibration, Q

ROBUST = 2.0
"""Sigmas at which the weight of a residual is a half (Cauchy)."""
_BONE_SIGMA = 0.08
"""Standard deviation of the measured length of a bone between frames, as a share of its length."""
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
        self.offset_weight = observations.bodies_a_second() * _ALIKE_S / OFFSET_M**2
        self.free = np.flatnonzero(freedom.free)
        self.bones = np.array(observations.tracks.skeleton.bones).reshape(-1, 2) if bones else np.empty((0, 2), int)
        self.timed = freedom.free[:, [OFFSET, DRIFT]].any()
        self.fixed_seen = None if self.timed else observations.seen(origin)
        self.depth: np.ndarray | None = None

    def at(self, calibration: Calibration, xyz: np.ndarray, offset: np.ndarray | None = None) -> AdjustmentState:
        return AdjustmentState(self, calibration, xyz, offset)


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
        self.prior_cost = self._prior()
        offset_cost = problem.offset_weight * (self.offset**2).sum()
        self.total = float(self.cost.sum() + self.bone_cost + self.prior_cost + offset_cost)

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

    def _prior(self) -> float:
        freedom = self.problem.freedom
        self.step = self.problem.origin.difference(self.calibration)
        off = self.step / freedom.prior
        self.prior_weight = 1 / freedom.prior**2
        if not freedom.robust_prior:
            return float((off**2).sum())
        # All parameters of one camera leave their prior together.
        square = (off**2).sum(-1)
        self.prior_weight = self.prior_weight / (1 + square)[:, None]
        return float(np.log1p(square).sum())

    def jacobians(self) -> tuple[np.ndarray, np.ndarray]:
        """Return derivatives of the pixels by the joints (M, V, J, 2, 3) and by the parameters (M, V, J, 2, Q)."""
        rig, xyz, small = self.calibration.rig, self.xyz, 1e-5
        by_xyz = np.stack([(rig.project(xyz + small * axis)[0] - self.pixels) / small for axis in np.eye(3)], -1)
        by_xyz = np.where(self.known[..., None, None], by_xyz, 0)
        by = np.zeros((*by_xyz.shape[:-1], Q))
        away = np.nan_to_num(xyz[:, None] - rig.centers[:, None])
        # A rotation of the camera by w about its centre moves X, relative to it, by -w x (X - C): d = (X - C) x w.
        by[..., ROTATION] = -np.cross(away[..., None, :], by_xyz)
        by[..., CENTRE] = -by_xyz
        free = self.problem.freedom.free
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
