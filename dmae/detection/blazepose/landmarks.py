"""Landmarks: the 33 joints of the person in a region, by BlazePose's second network."""

from dataclasses import dataclass

import numpy as np

from dmae.data.skeleton import BLAZEPOSE33
from dmae.detection.blazepose.models import Network
from dmae.detection.blazepose.regions import Region

_HIP, _TOP = 33, 34
"""Landmarks that are no joints: the middle of the hips, and a point on the circle around the body."""
TORSO = BLAZEPOSE33.index("l_shoulder", "r_shoulder", "l_hip", "r_hip")


@dataclass(frozen=True)
class Person:
    """The person in a region.

    Attributes:
        xy: (33, 2) px; pixel (0, 0) is the centre of the first pixel.
        visibility: (33,) logit that the joint is in sight.
        inside: (33,) logit that the joint is in the picture.
        presence: Probability that there is a person.
        region: Around the landmarks; where to look in the next picture. None where they give no region.
    """

    xy: np.ndarray
    visibility: np.ndarray
    inside: np.ndarray
    presence: float
    region: Region | None

    @property
    def torso_size(self) -> float:
        """Larger of the mean length of the sides of the torso and its width at the shoulders, px."""
        l_shoulder, r_shoulder, l_hip, r_hip = self.xy[TORSO]
        sides = (np.hypot(*(l_shoulder - l_hip)) + np.hypot(*(r_shoulder - r_hip))) / 2
        return float(max(sides, np.hypot(*(l_shoulder - r_shoulder)), 1e-6))


def find_person(network: Network, pyramid: list[np.ndarray], region: Region) -> Person:
    """Return the person in a region, whether there is one or not: look at `presence`.

    Args:
        network: BlazePose's second network.
        pyramid: The picture (H, W, 3) uint8 and its smaller copies.
        region: Where to look.
    """
    pixels = region.cut(pyramid, network.size).astype(np.float32) / 255
    values, presence = network(pixels, "Identity", "Identity_1")
    values = values.reshape(-1, 5).astype(np.float64)
    places = region.to_picture(values[:, :2] / network.size)
    joints = slice(len(BLAZEPOSE33))
    return Person(
        places[joints] - 0.5,
        values[joints, 3],
        values[joints, 4],
        float(presence[0]),
        Region.around(places[_HIP], places[_TOP]),
    )


def same_torso(a: Person, b: Person, nearness: float = 0.4) -> bool:
    """Return whether two persons are one: their torsos lie at one place, relative to their size.

    Heads would not do: where a window cuts a body, a smaller body with the same head is found.
    """
    distance = np.hypot(*(a.xy[TORSO] - b.xy[TORSO]).T).mean()
    return bool(distance < nearness * min(a.torso_size, b.torso_size))
