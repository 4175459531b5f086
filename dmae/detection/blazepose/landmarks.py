"""Landmarks: the 33 joints of the person in a region, by BlazePose's second network."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from dmae.data.skeleton import BLAZEPOSE33
from dmae.detection.blazepose.models import Network
from dmae.detection.blazepose.regions import Region

_HIP, _TOP = 33, 34
"""Landmarks that are not joints: the middle of the hips, and a point on the circle around the body."""
TORSO = BLAZEPOSE33.index("l_shoulder", "r_shoulder", "l_hip", "r_hip")
_EXCHANGED = BLAZEPOSE33.index("r_shoulder", "l_shoulder", "r_hip", "l_hip")
LIMBS = [
    BLAZEPOSE33.index(*limb)
    for side in "lr"
    for limb in (
        (f"{side}_shoulder", f"{side}_elbow", f"{side}_wrist", f"{side}_index_finger"),
        (f"{side}_hip", f"{side}_knee", f"{side}_ankle", f"{side}_big_toe"),
    )
]
HEAD = BLAZEPOSE33.index("l_ear", "r_ear", "nose")
_LIMB_WIDTH, _HEAD_RADIUS = 0.35, 0.3
"""Width of the limbs and radius of the head that are painted over, relative to the size of the torso."""
_BLUR = 0.3
"""Side of the box over which colours are averaged for painting, relative to the image."""


@dataclass(frozen=True)
class Person:
    """The person in a region.

    Attributes:
        xy: (33, 2) px; pixel (0, 0) is the centre of the first pixel.
        visibility: (33,) logit that the joint is visible.
        inside: (33,) logit that the joint is in the image.
        presence: Probability that there is a person.
        region: The square around the landmarks, where the next image is searched. None if they give no region.
    """

    xy: np.ndarray
    visibility: np.ndarray
    inside: np.ndarray
    presence: float
    region: Region | None

    @property
    def torso_size(self) -> float:
        """Size of the torso, px: the larger of the mean length of its sides and its width at the shoulders."""
        l_shoulder, r_shoulder, l_hip, r_hip = self.xy[TORSO]
        sides = (np.hypot(*(l_shoulder - l_hip)) + np.hypot(*(r_shoulder - r_hip))) / 2
        return float(max(sides, np.hypot(*(l_shoulder - r_shoulder)), 1e-6))


def find_person(network: Network, pyramid: list[np.ndarray], region: Region, without: Sequence[Person] = ()) -> Person:
    """Return the person in a region. A person is always returned; `presence` is the probability that there is one.

    Args:
        network: BlazePose's second network.
        pyramid: The image (H, W, 3) uint8 and its smaller copies.
        region: Where to look.
        without: People that are painted over first.
    """
    pixels = painted_over(region.cut(pyramid, network.size), region, without).astype(np.float32) / 255
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
    """Return whether two detections show one person: their torsos are at one place, relative to their size.

    The sides do not matter, as a network may confuse left and right. Heads are not compared: where a window cuts a
    body, the network finds a smaller body with the same head.
    """
    return bool(min(_apart(a, b, TORSO), _apart(a, b, _EXCHANGED)) < nearness)


def disagreement(a: Person, b: Person) -> float:
    """Return the distance between the torsos of two detections of one person, relative to their size."""
    return _apart(a, b, TORSO)


def _apart(a: Person, b: Person, order: list[int]) -> float:
    distance = np.hypot(*(a.xy[TORSO] - b.xy[order]).T).mean()
    return float(distance / min(a.torso_size, b.torso_size))


def painted_over(pixels: np.ndarray, region: Region, people: Sequence[Person]) -> np.ndarray:
    """Return the (S, S, 3) uint8 cut-out of an image at a region, with people blurred beyond recognition."""
    if not people:
        return pixels
    size = len(pixels)
    mask = np.zeros(pixels.shape[:2], np.uint8)
    for person in people:
        at = np.round(np.clip(region.from_picture(person.xy + 0.5) * size, -8 * size, 8 * size)).astype(np.int32)
        torso = person.torso_size / region.side * size
        for limb in LIMBS:
            cv2.polylines(mask, [at[limb]], False, 255, max(round(_LIMB_WIDTH * torso), 1))
        cv2.fillConvexPoly(mask, cv2.convexHull(at[TORSO]), 255)
        head = tuple(np.round(at[HEAD].mean(0)).astype(int).tolist())
        cv2.circle(mask, head, max(round(_HEAD_RADIUS * torso), 1), 255, -1)
    # Colours are averaged over the pixels that are not painted over.
    width = max(round(_BLUR * size), 1)
    left = (mask == 0).astype(np.float32)
    weight = cv2.blur(left, (width, width))
    around = cv2.blur(pixels * left[..., None], (width, width)) / np.maximum(weight, 1e-3)[..., None]
    return np.where(mask[..., None] > 0, around.clip(0, 255).astype(np.uint8), pixels)
