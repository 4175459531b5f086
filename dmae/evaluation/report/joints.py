"""The joints that a report counts: those of the true people or, without truth, those of the captured people."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from dmae.data.clip import Clip, Poses3D, Source
from dmae.data.conversion import convert
from dmae.data.skeleton import Skeleton
from dmae.metrics.comparison import GAP_RATE, Comparison, take_matched
from dmae.numerics.paths import gap_lengths


@dataclass(frozen=True, eq=False)
class Joints:
    """Joints of N people in F frames, on one skeleton.

    Attributes:
        skeleton: Skeleton of J joints.
        counted: (F, N, J) True for joints that count: true joints, or joints of captured people who are present.
        source: (F, N, J) `Source` of the captured or completed joint.
        views: (F, N, J) number of cameras that measured the joint.
        gap: (F, N, J) length of the gap around each joint that was not measured, in frames at 25/s; 0 where it was.
        person: (F, N) index of the captured person; -1 where a true person is missed.
        comparison: Comparison with the truth; None without truth.
    """

    skeleton: Skeleton
    counted: np.ndarray
    source: np.ndarray
    views: np.ndarray
    gap: np.ndarray
    person: np.ndarray
    comparison: Comparison | None = None

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
    truth = true_poses(clip, poses.skeleton)
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


def true_poses(clip: Clip, wanted: Skeleton) -> Poses3D:
    """Return the truth on a skeleton if it has that one as a part, else on its last part."""
    parts = clip.truth.skeleton.parts
    return convert(clip.truth, next((part for part in parts if part.name == wanted.name), parts[-1]))
