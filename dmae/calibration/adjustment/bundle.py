"""Bundle adjustment: the cameras and the bodies that fit the detections best.

Levenberg-Marquardt on robust reprojection errors and bone lengths. The bodies are eliminated from the normal equations
(Schur complement; Triggs et al., Bundle adjustment - a modern synthesis, 2000), so that a step costs what its cameras
cost, and the covariance of the cameras comes with it. `scipy.optimize.least_squares` has no such elimination: with the
sparse Jacobian it needs tens of times as long.

M bodies, V views, J joints, Q parameters a view.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dmae.calibration.adjustment.freedom import Freedom
from dmae.calibration.adjustment.normal_equations import AdjustmentProblem, AdjustmentState
from dmae.calibration.adjustment.observations import Observations
from dmae.calibration.adjustment.parameters import Calibration, Q


@dataclass(frozen=True)
class Adjusted:
    """The outcome of an adjustment.

    Attributes:
        calibration: The cameras.
        xyz: (M, J, 3) m, the bodies; NaN where fewer than two views see a joint.
        error: (M, V, J) distance between detection and reprojection, in sigmas; NaN where there is none.
        error_px: (M, V, J) the same in px.
        information: (V Q, V Q) of the parameters, the bodies eliminated; 0 for those that were not free.
        cost: (M,) robust cost of each body.
    """

    calibration: Calibration
    xyz: np.ndarray
    error: np.ndarray
    error_px: np.ndarray
    information: np.ndarray
    gradient: np.ndarray
    cost: np.ndarray


def adjust(
    observations: Observations,
    calibration: Calibration,
    freedom: Freedom | None = None,
    *,
    move_people: bool = True,
    iterations: int = 20,
    bones: bool = False,
    xyz: np.ndarray | None = None,
    tolerance: float = 1e-5,
) -> Adjusted:
    """Return the cameras and bodies of least robust cost.

    Args:
        observations: M bodies.
        calibration: Where the search starts.
        freedom: What may change; by default the bodies alone.
        move_people: Whether the bodies may change.
        iterations: Largest number of steps.
        bones: Whether the bones of a person have one length at all times.
        xyz: (M, J, 3) m, where the bodies start.
        tolerance: Relative decrease of the cost below which the search ends.
    """
    freedom = freedom or Freedom.of(len(calibration.rig))
    origin, damping = calibration, 1e-3
    xyz = observations.start if xyz is None else xyz
    problem = AdjustmentProblem(observations, origin, freedom, bones)
    state = problem.at(calibration, xyz)
    for _ in range(iterations):
        moved = False
        for _ in range(6):
            step, move = state.solve(damping, move_people)
            tried = problem.at(state.calibration.changed(step), state.xyz + move)
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
    information, all_gradient = np.zeros((V * Q, V * Q)), np.zeros(V * Q)
    if len(free):
        solved, _, mixed, flat, cameras, gradient = state.eliminated(0.0)
        information[np.ix_(free, free)] = cameras - np.tensordot(mixed, solved, ((0, 1), (0, 1)))
        all_gradient[free] = gradient - np.tensordot(solved, flat, ((0, 1), (0, 1)))
    px = np.sqrt((state.residual**2).sum(-1))
    return Adjusted(
        state.calibration,
        np.where(state.known.any(1)[..., None], state.xyz, np.nan),
        np.where(state.known, np.sqrt(state.error2), np.nan),
        np.where(state.known, px, np.nan),
        information,
        all_gradient,
        state.cost,
    )
