"""Episodes: gaps of known truth, as tables of numbers that a kernel is learned from."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from dmae.completion.gaussian_process.limbs import limb_joints
from dmae.completion.gaussian_process.problems import GapProblem, Limbs
from dmae.completion.gaussian_process.torso import Torsos
from dmae.data.clip import Poses3D
from dmae.metrics.position import GAPS
from dmae.numerics.body import interpolate_bodies
from dmae.numerics.paths import pchip


@dataclass(frozen=True)
class Episode:
    """A problem and its solution.

    Attributes:
        truth: (Q, 3) m / size; NaN where unknown.
        interpolated: (Q, 3) m / size, by interpolation in the body.
        length: Index in `GAPS` of the length of the gap.
    """

    problem: GapProblem
    truth: np.ndarray
    interpolated: np.ndarray
    length: int


def episodes_of(
    poses: Poses3D, truth: Poses3D, fps: float, bones: dict[str, float], most: int, torso: bool = False
) -> Iterator[Episode]:
    """Yield the gaps of all limbs, or of the torso, of poses of which the truth is known, in the same order."""
    bodies = interpolate_bodies(poses.xyz.astype(np.float64), poses.skeleton, fps, pchip, poses.rays)
    if torso:
        parts = Torsos(poses, bodies, fps, bones)
        problems = (problem for joint in bodies.torso for problem in parts.problems(joint, most))
    else:
        parts = Limbs(poses, bodies, fps, bones)
        joints = limb_joints(bodies)
        problems = (problem for joint in joints for problem in parts.problems(joint, most, from_anchor=True))
    for problem in problems:
        gap = problem.gap
        right = parts.targets(truth.xyz.astype(np.float64), gap, gap.anchor)[gap.frames] / problem.size
        if np.isnan(right).any():
            continue
        frames = (gap.whole[1] - gap.whole[0] + 1) * 25 / fps
        length = int(np.searchsorted([low for low, _ in GAPS], frames, side="right") - 1)
        interpolated = parts.targets(bodies.filled, gap, gap.anchor)[gap.frames] / problem.size
        yield Episode(problem, right, interpolated, max(length, 0))
