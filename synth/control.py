"""Make people follow a reference motion by joint torques and a bounded push at the pelvis."""

from dataclasses import dataclass

import mujoco
import numpy as np

from synth.body import part
from synth.feet import FEET
from synth.limits import WIDEST
from synth.motion import SEGMENTS
from synth.reference import Reference, filled

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
"""The same for the push at the pelvis, N / m, N s / m, N."""

_FOOT = (20000.0, 250.0)
"""Stiffness and damping of what holds a foot that bears in its place, N / m, N s / m."""
_FRICTION = 0.9
"""Greatest force of that, as a share of the weight that is on the foot."""
_OWN = 2.0
"""Greatest force that the motion's own dynamics may ask for, as a multiple of the strength that is left beside it."""
HELD = 2
"""Steps of the physics for which forces are held. All other steps that are spoken of here are so many of these."""
_EVERY = 2
"""Steps from one working out of the forces to the next."""

_LEASH, _RETURN = 0.06, 1.0
"""How far a pelvis may lag behind its path before the path gives way, m, and the time in which that is made up, s."""


@dataclass(frozen=True)
class Addresses:
    """Where the people are in a model's state: one after the other, each as their joints are in `SEGMENTS`.

    Attributes:
        qpos: Of P people, each 3 places of the pelvis and 16 quaternions.
        dofs: In qvel and the forces, each 3 of the pelvis' places and 3 of each of 16 turns.
        bodies, joints: Of the model, each 16.
    """

    persons: int
    qpos: slice
    dofs: slice
    bodies: slice
    joints: slice

    def root(self, qpos: np.ndarray) -> np.ndarray:
        """(..., P, 3) view of the pelvis' places in states (..., nq)."""
        return self._people(qpos)[..., :3]

    def quats(self, qpos: np.ndarray) -> np.ndarray:
        """(..., P, 16, 4) view of the orientations in states (..., nq)."""
        return self._people(qpos)[..., 3:].reshape(*qpos.shape[:-1], self.persons, len(SEGMENTS), 4)

    def moves(self, qvel: np.ndarray) -> np.ndarray:
        """(..., P, 17, 3) view of velocities or forces (..., nv): the pelvis' places, then each segment's turn."""
        return qvel[..., self.dofs].reshape(*qvel.shape[:-1], self.persons, 1 + len(SEGMENTS), 3)

    def feet(self, values: np.ndarray) -> np.ndarray:
        """(P, 2, n) view of the left and the right foot's values, of those of all bodies (nbody, n)."""
        return values[self.bodies].reshape(self.persons, len(SEGMENTS), -1)[:, FEET[0] :: FEET[1] - FEET[0]]

    def _people(self, qpos: np.ndarray) -> np.ndarray:
        return qpos[..., self.qpos].reshape(*qpos.shape[:-1], self.persons, -1)


def find_joints(model: mujoco.MjModel, persons: int) -> Addresses:
    """Where `persons` people's joints are in the model's state."""
    joints = np.array([[model.joint(f"person{p}/{name}").id for name in SEGMENTS] for p in range(persons)]).ravel()
    first = joints[0]
    assert np.array_equal(joints, np.arange(first, first + len(joints))), "people's joints follow each other"
    qpos, dof = model.jnt_qposadr[first], model.jnt_dofadr[first]
    return Addresses(
        persons,
        slice(qpos, qpos + persons * (3 + 4 * len(SEGMENTS))),
        slice(dof, dof + persons * (3 + 3 * len(SEGMENTS))),
        slice(model.jnt_bodyid[first], model.jnt_bodyid[first] + persons * len(SEGMENTS)),
        slice(first, first + persons * len(SEGMENTS)),
    )


# The components of the turn from q to p, see `_turn`, are sums over w, x, y, z of q times these of p, signed so.
_OTHERS = np.array(((1, 0, 3, 2), (2, 3, 0, 1), (3, 2, 1, 0)))
_SIGNS = np.array(((1.0, -1, -1, 1), (1, 1, -1, -1), (1, -1, 1, -1)))
_BLOCK = 16
"""Steps that are laid out together."""


class Controller:
    """Tracking of a reference: what moves the body along it (inverse dynamics), plus proportional-derivative gains.

    Every joint has a greatest torque. The pelvis is also pushed and turned from outside, up to a greatest force: that
    push carries the body, as the residual force of Yuan and Kitani (NeurIPS 2020), and spares people a sense of
    balance. Damping is left to the implicit integrator, so that stiff joints stay stable.

    Who is held back by others, or by a wall, does not pull ever harder: beyond a leash the path shifts sideways with
    the person, and creeps back when nothing is in the way.
    """

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, reference: Reference, masses: np.ndarray):
        """Args:
        model: The scene; its joints' damping and limits are set.
        data: Its state, on which this acts.
        reference: Where to be at each step.
        masses: (P,) kg; gains grow with them.
        """
        joints = find_joints(model, len(masses))
        gains = np.array([_ROOT] + [_GAINS[part(name)[1]] for name in SEGMENTS])
        gains = np.repeat(gains * (masses / 70)[:, None, None], 3, axis=1).reshape(len(masses), -1, 3, 3)
        # The error of a turn is half a rotation vector.
        self._stiffness, self._damping, strength = np.moveaxis(gains, -1, 0).copy()
        self._stiffness[:, 1:] *= 2
        self._leverage = _SIGNS[..., None, None, None] * self._stiffness[:, 1:, 0]
        joints.moves(model.dof_damping)[:] = self._damping
        model.jnt_limited[joints.joints], model.jnt_range[joints.joints, 1] = True, np.tile(WIDEST, len(masses))
        self._reference = reference
        forces, self._stands = _inverse_dynamics(model, joints, reference)
        # Takes that jump would ask for anything.
        forces = joints.moves(forces).clip(-_OWN * strength, _OWN * strength)
        self._weakest, self._strongest = forces - strength, forces + strength
        moves = np.concatenate([reference.velocity[:, :, None], reference.spin], axis=2)
        self._forward = forces + self._damping * moves
        self._decay = float(np.exp(-HELD * model.opt.timestep / _RETURN))
        self.shift = np.zeros((len(masses), 2))
        """(P, 2) how far each person's path has been shifted by what is in its way, m."""
        self._shifted = False
        dt, heft = HELD * model.opt.timestep, (masses / 70)[:, None, None]
        self._hold = heft * (_FOOT[0] + _FOOT[1] / dt), heft * (_FOOT[1] / dt)
        self._grip = _FRICTION * -model.opt.gravity[2] * masses[:, None] * reference.bearing
        self._off = np.zeros((2, len(masses), 2, 3))
        self._stood = np.zeros((len(masses), 2, 2))

        self._root, self._quats = joints.root(data.qpos), joints.quats(data.qpos)
        self._velocity, self._force = joints.moves(data.qvel), joints.moves(data.qfrc_applied)
        self._places, self._push = joints.feet(data.xipos), joints.feet(data.xfrc_applied)[..., :3]
        # Steps are short, so that making arrays would take longer than filling them.
        self._pull, self._damped, self._wanted = (np.empty(a.shape) for a in (self._root, self._force, self._force))
        self._planes = np.empty((4, *self._quats.shape[:2]))
        self._products = np.empty((3, *self._planes.shape))
        self._block, self._levers = -_BLOCK, np.empty((_BLOCK, *self._products.shape))

    def start(self) -> None:
        """Put the people where the reference begins, moving as it does."""
        reference = self._reference
        self._root[:], self._quats[:] = reference.root[0], reference.quats[0]
        self._velocity[:, 0], self._velocity[:, 1:] = reference.velocity[0], reference.spin[0]

    def apply(self, step: int) -> None:
        """Set the forces that lead the people to where they should be at a step."""
        if not 0 <= step - self._block < _BLOCK:
            self._lay_out(step)
        pull, damped, wanted = self._pull, self._damped, self._wanted
        np.copyto(self._planes, self._quats.transpose(2, 0, 1))
        np.multiply(self._levers[step - self._block], self._planes, out=self._products)
        np.add.reduce(self._products, axis=1, out=wanted[:, 1:].transpose(2, 0, 1))
        np.subtract(self._reference.root[step], self._root, out=pull)
        if self._shifted or np.vdot(pull, pull) > _LEASH**2:
            self._give_way(pull[:, :2])
        np.multiply(self._stiffness[:, 0], pull, out=wanted[:, 0])
        np.multiply(self._damping, self._velocity, out=damped)
        wanted += self._forward[step]
        wanted -= damped
        np.minimum(np.maximum(wanted, self._weakest[step], out=wanted), self._strongest[step], out=wanted)
        np.add(wanted, damped, out=self._force)
        self._hold_feet(step)

    def _hold_feet(self, step: int) -> None:
        """Hold the feet that bear where they are to stand; who is pushed aside does not take them along.

        The engine has places of bodies as of the step before.
        """
        off, before, grip = self._off[step % 2], self._off[1 - step % 2], self._grip[step]
        np.subtract(self._stands[step], self._places, out=off)
        if step == 0:
            np.copyto(before, off)
        if self._shifted:
            np.copyto(self._stood, self.shift[:, None], where=grip[..., None] < 1.0)
            off[..., :2] += self._stood
        force = self._hold[0] * off
        force -= self._hold[1] * before
        strength = np.sqrt(np.einsum("pfi,pfi->pf", force, force))
        np.multiply(force, (grip / np.maximum(strength, grip + 1e-9))[..., None], out=self._push)

    def _lay_out(self, step: int) -> None:
        """Prepare the torques of the steps from this one on, linear in the orientations; turns go the short way."""
        quats = self._reference.quats[step : step + _BLOCK]
        way = np.sign((quats[0] * self._quats).sum(-1, keepdims=True))
        planes = np.ascontiguousarray(np.moveaxis(quats * way, -1, 0))
        levers = self._levers[: len(quats)].transpose(1, 2, 0, 3, 4)
        np.multiply(planes[_OTHERS], self._leverage, out=levers)
        self._block = step

    def _give_way(self, lag: np.ndarray) -> None:
        """Shift the paths of people who lag (P, 2) m behind them by more than the leash, and add the shift to that."""
        self._shifted = True
        beyond = lag + self.shift
        if np.vdot(beyond, beyond) > _LEASH**2:
            distance = np.maximum(np.hypot(beyond[:, :1], beyond[:, 1:]), _LEASH)
            self.shift -= beyond * (1 - _LEASH / distance)
        self.shift *= self._decay
        lag += self.shift


def _inverse_dynamics(model: mujoco.MjModel, joints: Addresses, reference: Reference) -> tuple[np.ndarray, np.ndarray]:
    """What moves the people along the reference where nothing touches them, and where their feet then are.

    Both are worked out every few steps, and between these taken to change evenly.

    Args:
        model: The scene.
        joints: Of the people.
        reference: Of S steps.

    Returns:
        Forces (S, nv) and centres of mass of the feet (S, P, 2, 3), m.
    """
    dt, steps = HELD * model.opt.timestep, len(reference.root)
    data = mujoco.MjData(model)
    qvel = np.zeros((steps, model.nv))
    moves = joints.moves(qvel)
    moves[:, :, 0], moves[:, :, 1:] = reference.velocity, reference.spin
    some = np.arange(0, steps + _EVERY - 1, _EVERY).clip(max=steps - 1)
    later = np.minimum(some + 1, steps - 1)
    qpos, velocities, accelerations = np.tile(data.qpos, (len(some), 1)), qvel[some], (qvel[later] - qvel[some]) / dt
    joints.root(qpos)[:], joints.quats(qpos)[:] = reference.root[some], reference.quats[some]
    forces, places = np.empty_like(velocities), np.empty((len(some), joints.persons, 2, 3))
    # What mj_inverse does, but for the contacts and the constraints, which are left out.
    for k in range(len(some)):
        data.qpos[:], data.qvel[:], data.qacc[:] = qpos[k], velocities[k], accelerations[k]
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_comVel(model, data)
        mujoco.mj_rne(model, data, 1, forces[k])
        places[k] = joints.feet(data.xipos)
    return tuple(filled(values, _EVERY)[:steps] for values in (forces, places))
