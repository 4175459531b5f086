"""Addresses of the people's joints in a model's state, velocities and forces."""

from dataclasses import dataclass

import mujoco
import numpy as np

from synth.motion.feet import FEET
from synth.people.segments import SEGMENTS


@dataclass(frozen=True)
class JointAddresses:
    """Slices of a model's arrays: P people one after the other, each with the joints in the order of `SEGMENTS`.

    Attributes:
        persons: Number of people.
        qpos: Slice of positions; for each person 3 coordinates of the pelvis and 16 quaternions.
        dofs: Slice of velocities and forces; for each person 3 of the pelvis' translation and 3 of each of 16
            rotations.
        bodies, joints: Slices of the model's bodies and joints; 16 for each person.
    """

    persons: int
    qpos: slice
    dofs: slice
    bodies: slice
    joints: slice

    def root(self, qpos: np.ndarray) -> np.ndarray:
        """Return a (..., P, 3) view of the pelvis' positions in states (..., nq), m."""
        return self._people(qpos)[..., :3]

    def quats(self, qpos: np.ndarray) -> np.ndarray:
        """Return a (..., P, 16, 4) view of the orientations in states (..., nq), w first."""
        return self._people(qpos)[..., 3:].reshape(*qpos.shape[:-1], self.persons, len(SEGMENTS), 4)

    def moves(self, qvel: np.ndarray) -> np.ndarray:
        """Return a (..., P, 17, 3) view of velocities or forces (..., nv): pelvis' translation, then each rotation."""
        return qvel[..., self.dofs].reshape(*qvel.shape[:-1], self.persons, 1 + len(SEGMENTS), 3)

    def feet(self, values: np.ndarray) -> np.ndarray:
        """Return a (P, 2, n) view of the left and right foot's values in the values of all bodies (nbody, n)."""
        return values[self.bodies].reshape(self.persons, len(SEGMENTS), -1)[:, FEET[0] :: FEET[1] - FEET[0]]

    def _people(self, qpos: np.ndarray) -> np.ndarray:
        return qpos[..., self.qpos].reshape(*qpos.shape[:-1], self.persons, -1)


def find_joints(model: mujoco.MjModel, persons: int) -> JointAddresses:
    """Find the joints of a number of people in a model."""
    joints = np.array([[model.joint(f"person{p}/{name}").id for name in SEGMENTS] for p in range(persons)]).ravel()
    first = joints[0]
    assert np.array_equal(joints, np.arange(first, first + len(joints))), "people's joints follow each other"
    qpos, dof = model.jnt_qposadr[first], model.jnt_dofadr[first]
    return JointAddresses(
        persons,
        slice(qpos, qpos + persons * (3 + 4 * len(SEGMENTS))),
        slice(dof, dof + persons * (3 + 3 * len(SEGMENTS))),
        slice(model.jnt_bodyid[first], model.jnt_bodyid[first] + persons * len(SEGMENTS)),
        slice(first, first + persons * len(SEGMENTS)),
    )
