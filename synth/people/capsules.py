"""The solid parts of a body: capsules with mass and contacts, beneath the visible surfaces."""

import numpy as np

from synth.people.body import FOREARM_LENGTH, SIDES, THIGH_LENGTH, UPPER_ARM_LENGTH, Body, side_and_name
from synth.people.segments import SEGMENTS
from synth.people.shape import trunk_sections

# Capsules across the trunk: height above the hips, as in `trunk_sections`, and the share of the depth there that the
# capsule fills; it is as wide as the trunk.
_ACROSS = {"pelvis": [(0.0, 1.0)], "spine": [(0.105, 1.0)], "chest": [(0.21, 1.0), (0.283, 0.75)]}
# Segment: (from, to, radius) in fractions of stature; left side. Radii widen with the body's girth.
_CAPSULES = {
    "head": [((0, 0, 0), (0.010, 0, 0.050), 0.031), ((0.008, 0, 0.075), (0.004, 0, 0.100), 0.052)],
    "upper_arm": [((0, 0, 0), (0, UPPER_ARM_LENGTH, 0), 0.028)],
    "forearm": [((0, 0, 0), (0, FOREARM_LENGTH, 0), 0.021)],
    "hand": [((0, 0.008, 0), (0, 0.085, -0.004), 0.013)],
    "thigh": [((0, 0, -0.020), (0, 0, -THIGH_LENGTH), 0.041)],
    "shin": [((0, 0, 0), (0, 0, -0.235), 0.028)],
    "foot": [
        ((-0.022, -0.008, -0.021), (0.092, -0.012, -0.021), 0.018),
        ((-0.022, 0.008, -0.021), (0.080, 0.014, -0.021), 0.018),
    ],
}
_FIST = ((0, 0.008, 0), (0, 0.050, -0.008), 0.021)
"""The capsule of a hand that is closed to a fist."""
_STOUT = ("upper_arm", "forearm", "thigh", "shin")
_SKULL = ("head", 1)
"""The capsule that scales with the head; the one before it is the neck."""


def capsules(body: Body, hands: tuple[str, str] = ("relaxed", "relaxed")) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the solid parts of a body.

    Args:
        body: Proportions.
        hands: Shapes of the left and the right hand, of `synth.people.clothing.HANDS`; a fist is shorter.

    Returns:
        segments: (C,) index into `SEGMENTS`.
        ends: (C, 2, 3) both ends of each capsule's axis in its segment's frame, m.
        radii: (C,) m.
    """
    segments, ends, radii = [], [], []
    origins = np.cumsum(body.offsets[:3], axis=0)
    for i, segment in enumerate(SEGMENTS):
        side, name = side_and_name(segment)
        for height, share in _ACROSS.get(name, ()):
            ahead, up, depth, breadth = trunk_sections(body, np.array([height]))[0]
            aside = np.array((0, breadth - share * depth, 0))
            segments.append(i)
            ends.append(np.array((ahead, 0, up)) - origins[i] + np.array((-aside, aside)))
            radii.append(share * depth)
        stretch = np.full(3, body.stature)
        if name in ("upper_arm", "forearm", "hand"):
            stretch[1] *= body.arms
        elif name in ("thigh", "shin"):
            stretch[2] *= body.leg
        elif name == "head":
            stretch *= body.head
        stretch[1] *= SIDES.get(side, 1.0)
        solids = _CAPSULES.get(name, ())
        if name == "hand" and hands["lr".index(side)] == "fist":
            solids = [_FIST]
        for number, (start, stop, radius) in enumerate(solids):
            segments.append(i)
            ends.append(np.array((start, stop)) * stretch)
            wide = body.girth if name in _STOUT else body.head if (name, number) == _SKULL else 1.0
            radii.append(radius * body.stature * wide)
    return np.array(segments), np.array(ends), np.array(radii)


def capsule_names() -> list[str]:
    """Return the names of the capsules, in the order of `capsules`."""
    count = {name: len(solids) for name, solids in (_ACROSS | _CAPSULES).items()}
    return [f"{segment}/solid{i}" for segment in SEGMENTS for i in range(count[side_and_name(segment)[1]])]
