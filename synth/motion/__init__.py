"""Reference motion, from whatever source, on one canonical set of body segments."""

from dataclasses import dataclass

import numpy as np

SEGMENTS = (
    "pelvis", "spine", "chest", "head",
    "l_upper_arm", "l_forearm", "l_hand", "r_upper_arm", "r_forearm", "r_hand",
    "l_thigh", "l_shin", "l_foot", "r_thigh", "r_shin", "r_foot",
)  # fmt: skip
PARENTS = (-1, 0, 1, 2, 2, 4, 5, 2, 7, 8, 0, 10, 11, 0, 13, 14)
"""Index of each segment's parent in `SEGMENTS`."""


@dataclass(frozen=True)
class Motion:
    """How one person moves, independent of the person's proportions.

    The canonical pose, in which every rotation is the identity, is a T-pose: facing +x, left
    is +y, up is +z, arms straight out along +y and -y with palms down, feet flat and pointing
    forward. From it elbows bend forward, as hinges about z, and knees backward, about y.

    Attributes:
        name: Source, for people to read: file stem and frame range, or the procedural recipe.
        fps: Frames per second.
        root: (F, 3) mid point of the hip joints, m, world z up, floor at z = 0.
        rotations: (F, 16, 3, 3) world orientation of each of `SEGMENTS`, world from segment.
        hip_height: Height of the hip joints above the soles when the source's body stands
            straight, m; a body of other proportions scales `root` by the ratio of the two.
        seats: Frames in each of which it has sat down on a stool that is its own.
    """

    name: str
    fps: float
    root: np.ndarray
    rotations: np.ndarray
    hip_height: float
    seats: tuple[int, ...] = ()

    def __post_init__(self):
        for field, shape in (("root", (3,)), ("rotations", (len(SEGMENTS), 3, 3))):
            array = np.asarray(getattr(self, field), np.float64)
            if array.shape[1:] != shape or len(array) != len(self.root):
                raise ValueError(f"motion {self.name!r}: {field} must have shape (F, *{shape}), found {array.shape}")
            if not np.isfinite(array).all():
                raise ValueError(f"motion {self.name!r}: {field} has values that are not finite")
            object.__setattr__(self, field, array)
        if not (self.fps > 0 and self.hip_height > 0 and len(self.root) > 0):
            raise ValueError(f"motion {self.name!r}: needs frames, fps > 0 and hip_height > 0")

    def __len__(self) -> int:
        return len(self.root)
