"""Body proportions: lengths, widths and masses of segments, and their origins in a pose."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from synth.people.segments import PARENTS, SEGMENTS

SIDES = {"l": 1.0, "r": -1.0}
"""Sign of y on each side: left is +y."""

# Origin of each segment in its parent's frame, as fractions of stature, in the canonical T-pose; left side only.
# Lengths after Drillis & Contini (1966), as in Winter, Biomechanics and Motor Control (4th ed., fig. 4.1);
# joint centres are inside the breadths given there.
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

UPPER_ARM_LENGTH, FOREARM_LENGTH = _OFFSETS["forearm"][1], _OFFSETS["hand"][1]
THIGH_LENGTH, SHIN_LENGTH = -_OFFSETS["shin"][2], -_OFFSETS["foot"][2]
"""Lengths of bones as fractions of stature."""
LEG_LENGTH = THIGH_LENGTH + SHIN_LENGTH
"""Length from hip to ankle as a fraction of stature."""
HALF_HIP_WIDTH = _OFFSETS["thigh"][1]
"""Distance of each hip joint from the mid hip as a fraction of stature."""
_TRUNK = sum(_OFFSETS[name][2] for name in ("spine", "chest", "head"))
HEAD_HEIGHT = 0.155
"""Height of the crown above the joint of the head as a fraction of stature; Winter's figure gives the chin's height."""

ADULT_AGE = 18.0
"""Age from which proportions are an adult's, years."""
# Children by age, relative to adults of the same stature; means of boys and girls. Heads after circumferences
# (Roche et al., Pediatrics 79, 1987) and faces, which grow for longer than skulls (Farkas et al., Cleft Palate-
# Craniofacial Journal 29, 1992); legs after sitting heights (Snyder et al., UM-HSRI-77-17, 1977; Hawkes et al., Journal
# of Pediatrics, 2020); cross-sections of limbs and trunk are such that they contain the rest of the mass.
_AGES = (4.0, 6.0, 8.0, 10.0, 12.0, 14.0, 16.0, ADULT_AGE)
_HEADS = (1.45, 1.31, 1.205, 1.135, 1.06, 1.01, 1.0, 1.0)
_LEGS = (0.921, 0.951, 0.972, 0.992, 1.008, 1.014, 1.006, 1.0)
_SECTIONS = (1.57, 1.39, 1.26, 1.19, 1.11, 1.04, 1.01, 1.0)
_PUBERTY = (9.0, 16.0)
"""Ages between which the builds of women and men diverge, years."""
CHILD_FIGURE = 0.5
"""Build of children, as `Body.figure`: shoulders half way between those of men and of women."""
_HEAD_LOSS = 0.0114
"""Yearly decrease of the head's share of the mass until `_HEAD_LOST` (Jensen, Journal of Biomechanics 19, 1986)."""
_HEAD_LOST = 15.0
"""Age until which the head's share of the mass decreases, years."""
_ADULT_HIPS = 0.897
"""Height of the hips of adults, m, mean of men and women of average stature."""

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


def side_and_name(segment: str) -> tuple[str, str]:
    """Split a segment's name into its side ("l", "r", or "" on the mid line) and the rest."""
    side, underscore, name = segment.partition("_")
    return (side, name) if underscore and side in SIDES else ("", segment)


@dataclass(frozen=True)
class Body:
    """Proportions of one person.

    Attributes:
        stature: Standing height, m.
        mass: kg; relative to the stature it determines the girth of limbs and trunk.
        feminine: Build of shoulders, waist and hips, from 0 masculine to 1 feminine.
        legs: Length of the legs relative to the average at this stature; the trunk makes up the difference.
        arms: Length of the arms relative to the average at this stature.
        age: Years; below 18 proportions are those of children.
    """

    stature: float = 1.75
    mass: float = 70.0
    feminine: float = 0.0
    legs: float = 1.0
    arms: float = 1.0
    age: float = 30.0

    def __post_init__(self):
        limits = {"stature": (0.85, 2.2), "mass": (10, 160), "feminine": (0, 1), "legs": (0.9, 1.1), "arms": (0.9, 1.1)}
        limits["age"] = (_AGES[0], 110)
        for name, (low, high) in limits.items():
            if not low <= getattr(self, name) <= high:
                raise ValueError(f"body: {name} must lie in {low}..{high}, got {getattr(self, name)}")

    @property
    def girth(self) -> float:
        """Breadth of limbs and trunk relative to a body mass index of 22.5 kg/m^2."""
        return float(np.sqrt(self.mass / self.stature**2 / 22.5 * np.interp(self.age, _AGES, _SECTIONS)))

    @property
    def figure(self) -> float:
        """Build of shoulders, waist and hips: 0 for men, 1 for women, and between them for boys and girls."""
        grown = float(np.interp(self.age, _PUBERTY, (0, 1)))
        return self.feminine * grown + CHILD_FIGURE * (1 - grown)

    @property
    def head(self) -> float:
        """Size of the head relative to an adult of the same stature."""
        return float(np.interp(self.age, _AGES, _HEADS))

    @property
    def leg(self) -> float:
        """Length of the legs relative to an average adult of the same stature."""
        return self.legs * float(np.interp(self.age, _AGES, _LEGS))

    @property
    def tempo(self) -> float:
        """Speed of movements relative to an adult's, 1 for adults.

        The duration of a stride, and therefore the speed, is proportional to the square root of the leg length (Hof,
        Gait & Posture 4, 1996).
        """
        return float(np.sqrt(_ADULT_HIPS / self.hip_height)) if self.age < ADULT_AGE else 1.0

    @property
    def hip_height(self) -> float:
        """Height of the hip joints above the soles in standing straight, m."""
        return self.stature * (LEG_LENGTH * self.leg + ANKLE_HEIGHT)

    @cached_property
    def trunk(self) -> float:
        """Length of the trunk relative to the average at this stature."""
        return 1 - (LEG_LENGTH * (self.leg - 1) + HEAD_HEIGHT * (self.head - 1)) / _TRUNK

    @cached_property
    def offsets(self) -> np.ndarray:
        """(16, 3) origin of each segment in its parent's frame, m; zero for the pelvis."""
        scale = {"spine": self.trunk, "chest": self.trunk, "head": self.trunk, "shin": self.leg, "foot": self.leg}
        scale |= {"forearm": self.arms, "hand": self.arms}
        offsets = np.zeros((len(SEGMENTS), 3))
        for i, segment in enumerate(SEGMENTS):
            side, name = side_and_name(segment)
            offsets[i] = np.array(_OFFSETS[name]) * self.stature * scale.get(name, 1.0)
            if name == "upper_arm":
                offsets[i] *= (1, 1 - 0.1 * self.figure, self.trunk)
            offsets[i, 1] *= SIDES.get(side, 1.0)
        return offsets

    @cached_property
    def masses(self) -> np.ndarray:
        """(16,) mass of each segment, kg."""
        names = [side_and_name(segment)[1] for segment in SEGMENTS]
        shares = np.array([_MASSES[name] for name in names])
        if self.age < ADULT_AGE:
            head = SEGMENTS.index("head")
            shares *= [self.leg if name in ("thigh", "shin") else 1.0 for name in names]
            shares[head] = _MASSES["head"] + _HEAD_LOSS * max(0.0, _HEAD_LOST - self.age)
            rest = np.arange(len(shares)) != head
            shares[rest] *= (1 - shares[head]) / shares[rest].sum()
        return self.mass * shares


def segment_origins(body: Body, root: np.ndarray, rotations: np.ndarray) -> np.ndarray:
    """Return the origins of all segments in a pose, (F, 16, 3) m, world.

    Args:
        body: The body.
        root: (F, 3) mid point of the hip joints, m, world.
        rotations: (F, 16, 3, 3) world orientation of each of `SEGMENTS`.
    """
    origins = np.empty((len(root), len(SEGMENTS), 3))
    origins[:, 0] = root
    for i, parent in enumerate(PARENTS[1:], start=1):
        origins[:, i] = origins[:, parent] + rotations[:, parent] @ body.offsets[i]
    return origins
