"""Cells: sums of the errors of one clip, by cause, length of the hole and body part."""

import numpy as np

from dmae.data.clip import Poses3D
from dmae.evaluation.benchmark.causes import Cause
from dmae.evaluation.benchmark.holes import PARTS, Holes
from dmae.metrics.matching import match, take_matched
from dmae.metrics.pcp import correct_limbs
from dmae.metrics.position_error import GAPS
from dmae.metrics.uncertainty import in_region

AXES = {
    "cause": [cause.name for cause in Cause],
    "frames": [f"{low}-{high}" if high else f">{low - 1}" for low, high in GAPS],
    "part": list(PARTS),
}
"""The axes of cells and their classes; `frames` is the length of a hole in frames at 25/s."""
SHAPE = tuple(len(classes) for classes in AXES.values())
NEAR = 0.1
"""m; a joint that is within this distance of the truth counts as near."""


def completion_cells(holes: Holes, given: Poses3D, linear: Poses3D, poses: Poses3D) -> dict:
    """Return the scores of completed poses on the holes of capture.

    Only the holes that linear filling fills are counted: the person stays or returns within a second, and the joint was
    measured before and after the hole, or within half a second. If a method does not fill such a hole, it gets the
    error of linear filling there, so that no method gains by leaving out difficult joints.

    Args:
        holes: Holes of the captured poses.
        given: Captured poses, not filled.
        linear: The same poses, linearly filled.
        poses: Poses of the method, with the persons of `given`.

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
    cell = _cell(holes)
    measured = take_matched(given.measured, holes.matches, False) & ~np.isnan(distance)
    return {
        "holes": _counts(cell, counted),
        "filled": _counts(cell, filled),
        "mm": _sums(cell, counted, np.where(filled, distance, stand_in)),
        "stated": _counts(cell, stated),
        "held": _counts(cell, stated & (within == 1)),
        "seen": int(measured.sum()),
        "seen_mm": round(float(distance[measured].sum()), 1),
    }


def capture_cells(sight: Holes, poses: Poses3D) -> dict:
    """Return the scores of poses of any capture on the joints that fewer than two cameras saw.

    Args:
        sight: The true joints that fewer than two cameras saw.
        poses: Poses of P persons. They are matched to true persons frame by frame.

    Returns:
        JSON-able. For each cell: `holes`; `filled`, the number of holes with a position; `near`, the number of holes
        within `NEAR` of the truth; `mm`, the sum of errors of the filled holes. For the other true joints: `seen`,
        `seen_found`, `seen_near` and `seen_mm`. For strict PCP: the numbers `limbs` and `correct`. For persons, summed
        over frames: their number `persons`, and `extra`, the number of persons that match no true person.
    """
    truth = sight.truth.xyz.astype(np.float64)
    matches = match(poses.xyz, sight.truth.xyz)
    matched = take_matched(poses.xyz, matches)
    distance = 1000 * np.linalg.norm(matched - truth, axis=-1)
    near = distance <= 1000 * NEAR
    known = ~np.isnan(truth).any(-1)
    found, seen, cell = ~np.isnan(distance), known & ~sight.hidden, _cell(sight)
    correct, limbs = correct_limbs(matched, truth, sight.truth.skeleton)
    present = (~np.isnan(poses.xyz).any(-1)).any(-1).sum()
    return {
        "holes": _counts(cell, sight.hidden),
        "filled": _counts(cell, sight.hidden & found),
        "near": _counts(cell, sight.hidden & near),
        "mm": _sums(cell, sight.hidden & found, distance),
        "seen": int(seen.sum()),
        "seen_found": int((seen & found).sum()),
        "seen_near": int((seen & near).sum()),
        "seen_mm": round(float(distance[seen & found].sum()), 1),
        "limbs": int(limbs.sum()),
        "correct": int((correct & limbs).sum()),
        "persons": int(present),
        "extra": int(present - (matches >= 0).sum()),
    }


def _cell(holes: Holes) -> np.ndarray:
    """Return the flat index (F, T, J) of the cell of each hole; -1 outside holes."""
    index = np.broadcast_arrays(np.maximum(holes.cause, 0), holes.length, holes.part)
    return np.where(holes.hidden, np.ravel_multi_index(index, SHAPE), -1)


def _counts(cell: np.ndarray, counted: np.ndarray) -> list[int]:
    return np.bincount(cell[counted], minlength=np.prod(SHAPE)).tolist()


def _sums(cell: np.ndarray, counted: np.ndarray, values: np.ndarray) -> list[float]:
    return np.bincount(cell[counted], values[counted], minlength=np.prod(SHAPE)).round(1).tolist()
