"""The joints that a report counts, in groups that add up over clips; and how far they reproject from detections."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from dmae.data.clip import Clip, Poses3D, Source, person_name
from dmae.data.conversion import convert, scale_of
from dmae.data.skeleton import Skeleton
from dmae.files.mapped import in_steps
from dmae.metrics.comparison import GAP_RATE, Comparison, match, take_matched
from dmae.numerics.paths import gap_lengths
from dmae.reporting.tables import Table, number_text

BINS = 2000
"""Errors are counted in bins of one unit, mm or px; the last holds all larger ones."""


@dataclass(frozen=True)
class JointGroup:
    """A group of joints."""

    joints: int  # Number of joints
    completed: int  # Number of completed joints
    missing: int  # Number of absent joints
    compared: int  # Number of joints with an error
    total: float  # Sum of the errors
    histogram: np.ndarray  # (BINS,) counts of errors by their whole number of units

    def __add__(self, other: "JointGroup") -> "JointGroup":
        return JointGroup(*(a + b for a, b in zip(vars(self).values(), vars(other).values(), strict=True)))

    @property
    def mean(self) -> float | None:
        """Mean error; None if no joint has an error."""
        return self.total / self.compared if self.compared else None

    def quantile(self, share: float) -> float | None:
        """Return the error that this share of joints does not exceed, within one unit; None without errors."""
        if not self.compared:
            return None
        counts = np.cumsum(self.histogram)
        bin = int(np.searchsorted(counts, share * self.compared))
        before = counts[bin - 1] if bin else 0
        return bin + (share * self.compared - before) / max(self.histogram[bin], 1)


def tally(error: np.ndarray, source: np.ndarray) -> JointGroup:
    """Count joints by `source` (...) and their errors (...), mm or px; NaN where there is none."""
    known = error[np.isfinite(error)]
    return JointGroup(
        source.size,
        int((source == Source.COMPLETED).sum()),
        int((source == Source.ABSENT).sum()),
        len(known),
        float(known.sum(dtype=np.float64)),
        np.bincount(np.minimum(known, BINS - 1).astype(int), minlength=BINS),
    )


Groups = dict[str, dict[str, JointGroup]]
"""Groups of joints by breakdown ("camera", "joint", ...) and name."""


def added(*parts: dict) -> dict:
    """Return groups of several clips or frames as one dictionary; what has the same name adds up."""
    total = {}
    for part in parts:
        for name, each in part.items():
            total[name] = total[name] + each if name in total else each
    return total


def added_groups(*parts: Groups) -> Groups:
    """Return the groups of several clips or frames, by breakdown, as one dictionary."""
    names = dict.fromkeys(name for part in parts for name in part)
    return {name: added(*(part.get(name, {}) for part in parts)) for name in names}


# Joints of the true people or, without truth, of the captured people


@dataclass(frozen=True, eq=False)
class Joints:
    """Joints of N people in F frames, on one skeleton."""

    skeleton: Skeleton  # Skeleton of J joints
    # (F, N, J) True for joints that count: true joints, or joints of captured people who are present
    counted: np.ndarray
    source: np.ndarray  # (F, N, J) `Source` of the captured or completed joint
    views: np.ndarray  # (F, N, J) number of cameras that measured the joint
    # (F, N, J) length of the gap around each joint that was not measured, in frames at 25/s; 0 where it was
    gap: np.ndarray
    person: np.ndarray  # (F, N) index of the captured person; -1 where a true person is missed
    comparison: Comparison | None = None  # Comparison with the truth; None without truth

    @cached_property
    def error(self) -> np.ndarray:
        """(F, N, J) mm; NaN without truth, and where a joint is missing."""
        if self.comparison is None:
            return np.full(self.source.shape, np.nan)
        return 1000 * np.linalg.norm(self.comparison.matched - self.comparison.truth.xyz.astype(np.float64), axis=-1)


def joints_of(clip: Clip) -> Joints:
    """Return the joints of a captured clip. Poses are compared on their own skeleton if the truth has it."""
    poses = clip.poses
    if clip.truth is None or not np.isfinite(clip.truth.xyz).any():
        gap = np.ceil(gap_lengths(poses.measured) * (GAP_RATE / clip.fps) - 1e-6).astype(int)
        there = np.broadcast_to((poses.source != Source.ABSENT).any(-1, keepdims=True), poses.source.shape)
        person = np.broadcast_to(np.arange(poses.xyz.shape[1]), poses.xyz.shape[:2])
        return Joints(poses.skeleton, there, poses.source, poses.views, gap, person)
    parts = clip.truth.skeleton.parts
    truth = convert(clip.truth, next((part for part in parts if part.name == poses.skeleton.name), parts[-1]))
    poses = convert(poses, truth.skeleton)
    captured = poses.without(poses.source == Source.COMPLETED)
    comparison = Comparison(poses, captured, truth, tuple(range(truth.xyz.shape[1])), fps=clip.fps)
    return Joints(
        truth.skeleton,
        comparison.known,
        comparison.source,
        take_matched(poses.views, comparison.matches, 0),
        comparison.gap_lengths.astype(int),
        comparison.matches,
        comparison,
    )


# Distances between joints, projected into cameras, and their detections

GATE_M = 0.4
"""m, at the median depth of the people in a camera, for bodies of a person's size. A detection with a larger mean
distance shows another person."""
_CHUNK = 256


@dataclass(frozen=True)
class Reprojection:
    """Reprojection errors, px, of joints that were measured and of those that were completed."""

    measured: Groups  # By "camera", "person", "joint" and "all"
    completed: Groups  # The same for completed joints
    worst: np.ndarray  # (F, P) largest error of a measured joint of each person in any camera; NaN where there is none
    where: np.ndarray  # (F, P, 2) indices of its camera and joint


def reprojection(clip: Clip) -> Reprojection:
    """Return the errors between poses and, in each frame and camera, the detections that fit them best."""
    poses = convert(clip.poses, clip.detections.skeleton)
    poses = poses.without(np.isinf(poses.xyz).any(-1))
    frames, persons, joints = poses.source.shape
    measured: Groups = {}
    completed: Groups = {}
    worst, where = np.full((frames, persons), np.nan), np.zeros((frames, persons, 2), int)
    cuts = {
        "camera": {name: np.s_[:, view] for view, name in enumerate(clip.rig.names)},
        "person": {person_name(person): np.s_[:, :, person] for person in range(persons)},
        "joint": {name: np.s_[..., joint] for joint, name in enumerate(poses.skeleton.joints)},
        "all": {"all": np.s_[:]},
    }

    def groups(error: np.ndarray, source: np.ndarray) -> Groups:
        return {
            name: {group: tally(error[cut], source[cut]) for group, cut in parts.items()}
            for name, parts in cuts.items()
        }

    for start in in_steps(range(0, frames if persons else 0, _CHUNK)):
        part = slice(start, start + _CHUNK)
        error = reprojection_errors(clip.select(frames=part), poses.select(part))
        source = np.broadcast_to(poses.source[part][:, None], error.shape)
        is_completed = source == Source.COMPLETED
        measured = added_groups(measured, groups(np.where(is_completed, np.nan, error), source))
        completed = added_groups(completed, groups(np.where(is_completed, error, np.nan), source))
        flat = np.where(is_completed, np.nan, error).transpose(0, 2, 1, 3).reshape(len(error), persons, -1)
        largest = np.where(np.isnan(flat), -1, flat).argmax(-1)
        worst[part] = np.take_along_axis(flat, largest[..., None], -1)[..., 0]
        where[part] = np.stack(np.divmod(largest, joints), -1)
    return Reprojection(measured, completed, worst, where)


def reprojection_errors(clip: Clip, poses: Poses3D) -> np.ndarray:
    """Return the distances (F, V, P, J) between reprojected joints and the matched detection, px."""
    pixels, depth = clip.rig.project(poses.xyz)
    errors, scale = np.full(pixels.shape[:-1], np.nan), scale_of(poses)
    for view in range(len(clip.rig)):
        known = np.isfinite(pixels[:, view]).all(-1)
        if not known.any():
            continue
        gate = scale * GATE_M * clip.rig.K[view, 0, 0] / np.median(depth[:, view][known])
        found = clip.detections.xy[:, view]
        matched = take_matched(found, match(found, pixels[:, view], gate))
        errors[:, view] = np.linalg.norm(matched - pixels[:, view], axis=-1)
    return errors


def residual_tables(measured: Groups, completed: Groups, names: Sequence[str]) -> list[Table]:
    """Return a table per breakdown: how far joints reproject from detections, px; completed joints if any."""
    some_completed = any(each.compared for groups in completed.values() for each in groups.values())
    tables = []
    for name in (name for name in names if name in measured):
        rows = []
        for group, each in measured[name].items():
            other = completed.get(name, {}).get(group)
            if each.compared or (other and other.compared):
                figures = (each.mean, each.quantile(0.5), each.quantile(0.9))
                row = (group, f"{each.compared:,}", *(number_text(figure) for figure in figures))
                more = (f"{other.compared:,}" if other else "0", number_text(other and other.mean))
                rows.append(row + more if some_completed else row)
        header = (name, "measured", "mean px", "median px", "90 % under")
        if some_completed:
            header += ("completed", "completed mean px")
        if rows:
            tables.append(Table(f"By {name}", header, rows, bars=(2, 6) if some_completed else (2,)))
    return tables
