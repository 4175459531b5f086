"""Bundle adjustment: the cameras and the bodies that fit the detections best.

Levenberg-Marquardt on robust reprojection errors and bone lengths. The bodies are eliminated from the normal equations
(Schur complement; Triggs et al., Bundle adjustment - a modern synthesis, 2000). The cost of a step then depends mostly
on the number of cameras, and the covariance of the cameras is a by-product. `scipy.optimize.least_squares` has no such
elimination: with the sparse Jacobian it takes tens of times as long.

M bodies, V views, J joints, Q parameters per view.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dmae.calibration.adjustment.cost import AdjustmentProblem, AdjustmentState
from dmae.calibration.adjustment.freedom import Freedom
from dmae.calibration.adjustment.normal_equations import reduced, solve
from dmae.calibration.adjustment.observations import Observations
from dmae.calibration.adjustment.parameters import Calibration, Q


@dataclass(frozen=True)
class Adjusted:
    """The outcome of an adjustment.

    Attributes:
        calibration: The cameras.
        xyz: (M, J, 3) m, the bodies; NaN where fewer than two views see a joint.
        error: (M, V, J) distance between detection and reprojection, in sigmas; NaN where there is no detection.
        error_px: (M, V, J) the same in px.
        information: (V Q, V Q) information of the parameters, with the bodies eliminated; 0 for fixed parameters.
        cost: (M,) robust cost of each body.
        scores: (M, V Q) contribution of each body to the gradient.
        offset_spread: (V Q, V Q) covariance of the gradient due to offsets of joints.
        curvature: Second derivative of the robust cost, relative to the weights in `information`.
    """

    calibration: Calibration
    xyz: np.ndarray
    error: np.ndarray
    error_px: np.ndarray
    information: np.ndarray
    gradient: np.ndarray
    cost: np.ndarray
    scores: np.ndarray
    offset_spread: np.ndarray
    curvature: float


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
    """Return the cameras and bodies with the least robust cost.

    Args:
        observations: M bodies.
        calibration: The cameras at the start of the search.
        freedom: The parameters that may change; by default only the bodies change.
        move_people: Whether the bodies may change.
        iterations: Largest number of steps.
        bones: Whether the bones of a person have a constant length.
        offsets: Whether to estimate a constant offset of each joint of a person in each view.
        xyz: (M, J, 3) m, the bodies at the start of the search.
        tolerance: Relative decrease of the cost below which the search ends.
    """
    freedom = freedom or Freedom.of(len(calibration.rig))
    origin, damping = calibration, 1e-3
    xyz = observations.start if xyz is None else xyz
    problem = AdjustmentProblem(observations, origin, freedom, bones, offsets)
    state = problem.at(calibration, xyz)
    for _ in range(iterations):
        moved = False
        for _ in range(6):
            step, move, offset = solve(state, damping, move_people)
            tried = problem.at(state.calibration.changed(step), state.xyz + move, state.offset + offset)
            if tried.total <= state.total:
                moved = state.total - tried.total > tolerance * max(state.total, 1e-9)
                state, damping = tried, max(damping / 5, 1e-9)
                break
            damping = max(damping * 8, 1e-6)
        if not moved:
            break
    return _adjusted(state)


def _adjusted(state: AdjustmentState) -> Adjusted:
    """Return the outcome at a state."""
    free, V = state.problem.free, len(state.calibration.rig)
    information, gradient = np.zeros((V * Q, V * Q)), np.zeros(V * Q)
    scores, spread = np.zeros((len(state.xyz), V * Q)), np.zeros((V * Q, V * Q))
    if len(free):
        found = reduced(state)
        information[np.ix_(free, free)], gradient[free] = found.information, found.gradient
        spread[np.ix_(free, free)], scores[:, free] = found.offset_spread, found.scores
    px = np.sqrt((state.residual**2).sum(-1))
    return Adjusted(
        state.calibration,
        np.where(state.known.any(1)[..., None], state.xyz, np.nan),
        np.where(state.known, np.sqrt(state.error2), np.nan),
        np.where(state.known, px, np.nan),
        information,
        gradient,
        state.cost,
        scores,
        spread,
        _curvature(state),
    )


def _curvature(state: AdjustmentState) -> float:
    """Return the mean second derivative of the robust cost over the mean weight.

    For the Cauchy cost of a distance in the image with weight w, the mean over directions is w^2.
    """
    weight = np.where(state.known, state.scale**2, 0)
    usual = (weight * state.robust).sum()
    return float((weight * state.robust**2).sum() / usual) if usual else 1.0
