"""Bodies: segments, proportions by sex and age, and the landmarks that annotators and detectors see."""

from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np

from dmae.data.skeleton import Skeleton, get_skeleton

SEGMENTS = (
    "pelvis", "spine", "chest", "head",
    "l_upper_arm", "l_forearm", "l_hand", "r_upper_arm", "r_forearm", "r_hand",
    "l_thigh", "l_shin", "l_foot", "r_thigh", "r_shin", "r_foot",
)  # fmt: skip
PARENTS = (-1, 0, 1, 2, 2, 4, 5, 2, 7, 8, 0, 10, 11, 0, 13, 14)
"""Index of each segment's parent in `SEGMENTS`."""


# Proportions of one person
MOST_PERSONS = 30
"""Greatest number of people in a scene: MuJoCo filters contacts by the bits of a signed 32-bit number, one a person."""
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
"""Height of the crown above the head joint, as a fraction of stature; Winter's figure gives the chin's height."""

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
"""Build of children, as `Body.figure`: shoulders half way between men's and women's."""
_HEAD_LOSS = 0.0114
"""Yearly decrease of the head's share of the mass until `_HEAD_LOST` (Jensen, Journal of Biomechanics 19, 1986)."""
_HEAD_LOST = 15.0
"""Age until which the head's share of the mass decreases, years."""
_ADULT_HIPS = 0.897
"""Adults' hip height, m: the mean of men and women of average stature."""

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


_STATURES = (0.7, 1.3)
"""Least and greatest stature relative to the mean of boys and girls, or men and women, of the same age."""
_GIRTHS = (0.65, 1.55)
"""Least and greatest `Body.girth`: body mass indices of adults from 10 to 54 kg/m^2."""


@dataclass(frozen=True)
class Body:
    """Proportions of one person."""

    stature: float = 1.75  # Standing height, m
    # kg; relative to stature and age it determines the girth of limbs and trunk, 0.65 to 1.55 times the usual
    mass: float = 70.0
    feminine: float = 0.0  # Build of shoulders, waist and hips, from 0 masculine to 1 feminine
    legs: float = 1.0  # Length of the legs relative to the average at this stature; the trunk makes up the difference
    arms: float = 1.0  # Length of the arms relative to the average at this stature
    age: float = 30.0  # Years; below 18 proportions are those of children
    # Whether solid parts, which collide, fit the skin, as those of sampled people do
    snug: bool = field(default=False, kw_only=True)

    def __post_init__(self):
        self._check("age", _AGES[0], 110)
        usual = float(np.interp(self.age, _GROWTH[:, 0], _GROWTH[:, [1, 6]].mean(1)))
        self._check("stature", _STATURES[0] * usual, _STATURES[1] * usual, f" m at {self.age:g} years")
        for name, low, high in (("feminine", 0, 1), ("legs", 0.9, 1.1), ("arms", 0.9, 1.1)):
            self._check(name, low, high)
        if not self.mass > 0:
            raise ValueError(f"body: mass must be above 0 kg, found {self.mass}")
        light, heavy = (self.mass * (girth / self.girth) ** 2 for girth in _GIRTHS)
        self._check("mass", light, heavy, f" kg at {self.stature} m and {self.age:g} years")

    def _check(self, name: str, low: float, high: float, where: str = "") -> None:
        if not low <= getattr(self, name) <= high:
            raise ValueError(f"body: {name} must lie in {low:.4g}..{high:.4g}{where}, found {getattr(self, name)}")

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


# Height above the hip joints, distance ahead of them, half depth and half breadth of a masculine and of a feminine
# trunk, fractions of stature.
_SECTIONS_OF_TRUNK = [(-0.062, -0.004, 0.040, 0.052, 0.042, 0.054), (-0.035, -0.006, 0.058, 0.086, 0.061, 0.089),
          (0.0, -0.009, 0.065, 0.097, 0.069, 0.102), (0.045, -0.010, 0.066, 0.094, 0.067, 0.098),
          (0.09, -0.006, 0.062, 0.086, 0.058, 0.079), (0.13, -0.004, 0.061, 0.084, 0.054, 0.072),
          (0.18, -0.004, 0.064, 0.090, 0.060, 0.077), (0.225, -0.006, 0.069, 0.096, 0.069, 0.084),
          (0.265, -0.009, 0.065, 0.100, 0.061, 0.089), (0.290, -0.011, 0.054, 0.106, 0.050, 0.094),
          (0.303, -0.012, 0.046, 0.101, 0.043, 0.089), (0.312, -0.012, 0.040, 0.080, 0.037, 0.070),
          (0.319, -0.012, 0.036, 0.053, 0.033, 0.047), (0.325, -0.010, 0.034, 0.041, 0.031, 0.037)]  # fmt: skip


def trunk_sections(body: Body, heights: np.ndarray) -> np.ndarray:
    """Return ellipses across the bare trunk.

    Args:
        heights: (N,) heights above the hip joints, as fractions of stature, of a person with an average trunk.

    Returns:
        (N, 4) distance ahead of the hip joints and height above them, half depth and half breadth, m.
    """
    rows = np.array(_SECTIONS_OF_TRUNK)
    low, high, female = rows[:, :4], rows[:, 4:], body.figure
    stations = low.copy()
    stations[:, 2:] = (1 - female) * low[:, 2:] + female * high
    # The belly widens first.
    belly = np.exp(-(((rows[:, 0] - 0.1) / 0.08) ** 2))
    neck = np.clip((rows[:, 0] - 0.29) / 0.03, 0, 1)
    stations[:, 2] *= body.girth ** (1 + belly - 0.6 * neck)
    stations[:, 3] *= body.girth ** (1 + 0.4 * belly - 0.6 * neck)
    stations[:, 1] += belly * 0.04 * (body.girth - 1)
    stations *= body.stature
    up = stations[:, 0] * np.where(rows[:, 0] > 0, body.trunk, 1.0)
    columns = (stations[:, 1], up, stations[:, 2], stations[:, 3])
    return np.stack([np.interp(heights, rows[:, 0], column) for column in columns], -1)


def sitting_depth(body: Body) -> float:
    """Return the height of the hip joints above a seat, thighs level, m.

    It is fitted to the skin of adults and of children from 4 years on, within 5 mm, and contains 6 mm of cloth.
    """
    stout = float(np.sqrt(body.mass / body.stature**3))
    return (
        body.stature * (0.01255 + 0.01416 * stout + 0.00243 * body.figure + 0.00034 * min(body.age, ADULT_AGE)) + 0.006
    )


def segment_origins(body: Body, root: np.ndarray, rotations: np.ndarray) -> np.ndarray:
    """Return the origins of all segments in a pose, (F, 16, 3) m, world.

    Args:
        root: (F, 3) mid point of the hip joints, m, world.
        rotations: (F, 16, 3, 3) world orientation of each of `SEGMENTS`.
    """
    origins = np.empty((len(root), len(SEGMENTS), 3))
    origins[:, 0] = root
    for i, parent in enumerate(PARENTS[1:], start=1):
        origins[:, i] = origins[:, parent] + rotations[:, parent] @ body.offsets[i]
    return origins


# Stature, mass and limb lengths by sex, age and percentile
ADULT = 30.0
"""Age of sampled adults, years."""
CHILDREN = (4.0, ADULT_AGE)
"""Least and greatest age of children, years."""
_STATURE = (1.75, 0.12, 0.065)
"""Stature of adults, m: mean of men, difference of the mean of women, standard deviation. ANSUR II (Gordon et al.,
NATICK/TR-15/007, 2014) found 1.756, 0.127, and 0.069 for men and 0.064 for women."""
_INDEX = (24.0, 1.0, 3.0)
"""Body mass index of adults, kg/m^2: mean of men, difference of the mean of women, standard deviation; worldwide means
(NCD-RisC, Lancet 387, 2016). It is independent of stature, so that mass and stature correlate with 0.5, as among
soldiers."""
_LENGTH = 0.02
"""Relative standard deviation of leg and arm lengths at a given stature. For crotch heights in ANSUR II it is 2.8 %,
which includes measurement errors."""
_LIMITS = ((1.48, 2.02), (18.0, 33.0), (0.95, 1.05), (0.95, 1.05))
"""Bounds of adults' stature, m, body mass index, kg/m^2, relative leg length and relative arm length."""

# Growth charts of the CDC (Kuczmarski et al., Vital and Health Statistics 11/246, 2002). Rows: age, years; of boys and
# of girls, median stature, m, and its coefficient of variation, without the charts' skewness; then L, M, S
# of the body mass index, kg/m^2 (Cole and Green, Statistics in Medicine 11, 1992).
_GROWTH = np.array((
    (4, 1.0251, 0.0413, -1.684, 15.64, 0.0718, 1.0103, 0.0433, -2.991, 15.31, 0.0786),
    (6, 1.1566, 0.0437, -3.198, 15.38, 0.0827, 1.1501, 0.0450, -3.236, 15.21, 0.0934),
    (8, 1.2812, 0.0451, -3.191, 15.77, 0.1017, 1.2783, 0.0460, -2.629, 15.81, 0.1167),
    (10, 1.3882, 0.0476, -2.774, 16.62, 0.1198, 1.3821, 0.0487, -2.178, 16.84, 0.1367),
    (12, 1.4931, 0.0499, -2.453, 17.79, 0.1312, 1.5149, 0.0486, -1.977, 18.07, 0.1482),
    (13, 1.5641, 0.0503, -2.334, 18.44, 0.1341, 1.5734, 0.0439, -1.955, 18.71, 0.1506),
    (15, 1.7014, 0.0459, -2.136, 19.83, 0.1351, 1.6190, 0.0401, -2.032, 19.91, 0.1506),
    (16, 1.7361, 0.0431, -2.043, 20.53, 0.1342, 1.6257, 0.0398, -2.115, 20.43, 0.1492),
    (18, 1.7619, 0.0406, -1.877, 21.87, 0.1323, 1.6313, 0.0397, -2.301, 21.26, 0.1473),
))  # fmt: skip
_RAREST = 2.0
"""Greatest deviation of children from the median, in standard deviations: the charts' percentiles 2 to 98."""


def body_at(
    feminine: float,
    age: float = ADULT,
    *,
    stature: float = 0.0,
    index: float = 0.0,
    legs: float = 0.0,
    arms: float = 0.0,
) -> Body:
    """Return the body of a person of given sex, age and percentiles.

    Percentiles are deviations from the median in standard deviations; 1.645 is the 95th percentile.

    Raises ValueError if the age is below 4, or `feminine` is not within 0 to 1.

    Args:
        feminine: 0 for men and boys, 1 for women and girls.
        age: Years, from 4; adult proportions from 18 on.
        stature, index, legs, arms: Deviations of stature, body mass index, and leg and arm lengths at this stature,
            clipped to the range of the population.
    """
    if age < ADULT_AGE:
        index, stature = (float(np.clip(z, -_RAREST, _RAREST)) for z in (index, stature))
        row = np.array([np.interp(age, _GROWTH[:, 0], column) for column in _GROWTH.T[1:]])
        median, spread, power, middle, width = (1 - feminine) * row[:5] + feminine * row[5:]
        tall = median * (1 + spread * stature)
        heavy = middle * (1 + power * width * index) ** (1 / power)
    else:
        tall = np.clip(_STATURE[0] - _STATURE[1] * feminine + _STATURE[2] * stature, *_LIMITS[0])
        heavy = np.clip(_INDEX[0] - _INDEX[1] * feminine + _INDEX[2] * index, *_LIMITS[1])
    long = [np.clip(1 + _LENGTH * z, *limits) for z, limits in zip((legs, arms), _LIMITS[2:], strict=True)]
    return Body(*(round(float(value), 4) for value in (tall, heavy * tall**2, feminine, *long, age)))


def sample_body(children: float = 0.0, *, rng: np.random.Generator) -> Body:
    """Draw a person's body.

    Args:
        children: Probability of a child, of any age from 4 to 17 years.
    """
    age = rng.uniform(*CHILDREN) if children and rng.random() < children else ADULT
    feminine = float(rng.random() < 0.5)
    stature, index, legs, arms = rng.standard_normal(4)
    return body_at(feminine, age, stature=stature, index=index, legs=legs, arms=arms)


# Landmarks: where annotators and detectors place each joint
SKELETON = get_skeleton("body25+shelf14")


class _Landmark(NamedTuple):
    """A point that moves with a segment, on the left side."""

    segment: str  # Segment that it moves with
    joint: str  # Segment; the offset is relative to its origin in the T-pose
    # x, y, z: Offset, fractions of stature; an offset from the head is also scaled by the size of the head
    x: float
    y: float
    z: float
    # Depth in the limb, with clothes, for three quarters of the directions from which it is seen, fractions of stature;
    # it scales with girth. It is 0 for points on the skin of the head, which the head itself hides.
    radius: float = 0.0


# The eyes are 0.936 of stature above the floor and the chin 0.870 (Winter, fig. 4.1). OpenPose's hips are
# slightly above and outside the joint's centre; Shelf's annotators put hips 40 to 78 mm, and shoulders 21 to 38 mm,
# below those of OpenPose.
_LIMBS = {
    "elbow": _Landmark("forearm", "forearm", 0, 0, 0, 0.037),
    "wrist": _Landmark("hand", "hand", 0, 0, 0, 0.024),
    "knee": _Landmark("shin", "shin", 0, 0, 0, 0.057),
    "ankle": _Landmark("foot", "foot", 0, 0, 0, 0.040),
}
_BODY25 = _LIMBS | {
    "nose": _Landmark("head", "head", 0.075, 0, 0.068),
    "neck": _Landmark("chest", "upper_arm", 0.002, 0, 0.002, 0.125),
    "shoulder": _Landmark("chest", "upper_arm", 0.002, -0.002, 0.002, 0.068),
    "mid_hip": _Landmark("pelvis", "pelvis", 0, 0, 0.010, 0.101),
    "hip": _Landmark("pelvis", "thigh", 0, 0.006, 0.010, 0.090),
    "eye": _Landmark("head", "head", 0.060, 0.018, 0.091),
    "ear": _Landmark("head", "head", 0.006, 0.047, 0.082),
    "big_toe": _Landmark("foot", "foot", 0.108, -0.013, 0.009 - ANKLE_HEIGHT, 0.018),
    "small_toe": _Landmark("foot", "foot", 0.085, 0.026, 0.008 - ANKLE_HEIGHT, 0.021),
    "heel": _Landmark("foot", "foot", -0.037, 0, 0.009 - ANKLE_HEIGHT, 0.022),
}
_SHELF14 = _LIMBS | {
    "hip": _Landmark("thigh", "thigh", 0, 0.008, -0.024, 0.098),
    "shoulder": _Landmark("chest", "upper_arm", 0.002, -0.002, -0.015, 0.068),
    # Relative to the point half way between the shoulders and the ears.
    "bottom_head": _Landmark("head", "head", 0.0, 0, 0.0, 0.098),
    # 125 mm ahead of that and 145 mm above, on a body of 1.75 m.
    "top_head": _Landmark("head", "head", 0.0714, 0, 0.0829),
}
_HEAD_ENDS = ("bottom_head", "top_head")
# As annotated in MPII, and therefore in BODY_25B and Halpe: the crown, and the point where the neck meets the head.
_CROWN = {"head_top": _Landmark("head", "head", 0.005, 0, HEAD_HEIGHT)}
# BlazePose's: corners of the eyes and of the mouth, and knuckles.
_FACE_AND_HANDS = {
    "eye_inner": _Landmark("head", "head", 0.062, 0.009, 0.091),
    "eye_outer": _Landmark("head", "head", 0.055, 0.027, 0.091),
    "mouth": _Landmark("head", "head", 0.066, 0.014, 0.044),
    "little_finger": _Landmark("hand", "hand", -0.018, 0.047, -0.002, 0.014),
    "index_finger": _Landmark("hand", "hand", 0.018, 0.053, -0.002, 0.014),
    "thumb": _Landmark("hand", "hand", 0.030, 0.033, -0.004, 0.014),
}
_PLACES = {
    "shelf14": _SHELF14,
    "body25b": _BODY25 | _CROWN | {"neck": _Landmark("head", "head", 0.006, 0, 0.022, 0.060)},
    "halpe26": _BODY25 | _CROWN,
    "blazepose33": _BODY25 | _FACE_AND_HANDS,
}
"""Landmarks of skeletons that place joints differently from the joints of the same name in BODY_25."""
_SKIN = 0.025
"""Depth through which a joint on the skin still counts as seen, m."""


@lru_cache(maxsize=512)
def landmarks(body: Body, skeleton: Skeleton = SKELETON) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the joints of a skeleton on a body, each where the skeleton's annotators or detector place it.

    Args:
        skeleton: Any of `dmae.data.skeleton.SKELETONS`, or two of them side by side.

    Returns:
        segments: (J,) index into `SEGMENTS` of the segment that each joint moves with.
        points: (J, 3) position of the joint in that segment's frame, m.
        depth: (J,) greatest distance before the joint at which a ray may first meet the body and still count as seeing
            the joint, m: the depth of the joint in its limb, or little more than skin.
    """
    at = dict(zip(SEGMENTS, segment_origins(body, np.zeros((1, 3)), np.tile(np.eye(3), (1, 16, 1, 1)))[0], strict=True))
    segments, places, depth = [], [], []

    def place(landmark: _Landmark, side: str) -> np.ndarray:
        local = np.array((landmark.x, landmark.y * SIDES.get(side, 1.0), landmark.z)) * _size(body, landmark)
        return local + np.mean([at[s] for s in _sided(landmark.joint, side)], axis=0)

    # Origin of Shelf's heads: half way between the shoulders and the ears.
    middle = np.mean([place(_BODY25[point], side) for side in SIDES for point in ("shoulder", "ear")], axis=0)
    for name in skeleton.joints:
        family, _, joint = name.rpartition(".")
        side, kind = side_and_name(joint)
        landmark = _PLACES.get(family or skeleton.name, _BODY25)[kind]
        counted = middle - at["head"] if kind in _HEAD_ENDS else 0.0
        places.append(place(landmark, side) + counted)
        segments.append(_sided(landmark.segment, side)[0])
        depth.append(_SKIN + landmark.radius * _size(body, landmark) * body.girth)
    points = np.array(places) - np.array([at[segment] for segment in segments])
    return np.array([SEGMENTS.index(segment) for segment in segments]), points, np.array(depth)


def _size(body: Body, landmark: _Landmark) -> float:
    return body.stature * (body.head if landmark.joint == "head" else 1.0)


def _sided(name: str, side: str) -> list[str]:
    """Return the segments for a name without its side: the one on `side` or the mid line; both if `side` is empty."""
    if name in SEGMENTS:
        return [name]
    return [f"{one}_{name}" for one in ([side] if side else SIDES)]
