"""Holes: the joints on which methods are scored, by cause, length and body part, and the sums of errors in them.

A hole is a joint of a person in a frame in which it was not measured, or not seen; holes in a row are a gap. No method
can change them.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from enum import IntEnum
from functools import partial

import numpy as np

from dmae.data.array_fields import UNSET
from dmae.data.clip import Clip, Poses3D
from dmae.data.conversion import convert
from dmae.data.labels import OcclusionLabels, Visibility
from dmae.data.skeleton import Skeleton
from dmae.metrics.angles import JUDGED, SHOWN_BY, angle_errors, in_interval
from dmae.metrics.comparison import Comparison, gap_frames, match, take_matched
from dmae.metrics.pcp import correct_limbs
from dmae.metrics.position import GAP_NAMES, GAPS, in_region
from dmae.numerics.paths import neighbours

ENOUGH_VIEWS = 2
"""Smallest number of views that must see a joint to triangulate it."""


class Cause(IntEnum):
    """Reason why cameras did not see or measure a joint, see `causes`."""

    thing = 0
    """Furniture, walls, carried objects."""
    person = 1
    """Other people."""
    edge = 2
    """The joint is outside the image, or behind the camera."""
    self = 3
    """The person's own body: fewer than two cameras would see the joint if nothing else were there."""
    burst = 4
    """Nothing: two cameras or more saw the joint, and yet it was not measured. The detector missed it in a burst, or
    capture rejected what was detected."""


_CODES = {
    Cause.thing: (Visibility.HIDDEN_BY_OBJECT,),
    Cause.person: (Visibility.HIDDEN_BY_PERSON,),
    Cause.edge: (Visibility.OUTSIDE_IMAGE, Visibility.BEHIND_CAMERA),
}
"""The causes that a gap can have in rule 3 of `causes`, with their labels. In a tie the first one wins."""


def causes(occlusion: OcclusionLabels, hidden: np.ndarray) -> np.ndarray:
    """Return the cause of the gap of each hidden joint, (F, T, J) `Cause`, -1 where not `hidden` (F, T, J).

    A gap is a run of frames in which one joint of one person is hidden. Its cause is

    1. `burst` if in more than half of its frames `ENOUGH_VIEWS` cameras or more saw the joint; else
    2. `self` if in more than half of its frames fewer than `ENOUGH_VIEWS` cameras would see the joint if only the
       person's own body could hide it; else
    3. the one of `thing`, `person` and `edge` that hides the joint most often, counted over the frames and cameras of
       the gap.

    Raises ValueError if labels and `hidden` differ in shape.
    """
    visibility = occlusion.visibility
    if (len(visibility), *visibility.shape[2:]) != hidden.shape:
        raise ValueError(f"labels of {visibility.shape} (F, V, T, J) do not fit holes of {hidden.shape} (F, T, J)")
    # With time as the last axis, the frames of a gap are next to each other.
    hidden = np.moveaxis(hidden, 0, -1)
    starts = hidden & ~np.concatenate([np.zeros_like(hidden[..., :1]), hidden[..., :-1]], -1)
    gap = (np.cumsum(starts) - 1)[hidden.ravel()]
    number = int(starts.sum())

    def per_gap(counted: np.ndarray) -> np.ndarray:
        return np.bincount(gap, np.moveaxis(counted, 0, -1)[hidden].astype(float), minlength=number)

    def mostly(views: np.ndarray) -> np.ndarray:
        return per_gap(views >= ENOUGH_VIEWS) > np.bincount(gap, minlength=number) / 2

    votes = np.stack([per_gap(np.isin(visibility, codes).sum(1)) for codes in _CODES.values()])
    by_others = sum(np.isin(visibility, codes).sum(1) for codes in _CODES.values())
    seen, seen_alone = mostly(occlusion.visible_views), mostly(occlusion.visible_views + by_others)
    of_gap = np.where(seen, Cause.burst, np.where(seen_alone, votes.argmax(0), Cause.self))
    found = np.full(hidden.shape, -1, np.int8)
    found[hidden] = of_gap[gap]
    return np.moveaxis(found, -1, 0)


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
    """The holes of a clip, in the order of its T true persons and on one skeleton of J joints."""

    truth: Poses3D  # True poses, (F, T, J)
    hidden: np.ndarray  # (F, T, J) True for joints that count as holes
    length: np.ndarray  # (F, T, J) index of `dmae.metrics.position.GAPS`, the class of the length of the hole
    cause: np.ndarray  # (F, T, J) `Cause`; -1 outside holes
    part: np.ndarray  # (J,) index of `PARTS`
    # (F, T) index of the captured person that matches each true person, -1 for none. Only for holes of capture.
    matches: np.ndarray = UNSET


def holes_of_capture(clip: Clip, captured: Poses3D) -> Holes:
    """Return the joints of captured persons, not filled, that capture did not measure, on a clip with occlusion labels.

    `dmae.metrics.comparison.match` assigns captured to true people. In a time without a match, a true person keeps its
    captured person if that is the same before and after. Persons that were not captured have no holes.
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
    """Return a clip's truth and labels on a skeleton of its truth; ValueError if it has none."""
    if clip.truth is None or clip.occlusion is None:
        raise ValueError(f"clip {clip.id!r}: expected truth and labels of occlusion, as simulated clips have")
    own = clip.truth.skeleton
    if skeleton not in own.parts:
        raise ValueError(f"clip {clip.id!r}: its truth is on {own.name!r}, which does not hold {skeleton.name!r}")
    names = skeleton.joints if own == skeleton else [f"{skeleton.name}.{joint}" for joint in skeleton.joints]
    visibility = clip.occlusion.visibility[..., own.index(*names)]
    return convert(clip.truth, skeleton), OcclusionLabels(visibility)


def part_of(joint: str) -> int:
    """Return the index in `PARTS` of a joint; KeyError if no part contains it."""
    bare = joint.removeprefix("l_").removeprefix("r_")
    for number, joints in enumerate(PARTS.values()):
        if bare in joints:
            return number
    raise KeyError(f"joint {joint!r} belongs to no body part; expected one of {PARTS}")


def _holes(truth: Poses3D, occlusion: OcclusionLabels, hidden: np.ndarray, fps: float) -> Holes:
    length = np.searchsorted([low for low, _ in GAPS], gap_frames(~hidden, fps), side="right") - 1
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


AXES = {
    "cause": [cause.name for cause in Cause],
    "frames": GAP_NAMES,
    "part": list(PARTS),
}
"""The axes of cells and their classes; `frames` is the length of a hole in frames at 25/s."""
SHAPE = tuple(len(classes) for classes in AXES.values())
NEAR = 0.1
"""m; a joint that is within this distance of the truth counts as near."""


def completion_cells(holes: Holes, given: Poses3D, linear: Poses3D, poses: Poses3D) -> dict:
    """Return the scores of completed poses on the holes of the captured poses `given`, which `linear` fills linearly.

    Only the holes that linear filling fills are counted: the person stays or returns within a second, and the joint was
    measured before and after the hole, or within half a second. If a method does not fill such a hole, it gets the
    error of linear filling there, so that no method gains by leaving out difficult joints.

    Returns:
        JSON-able. Flat lists over the cells in the order of `AXES`: `holes`; `filled`, the number of holes that the
        method filled; `mm`, the sum of errors; `stated`, the number of filled holes with a covariance; `held`, the
        number of these in which the truth is within the 90 % region. For measured joints: `seen`, their number, and
        `seen_mm`, the sum of their errors.
    """
    truth = holes.truth.xyz.astype(np.float64)
    error, reference = (take_matched(each.xyz, holes.matches) - truth for each in (poses, linear))
    distance, stand_in = (1000 * np.linalg.norm(each, axis=-1) for each in (error, reference))
    counted = holes.hidden & ~np.isnan(stand_in)
    filled = counted & ~np.isnan(distance)
    within = in_region(error, take_matched(poses.cov, holes.matches))
    stated = filled & ~np.isnan(within)
    sums = partial(_sums, AXES, _cell(holes))
    measured = take_matched(given.measured, holes.matches, False) & ~np.isnan(distance)
    return {
        "holes": sums(counted),
        "filled": sums(filled),
        "mm": sums(counted, np.where(filled, distance, stand_in)),
        "stated": sums(stated),
        "held": sums(stated & (within == 1)),
        "seen": int(measured.sum()),
        "seen_mm": round(float(distance[measured].sum()), 1),
    }


def capture_cells(sight: Holes, poses: Poses3D) -> dict:
    """Return the scores of poses, matched frame by frame, on `sight`: the true joints that fewer than two cameras saw.

    JSON-able. For each cell: `holes`; `filled`, the number of holes with a position; `near`, the number of holes within
    `NEAR` of the truth; `mm`, the sum of errors of the filled holes. For the other true joints: `seen`, `seen_found`,
    `seen_near` and `seen_mm`. For strict PCP: the numbers `limbs` and `correct`. For persons, summed over frames: their
    number `persons`, and `extra`, the number of persons that match no true person.
    """
    truth = sight.truth.xyz.astype(np.float64)
    matches = match(poses.xyz, sight.truth.xyz)
    matched = take_matched(poses.xyz, matches)
    distance = 1000 * np.linalg.norm(matched - truth, axis=-1)
    near = distance <= 1000 * NEAR
    known = ~np.isnan(truth).any(-1)
    found, seen, sums = ~np.isnan(distance), known & ~sight.hidden, partial(_sums, AXES, _cell(sight))
    correct, limbs = correct_limbs(matched, truth, sight.truth.skeleton)
    present = (~np.isnan(poses.xyz).any(-1)).any(-1).sum()
    return {
        "holes": sums(sight.hidden),
        "filled": sums(sight.hidden & found),
        "near": sums(sight.hidden & near),
        "mm": sums(sight.hidden & found, distance),
        "seen": int(seen.sum()),
        "seen_found": int((seen & found).sum()),
        "seen_near": int((seen & near).sum()),
        "seen_mm": round(float(distance[seen & found].sum()), 1),
        "limbs": int(limbs.sum()),
        "correct": int((correct & limbs).sum()),
        "persons": int(present),
        "extra": int(present - (matches >= 0).sum()),
    }


ANGLE_AXES = {"angle": list(JUDGED), "unmeasured": ["none", *AXES["frames"]], "by": ["none", *AXES["cause"]]}
"""The axes of cells of joint angles: the angle, and the longest hole among the joints that show it: its length, and by
what it was made."""


def angle_cells(holes: Holes, true: np.ndarray, given: Poses3D, poses: Poses3D) -> dict:
    """Return the scores of the leg angles of completed poses, for `true` angles by `dmae.metrics.angles.leg_angles`.

    JSON-able flat lists over the cells, in the order of `ANGLE_AXES`. `angles`: number of true angles of captured
    persons. `determined`: how many of them the completed poses determine. `degrees`: the sum of their absolute errors.
    `held`: how many of them are within the 90 % interval.
    """
    comparison = Comparison(poses, given, holes.truth, (), holes.matches, angles=true)
    error, spread = angle_errors(comparison)
    counted = ~np.isnan(true) & (holes.matches >= 0)[..., None, None]
    determined = counted & ~np.isnan(error)
    length, cause = longest_holes(holes, SHOWN_BY.values())
    index = np.broadcast_arrays(np.arange(len(JUDGED))[:, None], length + 1, cause + 1)
    cell = np.ravel_multi_index(index, [len(classes) for classes in ANGLE_AXES.values()])
    sums = partial(_sums, ANGLE_AXES, cell)
    return {
        "angles": sums(counted),
        "determined": sums(determined),
        "degrees": sums(determined, np.abs(error), digits=3),
        "held": sums(determined & in_interval(error, spread)),
    }


def longest_holes(holes: Holes, shown_by: Iterable[tuple[str, ...]]) -> tuple[np.ndarray, np.ndarray]:
    """Return length class and cause (F, T, A, 2) of the longest hole among the joints that show each of A angles.

    `shown_by` names the joints of each angle without their side; right sides are first, and -1 stands for no hole.
    """
    classes = [np.where(holes.hidden, each, -1) for each in (holes.length, holes.cause)]
    joints, found = holes.truth.skeleton.joints, []
    for names in shown_by:
        for side in "rl":
            inside = [joints.index(f"{side}_{name}") for name in names if f"{side}_{name}" in joints]
            longest = classes[0][..., inside].argmax(-1)[..., None]
            found.append([np.take_along_axis(each[..., inside], longest, -1)[..., 0] for each in classes])
    length, cause = np.moveaxis(np.array(found), 0, -1).reshape(2, *holes.hidden.shape[:2], -1, 2)
    return length, cause


def _cell(holes: Holes) -> np.ndarray:
    """Return the flat index (F, T, J) of the cell of each hole; -1 outside holes."""
    index = np.broadcast_arrays(np.maximum(holes.cause, 0), holes.length, holes.part)
    return np.where(holes.hidden, np.ravel_multi_index(index, SHAPE), -1)


def _sums(
    axes: dict[str, list[str]], cell: np.ndarray, counted: np.ndarray, values: np.ndarray | None = None, digits: int = 1
) -> list:
    """Return in each cell of the axes the number of counted entries or, given `values`, their sum."""
    weights, cells = None if values is None else values[counted], np.prod([len(classes) for classes in axes.values()])
    return np.bincount(cell[counted], weights, minlength=cells).round(digits).tolist()
