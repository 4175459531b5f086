"""Make people follow a reference motion by joint torques and a bounded force at the pelvis.

Plain numpy: a step of the controller takes a seventh of the time of the physics steps that follow it. A compiled loop
(numba) would save a few percent of the time of a clip, but every process would have to import it.
"""

import mujoco
import numpy as np

from synth.people.body import side_and_name
from synth.people.joint_limits import WIDEST
from synth.people.segments import SEGMENTS
from synth.physics.inverse_dynamics import inverse_dynamics
from synth.physics.joint_addresses import find_joints
from synth.physics.reference import ReferenceMotion
from synth.scene.build import STEPS_PER_CONTROL

# Stiffness, damping and greatest torque of each segment's joint for a person of 70 kg: N m / rad, N m s / rad, N m.
_GAINS = {
    "pelvis": (2000.0, 160.0, 300.0),
    "spine": (1500.0, 75.0, 300.0),
    "chest": (1500.0, 75.0, 300.0),
    "head": (180.0, 8.0, 50.0),
    "upper_arm": (300.0, 15.0, 80.0),
    "forearm": (150.0, 6.0, 50.0),
    "hand": (25.0, 0.8, 12.0),
    "thigh": (900.0, 45.0, 300.0),
    "shin": (500.0, 22.0, 220.0),
    "foot": (240.0, 9.0, 140.0),
}
_ROOT = (20000.0, 1500.0, 1500.0)
"""The same for the force at the pelvis, N / m, N s / m, N."""

_FOOT = (20000.0, 250.0)
"""Stiffness and damping of the force that holds a standing foot, N / m, N s / m."""
_FRICTION = 0.9
"""Greatest value of that force, as a share of the weight on the foot."""
_DYNAMICS = 2.0
"""Greatest force of the inverse dynamics, as a multiple of the remaining strength."""

_LEASH, _RETURN = 0.06, 1.0
"""Greatest lag of a pelvis behind its path before the path shifts, m, and the time constant of its return, s."""

_DIRECTION_EVERY = 16
"""Number of steps after which the shorter direction of each rotation is determined again."""

# Vector component i of the product conj(q) p is the sum over w, x, y, z of q times p[_ORDER[i]] times _SIGNS[i].
_ORDER = np.array(((1, 0, 3, 2), (2, 3, 0, 1), (3, 2, 1, 0)))
_SIGNS = np.array(((1.0, -1, -1, 1), (1, 1, -1, -1), (1, -1, 1, -1)))


class Controller:
    """A controller that tracks a reference by inverse dynamics plus proportional-derivative gains.

    Every joint has a greatest torque. A bounded external force and torque also act on the pelvis. This force carries
    the body, like the residual force of Yuan and Kitani (NeurIPS 2020), so that people need no balance. Damping is left
    to the implicit integrator, which keeps stiff joints stable.

    If others or a wall hold a person back, the force does not grow without limit: beyond a greatest lag (the leash),
    the path shifts sideways with the person. It returns slowly when nothing is in the way.
    """

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, reference: ReferenceMotion, masses: np.ndarray):
        """Args:
        model: The scene; its joints' damping and limits are set.
        data: Its state, on which the controller acts.
        reference: The motion to follow.
        masses: (P,) kg; gains are proportional to them.
        """
        persons, joints = len(masses), find_joints(model, len(masses))
        gains = np.array([_ROOT] + [_GAINS[side_and_name(name)[1]] for name in SEGMENTS])
        gains = np.repeat(gains * (masses / 70)[:, None, None], 3, axis=1).reshape(persons, -1, 3, 3)
        stiffness, self._damping, strength = np.moveaxis(gains, -1, 0).copy()
        joints.moves(model.dof_damping)[:] = self._damping
        model.jnt_limited[joints.joints], model.jnt_range[joints.joints, 1] = True, np.tile(WIDEST, persons)
        self._reference = reference
        self._planes = np.ascontiguousarray(np.moveaxis(reference.quats, -1, 1))
        self._root_stiffness = stiffness[:, 0]
        # The vector part of a rotation's quaternion is half its rotation vector.
        self._leverage = _SIGNS[..., None, None] * (2 * stiffness[:, 1:, 0])
        self._direction, self._direction_until = np.ones((persons, len(SEGMENTS))), 0
        forces, self._feet = inverse_dynamics(model, joints, reference)
        # Recordings that jump would require arbitrarily large forces.
        forces = joints.moves(forces).clip(-_DYNAMICS * strength, _DYNAMICS * strength)
        self._weakest, self._strongest = forces - strength, forces + strength
        moves = np.concatenate([reference.velocity[:, :, None], reference.spin], axis=2)
        self._forward = forces + self._damping * moves
        dt = STEPS_PER_CONTROL * model.opt.timestep
        self._decay = float(np.exp(-dt / _RETURN))
        self.shift = np.zeros((persons, 2))
        """(P, 2) shift of each person's path by obstacles and other people, m."""
        self._shifted = False
        heft = (masses / 70)[:, None, None]
        self._hold = heft * (_FOOT[0] + _FOOT[1] / dt), heft * (_FOOT[1] / dt)
        self._grip = _FRICTION * -model.opt.gravity[2] * masses[:, None] * reference.bearing
        self._foot_lag, self._foot_shift = np.zeros((persons, 2, 3)), np.zeros((persons, 2, 2))

        self._root, self._quats = joints.root(data.qpos), joints.quats(data.qpos)
        self._velocity, self._force = joints.moves(data.qvel), joints.moves(data.qfrc_applied)
        self._foot_places, self._foot_force = joints.feet(data.xipos), joints.feet(data.xfrc_applied)[..., :3]

    def start(self) -> None:
        """Put the people at the start of the reference, with its velocities."""
        reference = self._reference
        self._root[:], self._quats[:] = reference.root[0], reference.quats[0]
        self._velocity[:, 0], self._velocity[:, 1:] = reference.velocity[0], reference.spin[0]

    def apply(self, step: int) -> None:
        """Set the forces that move the people towards a step of the reference."""
        lag = self._reference.root[step] - self._root
        if self._shifted or np.vdot(lag, lag) > _LEASH**2:
            lag[:, :2] += self._shift_paths(lag[:, :2])
        wanted = np.empty_like(self._force)
        wanted[:, 0] = self._root_stiffness * lag
        wanted[:, 1:] = self._torques(step)
        damping = self._damping * self._velocity
        wanted += self._forward[step]
        wanted -= damping
        self._force[:] = np.minimum(np.maximum(wanted, self._weakest[step]), self._strongest[step]) + damping
        self._hold_feet(step)

    def _torques(self, step: int) -> np.ndarray:
        """Return (P, 16, 3) torques of the proportional gains, which turn each joint in the shorter direction, N m."""
        if step >= self._direction_until:
            # q and -q are the same orientation; neither jumps from step to step.
            self._direction = np.sign((self._reference.quats[step] * self._quats).sum(-1))
            self._direction_until = step + _DIRECTION_EVERY
        levers = self._planes[step][_ORDER] * self._leverage
        torques = (levers * self._quats.transpose(2, 0, 1)).sum(1) * self._direction
        return torques.transpose(1, 2, 0)

    def _hold_feet(self, step: int) -> None:
        """Hold standing feet in place; a shift of the path does not move them.

        The engine provides the positions of bodies in the previous step.
        """
        lag, grip = self._feet[step] - self._foot_places, self._grip[step]
        before = lag.copy() if step == 0 else self._foot_lag
        if self._shifted:
            np.copyto(self._foot_shift, self.shift[:, None], where=grip[..., None] < 1.0)
            lag[..., :2] += self._foot_shift
        force = self._hold[0] * lag - self._hold[1] * before
        strength = np.sqrt(np.einsum("pfi,pfi->pf", force, force))
        self._foot_force[:] = force * (grip / np.maximum(strength, grip + 1e-9))[..., None]
        self._foot_lag = lag

    def _shift_paths(self, lag: np.ndarray) -> np.ndarray:
        """Shift the paths of people with a lag (P, 2), m, beyond the leash; return the shift, (P, 2) m."""
        self._shifted = True
        beyond = lag + self.shift
        if np.vdot(beyond, beyond) > _LEASH**2:
            distance = np.maximum(np.hypot(beyond[:, :1], beyond[:, 1:]), _LEASH)
            self.shift -= beyond * (1 - _LEASH / distance)
        self.shift *= self._decay
        return self.shift
