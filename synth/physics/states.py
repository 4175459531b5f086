"""States, forces and contacts of a simulation at the times of a clip's frames."""

import mujoco
import numpy as np

from synth.physics.joint_addresses import JointAddresses

AT_ONCE = 1e-6
"""Times closer than this to a step count as the time of the step, in steps."""


class StatesAt:
    """A recorder of the states of a simulation at given times, interpolated between two steps where necessary.

    Args:
        model: The scene.
        joints: Addresses of the people's joints.
        geom_persons: (ngeom,) index of the person that a geom belongs to, -1 for objects.
        times: (F,) sorted times, as numbers of steps.

    Attributes:
        qpos: (F, nq) float64.
        forces: (F, P, 17, 3) forces and torques that are applied to people in the last step before each time.
    """

    def __init__(self, model: mujoco.MjModel, joints: JointAddresses, geom_persons: np.ndarray, times: np.ndarray):
        self._model, self._joints, self._persons, self._times, self._next = model, joints, geom_persons, times, 0
        self.qpos, self._before = np.empty((len(times), model.nq)), np.empty(model.nq)
        self.forces = np.empty((len(times), *joints.moves(np.empty(model.nv)).shape), np.float32)
        self._contacts: list[tuple[np.ndarray, ...]] = []

    def see(self, data: mujoco.MjData, step: int) -> None:
        """Record the state after this number of steps; call it for all steps in order."""
        while self._next < len(self._times) and self._times[self._next] <= step + AT_ONCE:
            self.qpos[self._next] = self._between(data.qpos, self._times[self._next] - (step - 1))
            self.forces[self._next] = self._joints.moves(data.qfrc_applied)
            self._contacts.append(self._pressing(data))
            self._next += 1
        self._before[:] = data.qpos

    def contacts(self) -> tuple[np.ndarray, ...]:
        """Return frame (C,), geoms (C, 2), point (C, 3), force of the first on the second (C, 3) and depth (C,)."""
        frames = np.repeat(np.arange(len(self._contacts)), [len(found[0]) for found in self._contacts])
        parts = [np.concatenate(part) for part in zip(*self._contacts, strict=True)]
        return frames.astype(np.int32), parts[0], *(part.astype(np.float32) for part in parts[1:])

    def _between(self, after: np.ndarray, share: float) -> np.ndarray:
        if share > 1 - AT_ONCE:
            return after
        change, state = np.empty(self._model.nv), self._before.copy()
        mujoco.mj_differentiatePos(self._model, change, 1.0, self._before, after)
        mujoco.mj_integratePos(self._model, state, change, share)
        return state

    def _pressing(self, data: mujoco.MjData) -> tuple[np.ndarray, ...]:
        """Return the contacts of people in which a force acts."""
        contact, local = data.contact, np.zeros((data.ncon, 6))
        for number in range(data.ncon):
            mujoco.mj_contactForce(self._model, data, number, local[number])
        pressing = np.flatnonzero((local[:, 0] > 0) & (self._persons[contact.geom] >= 0).any(1))
        # The rows of a contact's frame are its axes, first the normal from the first geom to the second.
        forces = np.einsum("cij,ci->cj", contact.frame[pressing].reshape(-1, 3, 3), local[pressing, :3])
        return contact.geom[pressing], contact.pos[pressing], forces, -contact.dist[pressing]
