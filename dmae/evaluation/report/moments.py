"""The worst moments of a clip: the largest errors, missed persons, and the fewest measured joints."""

from dataclasses import dataclass

import numpy as np

from dmae.data.clip import Clip, Source
from dmae.evaluation.report.joints import Joints
from dmae.evaluation.report.reprojection import Reprojection

_OF_A_KIND = 6
"""Greatest number of moments of each kind."""
_MOST_JOINTS = 0.3
"""A frame is a moment if at least this share of a person's joints is not measured."""


@dataclass(frozen=True)
class WorstMoment:
    """A frame to look at.

    Attributes:
        frame: Index of the frame.
        person: Index of the captured person; None where a true person is missed.
        kind: Kind of the problem, as a heading.
        what: The problem with its joint or camera, in words.
        size: Size of the problem.
        amount: The size with its unit, as text.
    """

    frame: int
    person: int | None
    kind: str
    what: str
    size: float
    amount: str


def worst_moments(clip: Clip, joints: Joints, reprojected: Reprojection) -> list[WorstMoment]:
    """Return at most six moments of each kind, the worst first, at least a second apart for one person."""
    apart = max(1, round(clip.fps))
    found = []
    if joints.comparison is not None:
        found += _largest_errors(joints, apart)
        found += _missed_people(clip, joints)
    found += _least_measured(clip, apart)
    found += _largest_residuals(clip, reprojected, apart)
    return found


def _largest_errors(joints: Joints, apart: int) -> list[WorstMoment]:
    error = np.where(joints.counted, joints.error, np.nan)
    joint = np.where(np.isnan(error), -1, error).argmax(-1)
    largest = np.take_along_axis(error, joint[..., None], -1)[..., 0]
    moments = []
    for frame, number in peaks(largest, _OF_A_KIND, apart):
        at, size = joint[frame, number], float(largest[frame, number])
        what = f"{joints.skeleton.joints[at]}, {Source(joints.source[frame, number, at]).name.lower()}"
        moments.append(WorstMoment(frame, int(joints.person[frame, number]), "error", what, size, f"{size:.0f} mm"))
    return moments


def _missed_people(clip: Clip, joints: Joints) -> list[WorstMoment]:
    missed = joints.counted.any(-1) & (joints.person < 0)
    runs = sorted(((end - start, start, number) for number, start, end in runs_of(missed)), reverse=True)
    return [
        WorstMoment(start, None, "missed", f"true person {number}", length / clip.fps, f"{length / clip.fps:.2f} s")
        for length, start, number in runs[:_OF_A_KIND]
    ]


def _least_measured(clip: Clip, apart: int) -> list[WorstMoment]:
    there = (clip.poses.source != Source.ABSENT).any(-1)
    number = len(clip.poses.skeleton)
    lacking = np.where(there, number - clip.poses.measured.sum(-1), 0).astype(float)
    lacking[lacking < max(1, _MOST_JOINTS * number)] = np.nan
    moments = []
    for frame, person in peaks(lacking, _OF_A_KIND, apart):
        size = int(lacking[frame, person])
        completed = int((clip.poses.source[frame, person] == Source.COMPLETED).sum())
        counts = {"completed": completed, "missing": size - completed}
        what = ", ".join(f"{word} {count}" for word, count in counts.items() if count)
        moments.append(WorstMoment(frame, person, "not measured", what, size, f"{size} of {number} joints"))
    return moments


def _largest_residuals(clip: Clip, reprojected: Reprojection, apart: int) -> list[WorstMoment]:
    moments = []
    for frame, person in peaks(reprojected.worst, _OF_A_KIND, apart):
        view, joint = reprojected.where[frame, person]
        what = f"{clip.detections.skeleton.joints[joint]}, camera {clip.rig.names[view]}"
        size = float(reprojected.worst[frame, person])
        moments.append(WorstMoment(frame, person, "reprojection", what, size, f"{size:.0f} px"))
    return moments


def peaks(values: np.ndarray, number: int, apart: int) -> list[tuple[int, int]]:
    """Return frame and column of the largest values (F, N), the largest first, `apart` frames apart in a column."""
    left = np.where(np.isfinite(values), values, -np.inf)
    found = []
    while len(found) < number and left.size and left.max() > -np.inf:
        frame, column = (int(i) for i in np.unravel_index(left.argmax(), left.shape))
        found.append((frame, column))
        left[max(0, frame - apart) : frame + apart + 1, column] = -np.inf
    return found


def runs_of(flags: np.ndarray) -> list[tuple[int, int, int]]:
    """Return column, first frame and the frame after the last of each run of True in (F, N)."""
    edges = np.diff(np.pad(flags.astype(np.int8), ((1, 1), (0, 0))), axis=0)
    columns, starts = np.nonzero(edges.T == 1)
    _, ends = np.nonzero(edges.T == -1)
    return list(zip(columns.tolist(), starts.tolist(), ends.tolist(), strict=True))
