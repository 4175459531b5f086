"""Coverage of the floor: the number of cameras that see a standing person, if only the room hides the person."""

from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from dmae.data.cameras import CameraRig
from synth.rooms.mjcf import compile_mjcf
from synth.rooms.rays import cast_rays

_HEIGHTS = np.array([0.1, 0.5, 0.9, 1.3, 1.7])
"""Heights of the tested points of a standing person, m."""
_LEAST_POINTS = 4
"""Number of these points that a camera must see to count as seeing the person."""
_STEP = 0.2
"""Distance between points of the floor, m."""
_GROUPS = tuple(range(6))
_CONTACT_GAP = 0.05
"""Distance below which an object in front of a point does not hide it, m."""


@dataclass(frozen=True)
class FloorCoverage:
    """The number of cameras that see a person at each point of a grid.

    Attributes:
        x, y: (N,) and (M,) coordinates of the grid, m.
        cameras: (N, M) number of cameras; -1 outside the people's area.
    """

    x: np.ndarray
    y: np.ndarray
    cameras: np.ndarray

    def share(self, least: int) -> float:
        """Return the share of the people's area that at least this number of cameras see, %."""
        inside = self.cameras >= 0
        return float(100 * (self.cameras[inside] >= least).mean())


def cover_floor(rig: CameraRig, arena: Path, middle: np.ndarray, radius: float) -> FloorCoverage:
    """Return the number of cameras that see a person at each point of the people's area.

    Args:
        rig: V cameras.
        arena: MJCF file of the room. Props and other people are ignored.
        middle: (2,) middle of the people's area, m.
        radius: Radius of the people's area, m.
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
        seen[view] = inside[view] & ((geom < 0) | (distance > reach - _CONTACT_GAP))
    count = (seen.reshape(len(rig), *points.shape[:3]).sum(-1) >= _LEAST_POINTS).sum(0)
    return FloorCoverage(x, y, np.where(np.linalg.norm(flat - middle, axis=-1) <= radius + 1e-9, count, -1))
