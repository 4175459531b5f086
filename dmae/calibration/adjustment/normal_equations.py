"""Normal equations of an adjustment: costs, derivatives, and steps with the bodies eliminated.

M bodies, V views, J joints, Q parameters a view.
"""

from __future__ import annotations

import numpy as np

from dmae.calibration.adjustment.freedom import Freedom
from dmae.calibration.adjustment.observations import Observations
from dmae.calibration.adjustment.parameters import CENTRE, DRIFT, FOCAL, K1, K2, OFFSET, ROTATION, Calibration, Q

ROBUST = 2.0
"""Sigmas at which the weight of a residual is a half (Cauchy)."""
_BONE_SIGMA = 0.08
"""Share of its length by which a bone of a person seems to differ from frame to frame."""
_MIN_DEPTH = 0.1
_MIN_SIGMA_PX = 1.0
_BODY_DAMPING = 1e-3
"""1/m^2, relative to its information: keeps a joint that one view sees on its ray."""


class AdjustmentProblem:
    """What stays the same during an adjustment."""

    def __init__(self, observations: Observations, origin: Calibration, freedom: Freedom, bones: bool):
        self.observations, self.origin, self.freedom = observations, origin, freedom
        self.free = np.flatnonzero(freedom.free)
        self.bones = np.array(observations.tracks.skeleton.bones).reshape(-1, 2) if bones else np.empty((0, 2), int)
        self.timed = freedom.free[:, [OFFSET, DRIFT]].any()
        self.fixed_seen = None if self.timed else observations.seen(origin)
        self.depth: np.ndarray | None = None

    def at(self, calibration: Calibration, xyz: np.ndarray) -> AdjustmentState:
        return AdjustmentState(self, calibration, xyz)


class AdjustmentState:
    """Cost and normal equations at one set of cameras and bodies."""

    def __init__(self, problem: AdjustmentProblem, calibration: Calibration, xyz: np.ndarray):
        self.problem, self.calibration, self.xyz = problem, calibration, xyz
        rig = calibration.rig
        xy, self.velocity, sigma = problem.fixed_seen or problem.observations.seen(calibration)
        pixels, depth = rig.project(xyz)
        self.pixels, depth = pixels, np.where(depth > _MIN_DEPTH, depth, np.nan)
        focal = np.sqrt(rig.K[:, 0, 0] * rig.K[:, 1, 1])[:, None]
        self.residual = pixels - xy
        if problem.depth is None:
            known = np.where(np.isnan(depth).all((0, 2))[:, None], 1.0, depth)
            usual = np.nanmedian(known, (0, 2)) if known.size else np.ones(depth.shape[1])
            problem.depth = np.where(np.isnan(depth), usual[:, None], depth)
        # At the depth at the start: if errors grew as a body comes nearer, a smaller world would fit better.
        scale = 1 / np.maximum(sigma * focal / problem.depth, _MIN_SIGMA_PX)
        known = np.isfinite(self.residual).all(-1) & np.isfinite(scale) & np.isfinite(depth)
        # One view alone says nothing about cameras.
        known &= known.sum(1, keepdims=True) >= 2
        self.known, self.scale = known, np.where(known, scale, 0)
        self.residual = np.where(known[..., None], self.residual, 0)
        self.error2 = (self.residual**2).sum(-1) * self.scale**2
        cost = ROBUST**2 * np.log1p(self.error2 / ROBUST**2)
        self.cost = np.where(known, cost, 0).sum((1, 2))
        # Joints behind a camera that detected them, or that nothing is known of, cost as an outlier.
        lost = np.isfinite(sigma) & ~known & (np.isfinite(sigma).sum(1, keepdims=True) >= 2)
        self.cost = self.cost + 25.0 * lost.sum((1, 2))
        self.bone_cost = self._bones()
        self.prior_cost = self._prior()
        self.total = float(self.cost.sum() + self.bone_cost + self.prior_cost)

    def _bones(self) -> float:
        bones, person = self.problem.bones, self.problem.observations.person
        if not len(bones):
            return 0.0
        vector = self.xyz[:, bones[:, 1]] - self.xyz[:, bones[:, 0]]
        length = np.linalg.norm(vector, axis=-1)
        # Both ends must be measured by two views.
        measured = self.known.any(1)
        ok = measured[:, bones[:, 0]] & measured[:, bones[:, 1]] & np.isfinite(length)
        usual = np.full(length.shape, np.nan)
        for each in np.unique(person):
            rows = person == each
            values = np.where(ok[rows], length[rows], np.nan)
            enough = np.isfinite(values).sum(0) >= 3
            if enough.any():
                usual[np.ix_(rows, enough)] = np.nanmedian(values[:, enough], 0)
        # Relative to its length, so that a smaller world fits no better.
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
        # Turning the camera by w about its centre moves what it sees by -w x (X - C): d = (X - C) x w.
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

    def normal(self, damping: float):
        """Return the parts of the normal equations: of bodies, mixed, and of cameras."""
        free, (M, J) = self.problem.free, self.xyz.shape[:2]
        V = len(self.calibration.rig)
        by_xyz, by = self.jacobians()
        weight = self.scale**2 / (1 + self.error2 / ROBUST**2)
        weighted = by_xyz * weight[..., None, None]
        # Bodies: blocks of 3 x 3 a joint, connected by bones.
        rows = weighted.transpose(0, 2, 4, 1, 3).reshape(M, J, 3, 2 * V)
        blocks = rows @ by_xyz.transpose(0, 2, 1, 3, 4).reshape(M, J, 2 * V, 3)
        gradient = (rows @ self.residual.transpose(0, 2, 1, 3).reshape(M, J, 2 * V, 1))[..., 0]
        mixed, camera_gradient = np.zeros((M, J, 3, len(free))), np.zeros(len(free))
        cameras = np.zeros((len(free), len(free)))
        for view in np.unique(free // Q):
            own = np.flatnonzero(free // Q == view)
            columns = by[:, view][..., free[own] % Q]
            mixed[..., own] = weighted[:, view].swapaxes(-1, -2) @ columns
            flat = columns.reshape(-1, len(own))
            heavy = flat * np.repeat(weight[:, view].reshape(-1), 2)[:, None]
            cameras[np.ix_(own, own)] = heavy.T @ flat
            camera_gradient[own] = heavy.T @ self.residual[:, view].reshape(-1)
        mixed = mixed.reshape(M, 3 * J, len(free))
        camera_gradient += (self.prior_weight * self.step).reshape(-1)[free]
        cameras = cameras + np.diag(self.prior_weight.reshape(-1)[free])
        return blocks, gradient, mixed, cameras, camera_gradient

    def eliminated(self, damping: float):
        """Return the whitened mixed part, the reduced equations of the cameras and what bodies need."""
        blocks, gradient, mixed, cameras, camera_gradient = self.normal(damping)
        M, J = self.xyz.shape[:2]
        trace = np.trace(blocks, axis1=-2, axis2=-1)[..., None, None]
        blocks = (
            blocks + (damping * _BODY_DAMPING + 1e-9) * (trace + 1) * np.eye(3) + damping * 1e-3 * trace * np.eye(3)
        )
        blocks = np.where(trace > 0, blocks, np.eye(3))
        bones = self.problem.bones
        if len(bones):
            A = np.zeros((M, J, 3, J, 3))
            joint = np.arange(J)
            A[:, joint, :, joint] = blocks.swapaxes(0, 1)
            outer = np.einsum("mb,mbi,mbk->mbik", self.bone_weight, self.bone_unit, self.bone_unit)
            push = (self.bone_weight * self.bone_off)[..., None] * self.bone_unit
            gradient = gradient.copy()
            for index, (a, b) in enumerate(bones):
                part = outer[:, index]
                A[:, a, :, a] += part
                A[:, b, :, b] += part
                A[:, a, :, b] -= part
                A[:, b, :, a] -= part
                gradient[:, b] += push[:, index]
                gradient[:, a] -= push[:, index]
            A = A.reshape(M, 3 * J, 3 * J) + 1e-6 * np.eye(3 * J)
            inverse = np.linalg.inv(A)
            solved_mixed = inverse @ mixed
            solved_gradient = (inverse @ gradient.reshape(M, -1, 1))[..., 0]
        else:
            inverse = np.linalg.inv(blocks)
            P = mixed.shape[-1]
            solved_mixed = (inverse @ mixed.reshape(M, J, 3, P)).reshape(M, 3 * J, P)
            solved_gradient = (inverse @ gradient[..., None]).reshape(M, 3 * J)
        flat = gradient.reshape(M, 3 * J)
        return solved_mixed, solved_gradient, mixed, flat, cameras, camera_gradient

    def solve(self, damping: float, move_people: bool) -> tuple[np.ndarray, np.ndarray]:
        """Return a step of the cameras (V, Q) and of the bodies (M, J, 3)."""
        free, V = self.problem.free, len(self.calibration.rig)
        solved_mixed, solved_gradient, mixed, flat, cameras, gradient = self.eliminated(damping)
        step = np.zeros(V * Q)
        if len(free):
            if move_people:
                cameras = cameras - np.tensordot(mixed, solved_mixed, ((0, 1), (0, 1)))
                gradient = gradient - np.tensordot(solved_mixed, flat, ((0, 1), (0, 1)))
            # Scaled by the diagonal, as parameters have different units.
            scale = 1 / np.sqrt(np.maximum(np.diag(cameras), 1e-9))
            scaled = cameras * scale * scale[:, None] + (damping + 1e-10) * np.eye(len(free))
            step[free] = -scale * np.linalg.lstsq(scaled, scale * gradient, rcond=1e-12)[0]
        move = np.zeros_like(self.xyz)
        if move_people:
            move = -(solved_gradient + solved_mixed @ step[free]).reshape(move.shape)
            length = np.linalg.norm(move, axis=-1, keepdims=True)
            move *= np.minimum(1, 0.5 / np.maximum(length, 1e-9))
        return step.reshape(V, Q), move
