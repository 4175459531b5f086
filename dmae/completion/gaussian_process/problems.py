"""Problems: gaps of joints as tables of numbers, that a Gaussian process fills by regression."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from dmae.completion.blending import noisiness
from dmae.completion.gaussian_process.limbs import (
    Gap,
    body_sizes,
    gaps_of,
    input_joints,
    mirrored,
    name_of,
    training_frames,
)
from dmae.data.clip import Poses3D
from dmae.numerics.body import Bodies

FEWEST = 20
"""Training poses; with fewer nothing is predicted."""


@dataclass(frozen=True)
class GapProblem:
    """One gap of one joint, to be filled by regression. N training poses, Q frames, C input joints.

    Attributes:
        gap: The gap.
        kernel: Name of the kernel that was learned for gaps like this one.
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
    kernel: str
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


class BodyParts:
    """All people of a recording, and what is known of them: what problems are made of."""

    def __init__(self, poses: Poses3D, bodies: Bodies, fps: float, bones: dict[str, float]):
        self.skeleton, self.bodies, self.fps = poses.skeleton, bodies, fps
        self.measured = ~np.isnan(bodies.xyz).any(-1)
        # As they were interpolated, whatever is predicted later.
        self.filled = bodies.filled.copy()
        self.placed = ~np.isnan(self.filled).any(-1)
        self.sizes = body_sizes(poses.xyz.astype(np.float64), poses.skeleton, bones)
        self.noisy = noisiness(poses)[..., 0]

    def targets(self, xyz: np.ndarray, gap: Gap, origin: int) -> np.ndarray:
        """Return offsets (F, 3) m of a gap's joint from a joint in (F, P, J, 3), in the frame of the body."""
        offset = xyz[:, gap.person, gap.joint] - xyz[:, gap.person, origin]
        return np.einsum("fji,fj->fi", self.bodies.world_from_body[:, gap.person], offset)

    def problem(
        self, gap: Gap, kernel: str, inputs: list[int], offsets: np.ndarray, origin: int, most: int
    ) -> GapProblem | None:
        """Return a problem of inputs with offsets (F, C, 3) m; None where too little is known."""
        complete = ~np.isnan(offsets).any((1, 2))
        usable = complete & self.measured[:, gap.person, [gap.joint, origin]].all(-1)
        frames = training_frames(usable, gap, self.fps, most)
        if len(frames) < FEWEST or not complete[gap.frames].all():
            return None
        size, side = self.sizes[gap.person], mirrored(self.skeleton, gap.joint)
        return GapProblem(
            gap,
            kernel,
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


class Limbs(BodyParts):
    """The gaps of the limbs."""

    def __init__(self, poses: Poses3D, bodies: Bodies, fps: float, bones: dict[str, float]):
        super().__init__(poses, bodies, fps, bones)
        self.unseen = ~self.measured & np.isnan(poses.rays[..., 0, 0])
        self.offsets = bodies.in_body(self.filled - self.filled[:, :, bodies.parents])

    def problems(self, joint: int, most: int, *anywhere: np.ndarray, from_anchor: bool = False) -> Iterator[GapProblem]:
        """Yield the gaps of a joint that enough was measured for.

        Args:
            most: Training poses of each gap.
            anywhere: (F, P) each; gaps in which one of them is nowhere True are left out.
            from_anchor: Predict offsets from anchors; by default from parents. A process is linear in its targets, so
                that both come to the same, but joints that hang from others move with these onto rays.
        """
        side = mirrored(self.skeleton, joint)
        for gap in gaps_of(self.bodies, joint, ~self.measured & self.placed, self.unseen):
            if not all(true[gap.frames, gap.person].any() for true in anywhere):
                continue
            inputs = [other for other in input_joints(self.bodies, gap) if self.placed[:, gap.person, other].any()]
            offsets = self.offsets[:, gap.person][:, inputs]
            kernel = name_of(self.skeleton, gap.anchor, side)
            origin = gap.anchor if from_anchor else self.bodies.parents[joint]
            problem = self.problem(gap, kernel, inputs, offsets, origin, most)
            if problem is not None:
                yield problem
