"""Run a detector on crops of single people. Each crop is around the true position; no other information is given."""

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np

from dmae.data.clip import Clip, Detections2D
from dmae.data.conversion import convert_detections
from dmae.data.skeleton import BODY25
from dmae.detection.registry import PictureDetector
from synth.recognition.sightings import Sightings

UNOBSTRUCTED = 0.8
"""A person is in plain sight if at least this share of the joints is visible, or hidden only by the person's own
body."""
NEAR = 0.05
"""Greatest error of a joint that counts as near its true position, as a fraction of the height of the body."""
_MATCHED = 0.2
"""A detection belongs to the person if the median error of its visible joints is below this fraction of the height."""
SIDES = (1.3, 1.6, 2.0)
"""Sides of the crops, relative to the longer side of the box around the joints. Wider crops are tried if the person is
not found in narrower ones."""
_LEAST = 40
"""Least height of a person, px. Smaller people are left out."""
_BLACK = np.zeros((64, 64, 3), np.uint8)


@dataclass(frozen=True)
class Crop:
    """One person in one image.

    Attributes:
        frame, view, person: Indices in the clip.
        found: Whether the detector found the person.
        error: (25,) error of each joint, relative to the height; NaN where it was not reported.
        counted: (25,) True for visible joints that the detector's skeleton has.
        xy: (25, 2) detected joints, px of the whole image; NaN where not detected.
        corner: (x, y) corner of the crop in the image, px.
        side: Side of the crop, px.
        dark: Whether a dark body is in front of a dark background.
    """

    frame: int
    view: int
    person: int
    found: bool
    error: np.ndarray
    counted: np.ndarray
    xy: np.ndarray
    corner: tuple[int, int]
    side: int
    dark: bool

    @property
    def near(self) -> int:
        """The number of counted joints near their true positions."""
        with np.errstate(invalid="ignore"):
            return int((self.counted & (self.error < NEAR)).sum())


def crops(clip: Clip, seen: Sightings, detector: PictureDetector, every: int = 1) -> Iterator[Crop]:
    """Yield each person in plain sight.

    Args:
        clip: A clip with colour images.
        seen: `sightings` of the clip.
        detector: The detector. It gets a black image before each crop, so that it keeps no state of the previous one.
        every: Number of frames from one used frame to the next.

    Raises:
        ValueError: the clip has no colour images.
    """
    if clip.images is None or "rgb" not in clip.images.kinds:
        raise ValueError(f"clip {clip.id!r} has no colour images; make it with images=rgb")
    with np.errstate(invalid="ignore"):
        chosen = (seen.unobstructed.mean(-1) >= UNOBSTRUCTED) & (seen.height >= _LEAST)
    reported = np.isin(BODY25.joints, _reported(detector))
    for frame in range(0, len(clip), every):
        for view, name in enumerate(clip.rig.names):
            people = np.flatnonzero(chosen[frame, view])
            if len(people):
                picture = clip.images.at("rgb", name, frame)
            for person in people:
                visible = seen.visible[frame, view, person] & reported
                yield _crop(picture, seen, (frame, view, int(person)), detector, visible)


def cut(picture: np.ndarray, corner: tuple[int, int], side: int) -> np.ndarray:
    """Return a square crop (side, side, 3) of an image. It is black outside the image."""
    left, top = corner
    shift = np.array([[1.0, 0.0, left], [0.0, 1.0, top]])
    return cv2.warpAffine(picture, shift, (side, side), flags=cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP)


def _reported(detector: PictureDetector) -> list[str]:
    """Return the names of the joints of BODY25 that the detector's skeleton has."""
    skeleton = detector.skeleton
    shape = (1, 1, 1, len(skeleton))
    whole = convert_detections(Detections2D(skeleton, np.zeros((*shape, 2)), np.ones(shape)), BODY25)
    return [joint for joint, score in zip(BODY25.joints, whole.score.ravel(), strict=True) if not np.isnan(score)]


def _crop(
    picture: np.ndarray, seen: Sightings, place: tuple[int, int, int], detector: PictureDetector, counted: np.ndarray
) -> Crop:
    for wide in SIDES:
        crop = _looked_for(picture, seen, place, detector, counted, wide)
        if crop.found:
            break
    return crop


def _looked_for(
    picture: np.ndarray,
    seen: Sightings,
    place: tuple[int, int, int],
    detector: PictureDetector,
    counted: np.ndarray,
    wide: float,
) -> Crop:
    true, height = seen.xy[place], seen.height[place]
    low, high = np.nanmin(true, 0), np.nanmax(true, 0)
    side = max(round(wide * float((high - low).max())), _LEAST)
    corner = tuple(int(x) for x in np.round((low + high) / 2 - side / 2))
    square = cut(picture, corner, side)
    detector(_BLACK)
    xy, score = detector(square)
    shape = (1, 1, len(xy), len(detector.skeleton))
    found = Detections2D(detector.skeleton, np.reshape(xy, (*shape, 2)), np.reshape(score, shape))
    places = convert_detections(found, BODY25).xy[0, 0].astype(np.float64) + corner
    off = np.linalg.norm(places - true, axis=-1) / height
    medians = [np.nanmedian(each[counted]) if (~np.isnan(each[counted])).any() else np.inf for each in off]
    best = int(np.argmin(medians)) if medians else -1
    is_found = bool(medians and medians[best] < _MATCHED)
    absent = np.full(len(BODY25), np.nan)
    return Crop(
        *place,
        found=is_found,
        error=off[best] if is_found else absent,
        counted=counted,
        xy=places[best] if medians else np.stack([absent, absent], -1),
        corner=corner,
        side=side,
        dark=_is_dark(square, true - corner, counted, low - corner, high - corner),
    )


_BODY_DARK, _BEHIND_DARK = 70, 100
"""Greatest median brightness, 0 to 255, of a dark body and of a dark background."""


def _is_dark(square: np.ndarray, joints: np.ndarray, visible: np.ndarray, low: np.ndarray, high: np.ndarray) -> bool:
    """Return whether trunk and legs are dark, and the surroundings of the box around the joints are dark as well."""
    grey = square.mean(-1)
    trunk = BODY25.index("neck", "l_shoulder", "r_shoulder", "mid_hip", "l_hip", "r_hip", "l_knee", "r_knee")
    at = joints[[joint for joint in trunk if visible[joint]]]
    at = np.clip(np.round(at).astype(int), 0, len(grey) - 1)
    around = np.ones(grey.shape, bool)
    left, top = np.maximum(low - 0.1 * (high - low), 0).astype(int)
    right, bottom = np.ceil(high + 0.1 * (high - low)).astype(int)
    around[top:bottom, left:right] = False
    around &= square.any(-1)
    if not len(at) or not around.any():
        return False
    return bool(np.median(grey[at[:, 1], at[:, 0]]) < _BODY_DARK and np.median(grey[around]) < _BEHIND_DARK)
