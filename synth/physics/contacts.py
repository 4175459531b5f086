"""Contacts of a simulation, and the deepest overlaps in each frame."""

from dataclasses import dataclass

import mujoco
import numpy as np


@dataclass(frozen=True)
class Overlaps:
    """The deepest overlaps of every frame.

    Attributes:
        persons: (F,) between people, m; below 0 where only cloth is in contact, -inf without contact.
        objects: (F,) between people and objects, m.
    """

    persons: np.ndarray
    objects: np.ndarray


class Contacts:
    """Recorder of all contacts of a simulation, step by step."""

    def __init__(self):
        self._frames: list[int] = []
        self._distances: list[np.ndarray] = []
        self._geoms: list[np.ndarray] = []

    def watch(self, data: mujoco.MjData, frame: int) -> None:
        """Record the contacts of a step that leads to a frame."""
        if data.ncon:
            self._frames.append(frame)
            self._distances.append(data.contact.dist.copy())
            self._geoms.append(data.contact.geom.copy())

    def overlaps(self, geom_persons: np.ndarray, frames: int) -> Overlaps:
        """Return the deepest overlaps of each frame.

        Args:
            geom_persons: (ngeom,) person that each geom belongs to, -1 for objects.
            frames: Number of frames.
        """
        persons, objects = np.full(frames, -np.inf), np.full(frames, -np.inf)
        if self._frames:
            frame = np.repeat(self._frames, [len(distance) for distance in self._distances])
            depth = -np.concatenate(self._distances)
            one, other = geom_persons[np.concatenate(self._geoms)].T
            object_contact = np.minimum(one, other) < 0
            people = ~object_contact & (one != other)
            np.maximum.at(objects, frame[object_contact], depth[object_contact])
            np.maximum.at(persons, frame[people], depth[people])
        return Overlaps(persons, objects)
