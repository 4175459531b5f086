"""Bundle adjustment: the cameras and the bodies that fit the detections best.

Levenberg-Marquardt on robust reprojection errors and bone lengths. The bodies are eliminated from the normal equations
(Schur complement; Triggs et al., Bundle adjustment - a modern synthesis, 2000). The cost of a step then depends mostly
on the number of cameras, and the covariance of the cameras is a by-product. `scipy.optimize.least_squares` has no such
elimination: with the sparse Jacobian and `lsmr` it takes four times as long for 1000 bodies in eight cameras, stops
centimetres away in directions that only priors hold, and the covariance needs the elimination anyway.

M bodies, V views, J joints, Q parameters per view.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from dmae.calibration.adjustment_problem import (
    FOCAL,
    K2,
    OFFSET_M,
    AdjustmentProblem,
    AdjustmentState,
    Calibration,
    Freedom,
    Observations,
    Q,
)


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
    step[:, FOCAL : K2 + 1] = np.clip(step[:, FOCAL : K2 + 1], -_LARGEST, _LARGEST)
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
