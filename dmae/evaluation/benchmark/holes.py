"""Holes: the joints on which methods are scored, with length, cause and body part. No method can change them."""

from dataclasses import dataclass, replace

import numpy as np

from dmae.data.clip import Clip, Poses3D
from dmae.data.conversion import convert
from dmae.data.labels import OcclusionLabels
from dmae.data.skeleton import Skeleton
from dmae.evaluation.benchmark.causes import ENOUGH_VIEWS, causes
from dmae.metrics.comparison import GAP_RATE
from dmae.metrics.matching import match, take_matched
from dmae.metrics.position_error import GAPS
from dmae.numerics.paths import gap_lengths, neighbours

PARTS = {
    "head": ("nose", "eye", "eye_inner", "eye_outer", "ear", "mouth", "head", "head_top", "top_head", "bottom_head"),
    "trunk": ("neck", "shoulder", "mid_hip", "hip"),
    "arm": ("elbow", "wrist", "little_finger", "index_finger", "thumb"),
    "leg": ("knee", "ankle"),
    "foot": ("big_toe", "small_toe", "heel"),
}
"""Body parts, and the names of their joints without the side."""


@dataclass(frozen=True)
class Holes:
    """The holes of a clip, in the order of its T true persons and on one skeleton of J joints.

    Attributes:
        truth: True poses, (F, T, J).
        hidden: (F, T, J) True for joints that count as holes.
        length: (F, T, J) index of `dmae.metrics.position_error.GAPS`, the class of the length of the hole.
        cause: (F, T, J) `Cause`; -1 outside holes.
        part: (J,) index of `PARTS`.
        matches: (F, T) index of the captured person that matches each true person, -1 for none. Only for holes of
            capture.
    """

    truth: Poses3D
    hidden: np.ndarray
    length: np.ndarray
    cause: np.ndarray
    part: np.ndarray
    matches: np.ndarray | None = None


def holes_of_capture(clip: Clip, captured: Poses3D) -> Holes:
    """Return the joints of captured persons that capture did not measure.

    Args:
        clip: Clip with truth and occlusion labels.
        captured: Captured poses of the clip, not filled. `dmae.metrics.matching.match` matches them with true persons.
            In a time without a match, a true person keeps its captured person if that is the same before and after.
            Persons that were not captured have no holes.
    """
    truth, occlusion = labels_on(clip, captured.skeleton)
    matches = _bridged(match(captured.xyz, truth.xyz))
    known = ~np.isnan(truth.xyz).any(-1)
    measured = take_matched(captured.measured, matches, False)
    holes = _holes(truth, occlusion, known & ~measured, clip.fps)
    return replace(holes, hidden=holes.hidden & (matches >= 0)[..., None], matches=matches)


def holes_of_sight(clip: Clip, skeleton: Skeleton) -> Holes:
    """Return the true joints that fewer than `ENOUGH_VIEWS` cameras saw. They do not depend on any capture."""
    truth, occlusion = labels_on(clip, skeleton)
    known = ~np.isnan(truth.xyz).any(-1)
    return _holes(truth, occlusion, known & (occlusion.visible_views < ENOUGH_VIEWS), clip.fps)


def labels_on(clip: Clip, skeleton: Skeleton) -> tuple[Poses3D, OcclusionLabels]:
    """Return the truth of a clip and its labels on one of the skeletons of its truth.

    Raises:
        ValueError: the clip has no truth or no labels on this skeleton.
    """
    if clip.truth is None or clip.occlusion is None:
        raise ValueError(f"clip {clip.id!r}: expected truth and labels of occlusion, as simulated clips have")
    own = clip.truth.skeleton
    if skeleton not in own.parts:
        raise ValueError(f"clip {clip.id!r}: its truth is on {own.name!r}, which does not hold {skeleton.name!r}")
    names = skeleton.joints if own == skeleton else [f"{skeleton.name}.{joint}" for joint in skeleton.joints]
    visibility = clip.occlusion.visibility[..., own.index(*names)]
    return convert(clip.truth, skeleton), OcclusionLabels(visibility)


def part_of(joint: str) -> int:
    """Return the index in `PARTS` of a joint.

    Raises:
        KeyError: no part contains the joint.
    """
    bare = joint.removeprefix("l_").removeprefix("r_")
    for number, joints in enumerate(PARTS.values()):
        if bare in joints:
            return number
    raise KeyError(f"joint {joint!r} belongs to no body part; expected one of {PARTS}")


def _holes(truth: Poses3D, occlusion: OcclusionLabels, hidden: np.ndarray, fps: float) -> Holes:
    frames = np.ceil(gap_lengths(~hidden) * (GAP_RATE / fps) - 1e-6)
    length = np.searchsorted([low for low, _ in GAPS], frames, side="right") - 1
    part = np.array([part_of(joint) for joint in truth.skeleton.joints])
    return Holes(truth, hidden, np.maximum(length, 0), causes(occlusion, hidden), part)


def _bridged(matches: np.ndarray) -> np.ndarray:
    """Return matches (F, T) in which a person keeps its track through frames without a match."""
    before, after = neighbours(matches >= 0)
    person = np.arange(matches.shape[1])
    inside = (before >= 0) & (after < len(matches))
    last = matches[np.maximum(before, 0), person]
    same = inside & (last == matches[np.minimum(after, len(matches) - 1), person])
    bridged = np.where(same, last, matches)
    # If another person has the track in the meantime, it does not belong to this person.
    taken = (bridged[:, :, None] == matches[:, None]).any(-1)
    return np.where((matches < 0) & taken, -1, bridged)
