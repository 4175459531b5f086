"""Make people follow a reference motion by joint torques and a bounded push at the pelvis."""

from dataclasses import dataclass

import mujoco
import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from synth.body import part
from synth.motion import PARENTS, SEGMENTS

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

_LEASH, _RETURN = 0.06, 1.0
"""How far a pelvis may lag behind its path before the path gives way, m, and the time in which that is made up, s."""


@dataclass(frozen=True)
class Reference:
    """Where people should be at each of S steps.

    Attributes:
        root: (S, P, 3) mid points of the hip joints, m.
        velocity: (S, P, 3) theirs, m / s.
        quats: (S, P, 16, 4) orientation (w first) of each segment in its parent, of the pelvis in the world.
        spin: (S, P, 16, 3) angular velocity of each segment relative to its parent, in its own axes, rad / s.
    """

    root: np.ndarray
    velocity: np.ndarray
    quats: np.ndarray
    spin: np.ndarray

    def still(self) -> "Reference":
        """One step: the first pose, at rest."""
        return Reference(self.root[:1], 0 * self.velocity[:1], self.quats[:1], 0 * self.spin[:1])


def make_reference(root: np.ndarray, rotations: np.ndarray, fps: float, substeps: int) -> Reference:
    """Fill in `substeps` steps a frame, smoothly, from the first frame to the last.

    Args:
        root: (F, P, 3) m, world.
        rotations: (F, P, 16, 3, 3) world orientation of each of `SEGMENTS`.
        fps: Frames per second.
        substeps: Steps a frame.
    """
    frames, persons = root.shape[:2]
    relative = rotations.copy()
    relative[:, :, 1:] = np.swapaxes(rotations[:, :, PARENTS[1:]], -1, -2) @ rotations[:, :, 1:]
    quats = Rotation.from_matrix(relative.reshape(-1, 3, 3)).as_quat(scalar_first=True)
    quats = quats.reshape(frames, persons, len(SEGMENTS), 4)
    # q and -q are the same orientation: keep each on the side of the one before, so that they can be interpolated.
    flips = np.sign((quats[1:] * quats[:-1]).sum(-1, keepdims=True))
    quats[1:] *= np.cumprod(np.where(flips < 0, -1.0, 1.0), axis=0)

    dt = 1 / (fps * substeps)
    times, steps = np.arange(frames) / fps, np.arange((frames - 1) * substeps + 1) * dt
    if frames == 1:
        return Reference(root, np.zeros_like(root), quats, np.zeros((1, persons, len(SEGMENTS), 3)))
    path = CubicSpline(times, root)
    quats = CubicSpline(times, quats)(steps)
    quats /= np.linalg.norm(quats, axis=-1, keepdims=True)
    spin = np.zeros((*quats.shape[:-1], 3))
    spin[:-1] = 2 / dt * (_turns_to(quats[1:]) @ quats[:-1, ..., None])[..., 1:, 0]
    spin[-1] = spin[-2]
    return Reference(path(steps), path(steps, 1), quats, spin)


def _turns_to(stop: np.ndarray) -> np.ndarray:
    """(..., 4, 4) matrices that take an orientation q to conj(q) stop (..., 4), the turn from it to stop.

    The turn's first component is the cosine of half its angle; the rest, the sine along the axis in q's own axes, is
    half the rotation vector to second order.
    """
    w, (x, y, z) = stop[..., 0], np.moveaxis(stop[..., 1:], -1, 0)
    rows = [(w, x, y, z), (x, -w, -z, y), (y, z, -w, -x), (z, -y, x, -w)]
    return np.stack([np.stack(row, -1) for row in rows], -2)


@dataclass(frozen=True)
class Addresses:
    """Where each person's joints are in a model's state.

    Attributes:
        root: (P, 3) in qpos; the first three velocities of the free joint are at `root_dof`.
        root_dof: (P, 3) in qvel.
        quats: (P, 16, 4) in qpos.
        spin: (P, 16, 3) in qvel.
    """

    root: np.ndarray
    root_dof: np.ndarray
    quats: np.ndarray
    spin: np.ndarray


def find_joints(model: mujoco.MjModel, persons: int) -> Addresses:
    """Where `persons` people's joints are in the model's state."""
    joints = np.array([[model.joint(f"person{p}/{name}").id for name in SEGMENTS] for p in range(persons)])
    quats, spin = model.jnt_qposadr[joints], model.jnt_dofadr[joints]
    root, root_dof = quats[:, 0].copy(), spin[:, 0].copy()
    quats[:, 0] += 3
    spin[:, 0] += 3
    three = np.arange(3)
    return Addresses(
        root[:, None] + three, root_dof[:, None] + three, quats[..., None] + np.arange(4), spin[..., None] + three
    )


class Controller:
    """Tracking of a reference: what moves the body along it (inverse dynamics), plus proportional-derivative gains.

    Every joint has a greatest torque. The pelvis is also pushed and turned from outside, up to a greatest force: that
    push carries the body, as the residual force of Yuan and Kitani (NeurIPS 2020), and spares people a sense of
    balance. Damping is left to the implicit integrator, so that stiff joints stay stable.

    Who is held back by others, or by a wall, does not pull ever harder: beyond a leash the path shifts sideways with
    the person, and creeps back when nothing is in the way.
    """

    def __init__(self, model: mujoco.MjModel, reference: Reference, masses: np.ndarray):
        """Args:
        model: The scene; its joint damping is set.
        reference: Where to be at each step.
        masses: (P,) kg; gains grow with them.
        """
        persons = len(masses)
        self.joints = find_joints(model, persons)
        gains = np.array([_GAINS[part(name)[1]] for name in SEGMENTS])
        gains = gains * (masses / 70)[:, None, None]
        root = np.array(_ROOT) * (masses / 70)[:, None]
        self._stiffness, self._strength = 2 * gains[..., 0, None], gains[..., 2, None]
        self._root_stiffness, self._root_strength = root[:, 0, None], root[:, 2, None]
        self._damping, self._root_damping = gains[..., 1, None], root[:, 1, None]
        model.dof_damping[self.joints.spin] = self._damping
        model.dof_damping[self.joints.root_dof] = self._root_damping
        self._reference = reference
        self._turns = _turns_to(reference.quats)
        forward = _inverse_dynamics(model, self.joints, reference)
        self._forward = forward[:, self.joints.spin]
        self._root_forward = forward[:, self.joints.root_dof]
        self._decay = float(np.exp(-model.opt.timestep / _RETURN))
        self.shift = np.zeros((persons, 2))
        """(P, 2) how far each person's path has been shifted by what is in its way, m."""

    def start(self, data: mujoco.MjData) -> None:
        """Put the people where the reference begins, moving as it does."""
        joints, reference = self.joints, self._reference
        data.qpos[joints.root], data.qpos[joints.quats] = reference.root[0], reference.quats[0]
        data.qvel[joints.root_dof], data.qvel[joints.spin] = reference.velocity[0], reference.spin[0]

    def apply(self, data: mujoco.MjData, step: int) -> None:
        """Set the forces that lead the people to where they should be at a step."""
        joints = self.joints
        turn = (self._turns[step] @ data.qpos[joints.quats][..., None])[..., 0]
        error = turn[..., 1:] * np.sign(turn[..., :1])
        damped = self._damping * data.qvel[joints.spin]
        torque = self._stiffness * error + self._forward[step] - damped
        data.qfrc_applied[joints.spin] = np.clip(torque, -self._strength, self._strength) + damped

        error = self._reference.root[step] - data.qpos[joints.root]
        lag = error[:, :2] + self.shift
        distance = np.sqrt((lag**2).sum(1, keepdims=True))
        self.shift -= lag * np.maximum(0, 1 - _LEASH / np.maximum(distance, 1e-9))
        self.shift *= self._decay
        error[:, :2] += self.shift
        damped = self._root_damping * data.qvel[joints.root_dof]
        force = self._root_stiffness * error + self._root_forward[step] - damped
        data.qfrc_applied[joints.root_dof] = np.clip(force, -self._root_strength, self._root_strength) + damped


def _inverse_dynamics(model: mujoco.MjModel, joints: Addresses, reference: Reference) -> np.ndarray:
    """(S, nv) forces that move the people along the reference where nothing touches them, damping included."""
    dt = model.opt.timestep
    data = mujoco.MjData(model)
    forces = np.zeros((len(reference.root), model.nv))
    acceleration, spin_up = np.zeros_like(reference.velocity), np.zeros_like(reference.spin)
    acceleration[:-1] = np.diff(reference.velocity, axis=0) / dt
    spin_up[:-1] = np.diff(reference.spin, axis=0) / dt
    flags = model.opt.disableflags
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    for step in range(len(forces)):
        data.qpos[joints.root], data.qpos[joints.quats] = reference.root[step], reference.quats[step]
        data.qvel[joints.root_dof], data.qvel[joints.spin] = reference.velocity[step], reference.spin[step]
        data.qacc[joints.root_dof], data.qacc[joints.spin] = acceleration[step], spin_up[step]
        mujoco.mj_inverse(model, data)
        forces[step] = data.qfrc_inverse
    model.opt.disableflags = flags
    return forces
