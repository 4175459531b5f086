"""A person that is expected at a place in an image, as other cameras see it."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dmae.data.skeleton import BLAZEPOSE33
from dmae.detection.blazepose.confidence import clearness
from dmae.detection.blazepose.landmarks import Person, find_person
from dmae.detection.blazepose.models import Network
from dmae.detection.blazepose.regions import Region
from dmae.detection.projected_people import body_radius

_HIPS, _SHOULDERS = BLAZEPOSE33.index("l_hip", "r_hip"), BLAZEPOSE33.index("l_shoulder", "r_shoulder")
_LARGER = 1.05
"""Radius of the region, relative to the largest distance of an expected joint from the hips. It leaves room for the
top of the head, which is not a joint."""
_SIDES = (1.0, 1.15, 1.3, 0.87)
"""Sides of the regions that are tried, relative to the region of the expected joints. Which region the network needs
depends on hair, clothes and what else is near."""
_CLEAR = 0.3
"""Smallest mean confidence of the joints."""
_NEAR, _OTHER = 0.12, 0.15
"""Largest median distance of the joints from the expected places, and smallest one from those of another person,
relative to the radius. In rendered views, 391 results were this near; their largest median error was 0.11 of the
person's height."""
_SURE = 0.08
"""No other region is tried after a result this near."""


def find_expected(
    network: Network, pyramid: list[np.ndarray], expected: np.ndarray, known: Sequence[np.ndarray], min_presence: float
) -> Person | None:
    """Return the person at an expected place; None if the network finds no one there, or a known person.

    Of several regions around the place, that with the result nearest to the expected joints counts. If all fail, they
    are tried again with the known people painted over.

    Args:
        network: BlazePose's second network.
        pyramid: The image and its smaller copies.
        expected: (33, 2) px; NaN where unknown.
        known: Of each known person (33, 2) px; NaN where absent.
        min_presence: Smallest probability of a person.
    """
    hip, shoulder = expected[_HIPS].mean(0), expected[_SHOULDERS].mean(0)
    radius = _LARGER * float(body_radius(expected, BLAZEPOSE33))
    along = shoulder - hip
    region = Region.around(hip + 0.5, hip + 0.5 + radius * along / max(float(np.hypot(*along)), 1e-6))
    if region is None:
        return None
    others = [_painted(xy) for xy in known]
    for without in ((), others) if others else ((),):
        best, nearest = None, _NEAR * radius
        for side in _SIDES:
            person = find_person(network, pyramid, replace(region, side=side * region.side), without)
            apart = _apart(person.xy, expected)
            if (
                apart < nearest
                and person.presence >= min_presence
                and clearness(person) >= _CLEAR
                and all(_apart(person.xy, xy) > _OTHER * radius for xy in known)
            ):
                best, nearest = person, apart
                if apart < _SURE * radius:
                    break
        if best is not None:
            return best
    return None


def _apart(a: np.ndarray, b: np.ndarray) -> float:
    """Return the median distance between joints of two people, px; infinite if they have none in common."""
    distance = np.linalg.norm(a - b, axis=-1)
    return float(np.nanmedian(distance)) if np.isfinite(distance).any() else np.inf


def _painted(xy: np.ndarray) -> Person:
    """Return a known person as it is painted over: absent joints are put in its middle."""
    nothing = np.zeros(len(xy))
    return Person(np.where(np.isnan(xy), np.nanmean(xy, 0), xy), nothing, nothing, 1.0, None)
