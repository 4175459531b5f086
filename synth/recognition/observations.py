"""The result of a detector for each true joint and person of a clip: error, miss, confidence, and occluder."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from dmae.data.clip import Clip
from dmae.data.conversion import convert, convert_detections
from dmae.data.labels import Visibility
from dmae.data.skeleton import BODY25
from synth.detector.matching import FRAGMENT, match_detections
from synth.detector.statistics import GROSS
from synth.recognition.sightings import Sightings, sightings

_IN_IMAGE = Visibility.HIDDEN_BY_OBJECT
_MIRROR = list(BODY25.mirror)


@dataclass(frozen=True)
class JointsSeen:
    """The n joints in the images that belong to people found by a detector.

    Attributes:
        joint: (n,) index into BODY25.
        cause: (n,) `Visibility`.
        margin: (n,) distance in depth from the occluder to the joint, m; NaN where the joint is visible.
        size: (n,) height that the body would have if it stood upright at its distance, px.
        crowding: (n,) distance in the image from the hips to the hips of the nearest other person, in heights.
        direction: (n,) text from `Sightings.direction`.
        error: (n,) distance from the true position, in heights; NaN where the joint was missed.
        score: (n,) confidence; NaN where missed.
        inverted: (n,) True where the same joint of the other side is nearer, by half and by `GROSS`.
    """

    joint: np.ndarray
    cause: np.ndarray
    margin: np.ndarray
    size: np.ndarray
    crowding: np.ndarray
    direction: np.ndarray
    error: np.ndarray
    score: np.ndarray
    inverted: np.ndarray

    @property
    def missed(self) -> np.ndarray:
        """(n,) True where the joint was not detected."""
        return np.isnan(self.score)

    def __getitem__(self, some: np.ndarray) -> "JointsSeen":
        return JointsSeen(**{field.name: getattr(self, field.name)[some] for field in fields(self)})


@dataclass(frozen=True)
class PeopleSeen:
    """The n people in the images.

    Attributes:
        hidden: (n, 25) True for joints that are hidden or outside the image.
        visible: (n,) share of the joints that are visible.
        unobstructed: (n,) share of the joints that are visible or hidden only by the person's own body.
        size, crowding, direction: The same as in `JointsSeen`.
        found: (n,) True if a detection belongs to the person.
    """

    hidden: np.ndarray
    visible: np.ndarray
    unobstructed: np.ndarray
    size: np.ndarray
    crowding: np.ndarray
    direction: np.ndarray
    found: np.ndarray


@dataclass(frozen=True)
class DetectorObservations:
    """The results of a detector on some clips.

    Attributes:
        joints: Joints of people that were found.
        people: All people in the images.
        pictures: Number of images.
        ghosts: Number of detections far from every person.
        duplicates: Number of further detections near a person.
    """

    joints: JointsSeen
    people: PeopleSeen
    pictures: int
    ghosts: int
    duplicates: int


def observe(clip: Clip) -> DetectorObservations:
    """Compare the detections of a clip with its truth.

    Raises:
        ValueError: the clip has no truth or no visibility labels, or its detections have an unsuitable skeleton.
    """
    seen = sightings(clip)
    body = convert_detections(clip.detections, BODY25)
    true = replace(clip, rig=clip.true_rig or clip.rig, detections=body, poses=None, detection_labels=None)
    match = match_detections(true, convert(clip.truth, BODY25))
    # Joints that the detector's skeleton lacks, for example small toes, do not count as misses.
    reported = (~np.isnan(match.score)).any((0, 1, 2))
    counted = match.matched[..., None] & (seen.visibility <= _IN_IMAGE) & reported
    height = seen.height[..., None]
    error = np.linalg.norm(match.found - seen.xy, axis=-1) / height
    across = np.linalg.norm(match.found - seen.xy[..., _MIRROR, :], axis=-1) / height
    sided = np.array(_MIRROR) != np.arange(len(BODY25))
    with np.errstate(invalid="ignore"):
        inverted = (error > GROSS) & (across < error / 2) & sided

    def of_joints(values: np.ndarray) -> np.ndarray:
        return np.broadcast_to(values, counted.shape)[counted]

    there = ~np.isnan(match.height)
    joints = JointsSeen(
        joint=of_joints(np.arange(len(BODY25))),
        cause=seen.visibility[counted],
        margin=seen.depth_margin[counted],
        size=of_joints(height),
        crowding=of_joints(seen.crowding[..., None]),
        direction=of_joints(seen.direction[..., None]),
        error=error[counted],
        score=match.score[counted],
        inverted=inverted[counted],
    )
    people = PeopleSeen(
        hidden=~seen.visible[there],
        visible=seen.visible.mean(-1)[there],
        unobstructed=seen.unobstructed.mean(-1)[there],
        size=seen.height[there],
        crowding=seen.crowding[there],
        direction=seen.direction[there],
        found=match.matched[there],
    )
    ghosts = match.left_over & ~match.near & ~_is_cut(body.xy, seen)
    return DetectorObservations(
        joints, people, len(clip) * len(clip.rig), int(ghosts.sum()), int((match.left_over & match.near).sum())
    )


def _is_cut(xy: np.ndarray, seen: Sightings) -> np.ndarray:
    """Return (F, V, D) True for detections of people that are mostly outside the image. `Match` leaves these out."""
    off = np.linalg.norm(seen.xy[:, :, None] - xy[:, :, :, None], axis=-1) / seen.height[:, :, None, :, None]
    known = ~np.isnan(off)
    middle = np.nanmedian(np.where(known.any(-1, keepdims=True), off, np.inf), -1)
    return (middle < FRAGMENT).any(-1)


def pooled(parts: Sequence[DetectorObservations]) -> DetectorObservations:
    """Return the observations of several clips as one."""

    def together(name: str):
        each = [getattr(part, name) for part in parts]
        return type(each[0])(
            **{field.name: np.concatenate([getattr(one, field.name) for one in each]) for field in fields(each[0])}
        )

    counts = {name: sum(getattr(part, name) for part in parts) for name in ("pictures", "ghosts", "duplicates")}
    return DetectorObservations(together("joints"), together("people"), **counts)
