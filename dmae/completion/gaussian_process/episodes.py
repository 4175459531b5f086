"""Episodes: gaps of known truth, as tables of numbers that a kernel is learned from."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from dmae.completion.blending import noisiness
from dmae.completion.gaussian_process.limbs import (
    Gap,
    body_sizes,
    gaps_of,
    input_joints,
    limb_joints,
    mirrored,
    name_of,
    training_frames,
)
from dmae.data.clip import Poses3D
from dmae.data.skeleton import Skeleton
from dmae.metrics.position_error import GAPS
from dmae.numerics import body_frame
from dmae.numerics.body_frame import Bodies
from dmae.numerics.interpolation import pchip

FEWEST = 20
"""Training poses; with fewer nothing is predicted."""


@dataclass(frozen=True)
class GapProblem:
    """One gap of one joint, to be filled by regression. N training poses, Q frames, C input joints.

    Attributes:
        gap: The gap.
        inputs: (C,) indices of the input joints; `names`: their names, sides exchanged for joints of the right.
        known: (N, C, 3) m / size; offsets of the inputs from their parents in the frame of the body.
        wanted: (Q, C, 3) the same of the frames of the gap.
        targets: (N, 3) m / size; measured offsets of the joint from its parent, or from the anchor of the gap.
        seconds: (N,) and `wanted_seconds`: (Q,) s.
        size: Of the person.
        noisy: From 0 for exact poses to 1 for captured ones.
        frames: (N,) frames of the training poses.
    """

    gap: Gap
    inputs: list[int]
    names: list[str]
    known: np.ndarray
    wanted: np.ndarray
    targets: np.ndarray
    seconds: np.ndarray
    wanted_seconds: np.ndarray
    size: float
    noisy: float
    frames: np.ndarray


class Limbs:
    """The gaps of the limbs of all people of a recording, and what is known beside them."""

    def __init__(self, poses: Poses3D, bodies: Bodies, fps: float, bones: dict[str, float]):
        self.skeleton, self.bodies, self.fps = poses.skeleton, bodies, fps
        self.measured = ~np.isnan(bodies.xyz).any(-1)
        self.unseen = ~self.measured & np.isnan(poses.rays[..., 0, 0])
        # Offsets of joints as they were interpolated, whatever is predicted later.
        self.offsets = bodies.in_body(bodies.filled - bodies.filled[:, :, bodies.parents])
        self.placed = ~np.isnan(bodies.filled).any(-1)
        self.sizes = body_sizes(poses.xyz.astype(np.float64), poses.skeleton, bones)
        self.noisy = noisiness(poses)[..., 0]

    def problems(self, joint: int, most: int, from_anchor: bool = False) -> Iterator[GapProblem]:
        """Yield the gaps of a joint that enough was measured for.

        Args:
            most: Training poses of each gap.
            from_anchor: Predict offsets from anchors; by default from parents. A process is linear in its targets, so
                that both come to the same, but joints that hang from others move with these onto rays.
        """
        for gap in gaps_of(self.bodies, joint, ~self.measured & self.placed, self.unseen):
            problem = self._problem(gap, most, gap.anchor if from_anchor else self.bodies.parents[joint])
            if problem is not None:
                yield problem

    def targets(self, xyz: np.ndarray, gap: Gap, origin: int) -> np.ndarray:
        """Return offsets (F, 3) m of a gap's joint from a joint in (F, P, J, 3), in the frame of the body."""
        offset = xyz[:, gap.person, gap.joint] - xyz[:, gap.person, origin]
        return np.einsum("fji,fj->fi", self.bodies.world_from_body[:, gap.person], offset)

    def _problem(self, gap: Gap, most: int, origin: int) -> GapProblem | None:
        inputs = [joint for joint in input_joints(self.bodies, gap) if self.placed[:, gap.person, joint].any()]
        offsets = self.offsets[:, gap.person][:, inputs]
        complete = ~np.isnan(offsets).any((1, 2))
        usable = complete & self.measured[:, gap.person, [gap.joint, origin]].all(-1)
        frames = training_frames(usable, gap, self.fps, most)
        if len(frames) < FEWEST or not complete[gap.frames].all():
            return None
        size = self.sizes[gap.person]
        side = mirrored(self.skeleton, gap.joint)
        return GapProblem(
            gap,
            inputs,
            [name_of(self.skeleton, joint, side) for joint in inputs],
            offsets[frames] / size,
            offsets[gap.frames] / size,
            self.targets(self.bodies.xyz, gap, origin)[frames] / size,
            frames / self.fps,
            gap.frames / self.fps,
            size,
            float(self.noisy[np.r_[frames, gap.frames], gap.person].mean()),
            frames,
        )


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


def episodes_of(poses: Poses3D, truth: Poses3D, fps: float, bones: dict[str, float], most: int) -> Iterator[Episode]:
    """Yield the gaps of all limbs of poses of which the truth is known, the same persons in the same order."""
    bodies = body_frame.interpolate(poses.xyz.astype(np.float64), poses.skeleton, fps, pchip, poses.rays)
    limbs = Limbs(poses, bodies, fps, bones)
    for joint in limb_joints(bodies):
        for problem in limbs.problems(joint, most, from_anchor=True):
            gap = problem.gap
            right = limbs.targets(truth.xyz.astype(np.float64), gap, gap.anchor)[gap.frames] / problem.size
            if np.isnan(right).any():
                continue
            frames = (gap.whole[1] - gap.whole[0] + 1) * 25 / fps
            length = int(np.searchsorted([low for low, _ in GAPS], frames, side="right") - 1)
            yield Episode(
                problem, right, limbs.targets(bodies.filled, gap, gap.anchor)[gap.frames] / problem.size, max(length, 0)
            )


def anchor_of(skeleton: Skeleton, gap: Gap) -> str:
    """Return the name of the anchor of a gap, of the left side for joints of the right."""
    return name_of(skeleton, gap.anchor, mirrored(skeleton, gap.joint))
