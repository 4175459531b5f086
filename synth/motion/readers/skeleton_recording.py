"""The motion of a recorded skeleton, with the joints, the unit and the axes of its file."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np


@dataclass(frozen=True)
class SkeletonRecording:
    """J joints in a tree over F frames.

    Attributes:
        path: The file that it was read from.
        fps: Frames per second.
        joints: J joint names, every parent before its children; the end site of a chain is `<joint>.end`.
        parents: (J,) index of each joint's parent, -1 for the root, which comes first.
        offsets: (J, 3) position of each joint in its parent's frame, in the file's unit; the root's is not used.
        root: (F, 3) position of the root in the world, in the file's unit.
        rotations: (F, J, 3, 3) orientation of each joint in its parent's frame.
        notes: Descriptions of repairs that were made in reading it.
    """

    path: Path
    fps: float
    joints: tuple[str, ...]
    parents: tuple[int, ...]
    offsets: np.ndarray
    root: np.ndarray
    rotations: np.ndarray
    notes: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.root)

    def forward(self) -> tuple[np.ndarray, np.ndarray]:
        """Compute forward kinematics.

        Returns:
            positions: (F, J, 3) positions of the joints in the world, in the file's unit.
            orientations: (F, J, 3, 3) orientations of the joints in the world.
        """
        positions = np.empty((*self.rotations.shape[:2], 3))
        orientations = np.empty_like(self.rotations)
        for joint, parent in enumerate(self.parents):
            if parent < 0:
                positions[:, joint], orientations[:, joint] = self.root, self.rotations[:, joint]
            else:
                positions[:, joint] = positions[:, parent] + orientations[:, parent] @ self.offsets[joint]
                orientations[:, joint] = orientations[:, parent] @ self.rotations[:, joint]
        return positions, orientations

    def turned(self, turn: np.ndarray) -> "SkeletonRecording":
        """Return the recording with its world turned by a rotation (3, 3)."""
        rotations = self.rotations.copy()
        rotations[:, 0] = turn @ rotations[:, 0]
        return replace(self, root=self.root @ turn.T, rotations=rotations)
