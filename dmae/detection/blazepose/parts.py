"""Parts of bodies that are mistaken for people: limbs, and heads with a body that is too small."""

from dataclasses import replace
from itertools import pairwise

import numpy as np

from dmae.data.skeleton import BLAZEPOSE33
from dmae.detection.blazepose.confidence import clearness
from dmae.detection.blazepose.landmarks import HEAD, LIMBS, Person
from dmae.detection.blazepose.regions import Region
from dmae.numerics.body import distance_to_bones

_SAME_HEAD, _SMALLER = 0.25, 0.75
"""Distance of two heads that are one, and size of a torso that is part of another body, relative to its torso."""
_BONES = [bone for limb in LIMBS for bone in pairwise(limb)]
_ON_LIMBS, _MOST_JOINTS = 0.2, 0.9
"""A body is made of the limbs of a larger one if this share of its joints is within this distance from their bones,
relative to the larger torso. In rendered views, the distance was at most 0.16 for such bodies and at least 0.25 for
people."""
_EYES, _MOUTH = BLAZEPOSE33.index("l_eye", "r_eye"), BLAZEPOSE33.index("l_mouth", "r_mouth")
_FACE, _LARGE_FACE = 0.14, 0.18
"""Distance from the eyes to the mouth, relative to the size of the torso: its median for people in rendered views, and
the value above which the body is examined."""


def part_of(a: Person, b: Person) -> bool:
    """Return whether a person is a part of a larger one: it has the same head, or is made of the other's limbs.

    Two people do not share a head. All joints of a person are on the limbs of another only if it is hidden behind them,
    or if it is small and in front of them. In the latter case, it is clearer than the other.
    """
    if a.torso_size >= _SMALLER * b.torso_size:
        return False
    apart = np.hypot(*(a.xy[HEAD].mean(0) - b.xy[HEAD].mean(0)))
    if apart < _SAME_HEAD * b.torso_size:
        return True
    near = distance_to_bones(a.xy, b.xy, _BONES) < _ON_LIMBS * b.torso_size
    return bool(near.mean() >= _MOST_JOINTS and clearness(a) < clearness(b))


def larger_region(person: Person) -> Region | None:
    """Return the region of a body that fits the head of a person; None if the head is not too large for the body."""
    face = np.hypot(*(person.xy[_EYES].mean(0) - person.xy[_MOUTH].mean(0))) / person.torso_size
    if person.region is None or not face > _LARGE_FACE:
        return None
    head, growth = person.xy[HEAD].mean(0) + 0.5, face / _FACE
    centre = head + growth * (person.region.centre - head)
    return replace(person.region, centre=centre, side=growth * person.region.side)
