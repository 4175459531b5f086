"""Coverage of the floor: how many cameras see a person who stands at a point, if only the room is in the way."""

from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from dmae.data.cameras import CameraRig
from synth.rooms.mjcf import compile_mjcf
from synth.rooms.rays import cast_rays

_HEIGHTS = np.array([0.1, 0.5, 0.9, 1.3, 1.7])
"""Of the points of a person who stands, m."""
_ENOUGH = 4
"""Number of these points; a camera that sees this many sees the person."""
_STEP = 0.2
"""m between points of the floor."""
_GROUPS = tuple(range(6))
_TOUCHING = 0.05
"""m; what is this near to a point does not hide it."""


@dataclass(frozen=True)
class FloorCoverage:
    """How many cameras see a person at each point of a grid.

    Attributes:
        x, y: (N,), (M,) m.
        cameras: (N, M) number of cameras; -1 outside the people's area.
    """

    x: np.ndarray
    y: np.ndarray
    cameras: np.ndarray

    def share(self, least: int) -> float:
        """Return the % of the people's area that at least this number of cameras see."""
        inside = self.cameras >= 0
        return float(100 * (self.cameras[inside] >= least).mean())


def cover_floor(rig: CameraRig, arena: Path, middle: np.ndarray, radius: float) -> FloorCoverage:
    """Return how many cameras see a person at each point of the people's area.

    Args:
        rig: V cameras.
        arena: MJCF file of the room, without props and other people.
        middle: (2,) of the people's area, m.
        radius: Of the people's area, m.
    """
    model = compile_mjcf(arena)
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    steps = np.linspace(-radius, radius, 1 + 2 * max(1, round(radius / _STEP)))
    x, y = middle[0] + steps, middle[1] + steps
    flat = np.stack(np.meshgrid(x, y, indexing="ij"), -1)
    points = np.concatenate([np.tile(flat[:, :, None], (1, 1, len(_HEIGHTS), 1)),
                             np.broadcast_to(_HEIGHTS[:, None], (*flat.shape[:2], len(_HEIGHTS), 1))], -1)  # fmt: skip
    inside = rig.inside(rig.project(points.reshape(1, -1, 3))[0])[0]
    seen = np.zeros((len(rig), points[..., 0].size), bool)
    for view, center in enumerate(rig.centers):
        rays = points.reshape(-1, 3) - center
        reach = np.linalg.norm(rays, axis=1)
        geom, distance, _ = cast_rays(model, data, center, rays / reach[:, None], _GROUPS)
        seen[view] = inside[view] & ((geom < 0) | (distance > reach - _TOUCHING))
    count = (seen.reshape(len(rig), *points.shape[:3]).sum(-1) >= _ENOUGH).sum(0)
    return FloorCoverage(x, y, np.where(np.linalg.norm(flat - middle, axis=-1) <= radius + 1e-9, count, -1))
