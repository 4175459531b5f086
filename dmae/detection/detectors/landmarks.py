"""One person in a region of an image: BlazePose's networks, its 33 joints, and how far they can be trusted."""

import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cache
from itertools import pairwise
from math import floor, log2
from pathlib import Path

import cv2
import numpy as np

from dmae.data.skeleton import BLAZEPOSE33
from dmae.files.structured import read_json
from dmae.numerics.body import distance_to_bones

MODELS = Path(__file__).parents[2] / "models" / "blazepose"
"""Folder of the networks, which are part of the package."""


class Network:
    """A network of one input: images (S, S, 3) float32.

    Attributes:
        size: S, px.

    Raises:
        ValueError: the runtime `ai-edge-litert` is not installed.
    """

    def __init__(self, name: str):
        try:
            from ai_edge_litert.interpreter import Interpreter
        except ImportError:
            raise ValueError(
                "detector=blazepose needs the package ai-edge-litert, which is not installed: "
                "pip install ai-edge-litert"
            ) from None
        with _quiet():
            self._interpreter = Interpreter(model_path=str(MODELS / f"{name}.tflite"), num_threads=1)
            self._interpreter.allocate_tensors()
        (given,) = self._interpreter.get_input_details()
        self._input, self.size = given["index"], int(given["shape"][1])
        self._outputs = {each["name"]: each["index"] for each in self._interpreter.get_output_details()}

    def __call__(self, image: np.ndarray, *outputs: str) -> list[np.ndarray]:
        """Return the named outputs for an image (S, S, 3) float32."""
        self._interpreter.set_tensor(self._input, image[None])
        self._interpreter.invoke()
        return [self._interpreter.get_tensor(self._outputs[name])[0] for name in outputs]


@contextmanager
def _quiet() -> Iterator[None]:
    """Prevent the runtime from writing to the terminal; it bypasses `sys.stderr`."""
    try:
        target = sys.stderr.fileno()
    except (OSError, ValueError, AttributeError):
        yield
        return
    kept = os.dup(target)
    nowhere = os.open(os.devnull, os.O_WRONLY)
    try:
        sys.stderr.flush()
        os.dup2(nowhere, target)
        yield
    finally:
        os.dup2(kept, target)
        os.close(kept)
        os.close(nowhere)


# Regions of an image: rotated squares around a person

_MARGIN = 1.125
"""Side of a region, relative to the circle around the body. MediaPipe uses 1.25. In rendered views of people with
exact truth, 1.125 brings 2 to 6 % more of the visible joints within 5 % of the height."""
_LEVELS = 4  # Number of levels of a pyramid; each level has half the width and height of the previous one


@dataclass(frozen=True)
class Region:
    """A rotated square in an image."""

    centre: np.ndarray  # (2,) px, from the corner of the image (pixel + 0.5)
    side: float  # px
    up: np.ndarray  # (2,) unit vector in the image that points up in the square

    @classmethod
    def around(cls, hip: np.ndarray, top: np.ndarray) -> "Region | None":
        """Return the region of a body from the middle of its hips and a point on the circle around it, (2,) px each.

        None if the two points coincide or are not finite.
        """
        along = np.asarray(top, np.float64) - hip
        radius = float(np.hypot(*along))
        if not np.isfinite(radius) or radius < 1:
            return None
        return cls(np.asarray(hip, np.float64), 2 * radius * _MARGIN, along / radius)

    @classmethod
    def upright(cls, left: float, top: float, side: float) -> "Region":
        """Return a square that is not rotated."""
        return cls(np.array([left + side / 2, top + side / 2]), side, np.array([0.0, -1.0]))

    @property
    def radius(self) -> float:
        """Radius of the circle around the body, px."""
        return self.side / 2 / _MARGIN

    def to_image(self, points: np.ndarray) -> np.ndarray:
        """Return the places (..., 2) px in the image of points (..., 2) in the square, from 0 to 1."""
        return self.centre + (points - 0.5) * self.side @ self._axes

    def from_image(self, places: np.ndarray) -> np.ndarray:
        """Return the points (..., 2) in the square, from 0 to 1, of places (..., 2) px in the image."""
        return (places - self.centre) @ self._axes.T / self.side + 0.5

    @property
    def _axes(self) -> np.ndarray:
        """(2, 2) unit vectors in the image, as rows, that point right and down in the square."""
        x, y = self.up
        return np.array([[-y, x], [-x, -y]])

    def cut(self, pyramid: list[np.ndarray], size: int) -> np.ndarray:
        """Return the square (size, size, 3) of an image; black outside of the image.

        Args:
            pyramid: The image, and smaller copies of it, as `pyramid_of` returns them. Nothing is shrunk by more
                than 2 without averaging.
        """
        scale = self.side / size
        level = min(max(floor(log2(max(scale, 1e-3))), 0), len(pyramid) - 1)
        axes = self._axes.T * scale / 2**level
        corner = (self.to_image(np.zeros(2)) / 2**level + axes @ (0.5, 0.5)) - 0.5
        return cv2.warpAffine(
            pyramid[level], np.column_stack([axes, corner]), (size, size), flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        )


def pyramid_of(image: np.ndarray) -> list[np.ndarray]:
    """Return an image (H, W, 3) and copies of half, a quarter and an eighth of its size."""
    levels = [image]
    while len(levels) < _LEVELS and min(levels[-1].shape[:2]) >= 2:
        height, width = levels[-1].shape[:2]
        # An odd row or column at the end is left out, so that each pixel is the mean of four.
        even = levels[-1][: height // 2 * 2, : width // 2 * 2]
        levels.append(cv2.resize(even, (width // 2, height // 2), interpolation=cv2.INTER_AREA))
    return levels


# The 33 joints of the person in a region, by BlazePose's second network

_HIP, _TOP = 33, 34  # Landmarks that are not joints: the middle of the hips, and a point on the circle around the body
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
_SAME_TORSO = 0.4  # Distance of two torsos that are one, relative to their size
_BLUR = 0.3  # Side of the box over which colours are averaged for painting, relative to the image


@dataclass(frozen=True)
class Person:
    """The person in a region."""

    xy: np.ndarray  # (33, 2) px; pixel (0, 0) is the centre of the first pixel
    visibility: np.ndarray  # (33,) logit that the joint is visible
    inside: np.ndarray  # (33,) logit that the joint is in the image
    presence: float  # Probability that there is a person
    # The square around the landmarks, where the next image is searched. None if they give no region.
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
    places = region.to_image(values[:, :2] / network.size)
    joints = slice(len(BLAZEPOSE33))
    return Person(
        places[joints] - 0.5,
        values[joints, 3],
        values[joints, 4],
        float(presence[0]),
        Region.around(places[_HIP], places[_TOP]),
    )


def same_torso(a: Person, b: Person) -> bool:
    """Return whether two detections show one person: their torsos are at one place, relative to their size.

    The sides do not matter, as a network may confuse left and right. Heads are not compared: where a window cuts a
    body, the network finds a smaller body with the same head.
    """
    return bool(min(_apart(a, b, TORSO), _apart(a, b, _EXCHANGED)) < _SAME_TORSO)


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
        at = np.round(np.clip(region.from_image(person.xy + 0.5) * size, -8 * size, 8 * size)).astype(np.int32)
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


# Shoulders and hips as other detectors place them: BlazePose's are lower, and its hips closer together

_SHOULDERS_UP, _HIPS_UP, _HIPS_OUT = 0.02, 0.05, 0.02
"""Shifts along the torso, relative to its length, and of each hip away from the other, relative to their distance.

Fitted to the true joints of 3,300 rendered people in four data sets, which gave 0.02 to 0.05 for the hips, 0.02 to 0.03
for the shoulders. In the videos of Pose2Sim, BlazePose's hips are 0.05 lower than OpenPose's."""


def corrected_torso(xy: np.ndarray) -> np.ndarray:
    """Return landmarks (..., 33, 2) px with shoulders and hips at the joints of BODY_25 and COCO."""
    l_shoulder, r_shoulder, l_hip, r_hip = np.moveaxis(xy[..., TORSO, :], -2, 0)
    up, left = (l_shoulder + r_shoulder - l_hip - r_hip) / 2, l_hip - r_hip
    shift = [_SHOULDERS_UP * up] * 2 + [_HIPS_UP * up + _HIPS_OUT * left, _HIPS_UP * up - _HIPS_OUT * left]
    moved = xy.copy()
    moved[..., TORSO, :] += np.stack(shift, -2)
    return moved


# Confidence: the probability that a joint was found near its true place (`docs/tools/fit_confidence.py` fits it)

GROUPS = {
    "face": ("nose", "eye", "eye_inner", "eye_outer", "mouth"),
    "ear": ("ear",),
    "shoulder": ("shoulder",),
    "elbow": ("elbow",),
    "hand": ("wrist", "little_finger", "index_finger", "thumb"),
    "hip": ("hip",),
    "knee": ("knee",),
    "ankle": ("ankle",),
    "foot": ("heel", "big_toe"),
}
"""Kinds of joints that share a fit."""


def confidence(person: Person) -> np.ndarray:
    """Return (33,) probabilities that joints are within 5 % of the height of the body from their true places."""
    logits = (_weights() * features(person)).sum(-1)
    return 1 / (1 + np.exp(-np.clip(logits, -30, 30)))


def clearness(person: Person) -> float:
    """Return the mean confidence of the joints of a person, from 0 to 1."""
    return float(confidence(person).mean())


def features(person: Person) -> np.ndarray:
    """Return (33, 3) features: 1 and the two logits, clipped where larger values add no information."""
    logits = np.clip(np.stack([person.visibility, person.inside], -1), -8, 8)
    return np.concatenate([np.ones((len(logits), 1)), logits], -1)


def members() -> dict[str, list[int]]:
    kinds = [joint.removeprefix("l_").removeprefix("r_") for joint in BLAZEPOSE33.joints]
    return {group: [i for i, kind in enumerate(kinds) if kind in names] for group, names in GROUPS.items()}


@cache
def _weights() -> np.ndarray:
    fitted, weights = read_json(MODELS / "confidence.json"), np.empty((len(BLAZEPOSE33), 3))
    for group, index in members().items():
        weights[index] = fitted[group]["weights"]
    return weights


# Parts of bodies that are mistaken for people: limbs, and heads with a body that is too small

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
