"""The motion of one person on the canonical body segments, recorded or procedural."""

from dataclasses import dataclass

import numpy as np

from synth.people.segments import SEGMENTS


@dataclass(frozen=True)
class Motion:
    """Motion of one person, independent of the person's proportions.

    In the canonical pose every rotation is the identity. The pose is a T-pose that faces +x, with +y to the left and
    +z up. The arms point straight out along +y and -y, the palms face down, and the feet are flat and point forward.
    From this pose, elbows bend forward as hinges about z, and knees bend backward as hinges about y.

    Attributes:
        name: Human-readable source: file stem and frame range, or the procedural recipe.
        fps: Frames per second.
        root: (F, 3) mid point of the hip joints, m, world z up, floor at z = 0.
        rotations: (F, 16, 3, 3) world orientation of each of `SEGMENTS`, world from segment.
        hip_height: Height of the hip joints above the soles when the source's body stands straight, m. For a body with
            other proportions, `root` is scaled by the ratio of both hip heights.
        seats: Frames in which the person begins to sit on a stool.
        actions: First frame and name of each action. If empty, the whole motion is one action, named `name`.
        first: Frame of the recording at which this motion begins. It aligns takes of people recorded together.
    """

    name: str
    fps: float
    root: np.ndarray
    rotations: np.ndarray
    hip_height: float
    seats: tuple[int, ...] = ()
    actions: tuple[tuple[int, str], ...] = ()
    first: int = 0

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
