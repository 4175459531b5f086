"""The external force and moment that a motion needs, by Newton's and Euler's laws from recorded states."""

from typing import NamedTuple

import mujoco
import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import butter, sosfiltfilt

_CUTOFF = 6.0
"""Cut-off frequency of the motion, Hz. Gait laboratories use it to smooth marker paths before differentiation."""
LEAST_FPS = 12.0
"""Lowest frame rate at which accelerations can be computed from positions, 1/s."""


class Movement(NamedTuple):
    """The motion of B bodies in F frames.

    Attributes:
        places: (F, B, 3) centres of mass, m, world.
        velocities: (F, B, 3) m / s.
        accelerations: (F, B, 3) m / s^2.
        turning: (F, B, 3) angular velocities, rad / s, world.
        spin_rates: (F, B, 3) rate of change of the angular momentum about the body's centre of mass, N m.
    """

    places: np.ndarray
    velocities: np.ndarray
    accelerations: np.ndarray
    turning: np.ndarray
    spin_rates: np.ndarray


class NeededForces(NamedTuple):
    """The external forces on a group of bodies, without gravity.

    Attributes:
        centre: (F, 3) centre of mass, m, world.
        force: (F, 3) N, world.
        moment: (F, 3) about the centre of mass, N m, world.
    """

    centre: np.ndarray
    force: np.ndarray
    moment: np.ndarray


def smoothed(values: np.ndarray, fps: float, derivative: int = 0) -> np.ndarray:
    """Return values (F, ...) at F frames, or their time derivative, without frequencies above 6 Hz.

    A Butterworth filter of second order is run forwards and backwards, as for gait (Winter, Biomechanics and Motor
    Control, 4th ed., ch. 3). Derivatives come from a cubic spline through the filtered values.
    """
    if len(values) > 1:
        sections = butter(2, min(_CUTOFF, 0.4 * fps), fs=fps, output="sos")
        padding = min(round(fps), len(values) - 1)
        values = sosfiltfilt(sections, values, axis=0, padlen=padding)
    if derivative == 0:
        return values
    if len(values) < 2:
        return np.zeros_like(values)
    times = np.arange(len(values)) / fps
    return CubicSpline(times, values)(times, derivative)


def movement(model: mujoco.MjModel, places: np.ndarray, turns: np.ndarray, bodies: np.ndarray, fps: float) -> Movement:
    """Return the motion of bodies.

    Args:
        model: The scene.
        places: (F, B, 3) centres of mass of the bodies, m, world: `xipos`.
        turns: (F, B, 3, 3) orientations of their principal axes: `ximat`.
        bodies: (B,) indices in the model.
        fps: Frames per second.
    """
    rates = smoothed(turns, fps, 1) @ turns.swapaxes(-1, -2)
    # In the rate of a rotation matrix times its inverse, only the skew part is a rotation. The rest is fitting error.
    rates = (rates - rates.swapaxes(-1, -2)) / 2
    omega = np.stack([rates[..., 2, 1], rates[..., 0, 2], rates[..., 1, 0]], -1)
    own = (turns.swapaxes(-1, -2) @ omega[..., None])[..., 0] * model.body_inertia[bodies]
    spins = (turns @ own[..., None])[..., 0]
    return Movement(places, smoothed(places, fps, 1), smoothed(places, fps, 2), omega, smoothed(spins, fps, 1))


def needed_forces(model: mujoco.MjModel, moves: Movement, bodies: np.ndarray) -> NeededForces:
    """Return the external forces on a group of bodies, by Newton's and Euler's laws.

    Args:
        model: The scene.
        moves: The smoothed motion of B bodies.
        bodies: (B,) indices of the bodies in the model.
    """
    masses = model.body_mass[bodies][:, None]
    centre = (masses * moves.places).sum(1) / masses.sum()
    forces = masses * (moves.accelerations - model.opt.gravity)
    moments = np.cross(moves.places - centre[:, None], forces) + moves.spin_rates
    return NeededForces(centre, forces.sum(1), moments.sum(1))
