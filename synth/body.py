"""Bodies of people: how long, wide and heavy their segments are, and where they stand in a pose."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from synth.motion import PARENTS, SEGMENTS

SIDES = {"l": 1.0, "r": -1.0}
"""Sign of y on each side: left is +y."""

# Where a segment's joint lies in its parent, as a fraction of stature, in the canonical T-pose; left side only.
# Lengths after Drillis & Contini (1966), as in Winter, Biomechanics and Motor Control (4th ed., fig. 4.1);
# joint centres lie inside the breadths given there.
_OFFSETS = {
    "pelvis": (0.0, 0.0, 0.0),
    "spine": (-0.008, 0.0, 0.055),
    "chest": (0.0, 0.0, 0.095),
    "head": (-0.006, 0.0, 0.165),
    "upper_arm": (-0.004, 0.103, 0.137),
    "forearm": (0.0, 0.178, 0.0),
    "hand": (0.0, 0.148, 0.0),
    "thigh": (0.0, 0.052, 0.0),
    "shin": (0.0, 0.0, -0.245),
    "foot": (0.0, 0.0, -0.246),
}
ANKLE_HEIGHT = 0.039
"""Height of the ankle above the sole as a fraction of stature (Winter, fig. 4.1)."""

_LEG = -_OFFSETS["shin"][2] - _OFFSETS["foot"][2]

# Fractions of body mass, Winter, table 4.1.
_MASSES = {
    "pelvis": 0.142,
    "spine": 0.139,
    "chest": 0.216,
    "head": 0.081,
    "upper_arm": 0.028,
    "forearm": 0.016,
    "hand": 0.006,
    "thigh": 0.100,
    "shin": 0.0465,
    "foot": 0.0145,
}


def part(segment: str) -> tuple[str, str]:
    """A segment's side ("l", "r", or "" on the mid line) and its name without it."""
    side, underscore, name = segment.partition("_")
    return (side, name) if underscore and side in SIDES else ("", segment)


@dataclass(frozen=True)
class Body:
    """One person's proportions.

    Attributes:
        stature: Height standing, m.
        mass: kg; with the stature it says how stout the limbs and the trunk are.
        feminine: 0 for a masculine build of shoulders, waist and hips, 1 for a feminine one.
        legs: Length of the legs relative to the average for the stature; the trunk takes up the rest.
        arms: Length of the arms relative to the average for the stature.
    """

    stature: float = 1.75
    mass: float = 70.0
    feminine: float = 0.0
    legs: float = 1.0
    arms: float = 1.0

    def __post_init__(self):
        limits = {"stature": (1.2, 2.2), "mass": (30, 160), "feminine": (0, 1), "legs": (0.9, 1.1), "arms": (0.9, 1.1)}
        for name, (low, high) in limits.items():
            if not low <= getattr(self, name) <= high:
                raise ValueError(f"body: {name} must lie in {low}..{high}, got {getattr(self, name)}")

    @property
    def girth(self) -> float:
        """Breadth of limbs and trunk relative to a body mass index of 22.5 kg/m^2."""
        return float(np.sqrt(self.mass / self.stature**2 / 22.5))

    @property
    def hip_height(self) -> float:
        """Height of the hip joints above the soles when standing straight, m."""
        return self.stature * (_LEG * self.legs + ANKLE_HEIGHT)

    @cached_property
    def trunk(self) -> float:
        """Length of the trunk relative to the average for the stature."""
        return 1 - _LEG * (self.legs - 1) / sum(_OFFSETS[name][2] for name in ("spine", "chest", "head"))

    @cached_property
    def offsets(self) -> np.ndarray:
        """(16, 3) each segment's joint in its parent's frame, m; zero for the pelvis."""
        scale = {"spine": self.trunk, "chest": self.trunk, "head": self.trunk, "shin": self.legs, "foot": self.legs}
        scale |= {"forearm": self.arms, "hand": self.arms}
        offsets = np.zeros((len(SEGMENTS), 3))
        for i, segment in enumerate(SEGMENTS):
            side, name = part(segment)
            offsets[i] = np.array(_OFFSETS[name]) * self.stature * scale.get(name, 1.0)
            if name == "upper_arm":
                offsets[i] *= (1, 1 - 0.1 * self.feminine, self.trunk)
            offsets[i, 1] *= SIDES.get(side, 1.0)
        return offsets

    @cached_property
    def masses(self) -> np.ndarray:
        """(16,) mass of each segment, kg."""
        return self.mass * np.array([_MASSES[part(segment)[1]] for segment in SEGMENTS])


def segment_origins(body: Body, root: np.ndarray, rotations: np.ndarray) -> np.ndarray:
    """Where the segments' joints are in a pose.

    Args:
        body: Whose.
        root: (F, 3) mid point of the hip joints, m, world.
        rotations: (F, 16, 3, 3) world orientation of each of `SEGMENTS`.

    Returns:
        (F, 16, 3) origin of each segment, m, world.
    """
    origins = np.empty((len(root), len(SEGMENTS), 3))
    origins[:, 0] = root
    for i, parent in enumerate(PARENTS[1:], start=1):
        origins[:, i] = origins[:, parent] + rotations[:, parent] @ body.offsets[i]
    return origins
