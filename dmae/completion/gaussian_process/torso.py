"""Torso: gaps of its joints, filled by where they were relative to the joints of it that are measured."""

from collections.abc import Iterator

import numpy as np

from dmae.completion.gaussian_process.limbs import Gap, mirrored, name_of, runs
from dmae.completion.gaussian_process.problems import BodyParts, GapProblem


class Torsos(BodyParts):
    """The gaps of the joints of the torso, in which another joint of it, the anchor, is measured throughout.

    Where a limb hangs from a hidden joint, its first measured joint says where that is: it is an input, by its offset
    from the anchor.
    """

    def problems(self, joint: int, most: int, *anywhere: np.ndarray) -> Iterator[GapProblem]:
        """Yield the gaps of a joint that enough was measured for.

        Args:
            most: Training poses of each gap.
            anywhere: (F, P) each; gaps in which one of them is nowhere True are left out.
        """
        hidden = ~self.measured & self.placed
        for person in range(hidden.shape[1]):
            for first, end in runs(hidden[:, person, joint]):
                if not all(true[first:end, person].any() for true in anywhere):
                    continue
                seen = self.measured[first:end, person].all(0)
                anchor = self._anchor(joint, seen)
                if anchor is not None:
                    gap = Gap(person, joint, anchor, 0, np.arange(first, end), (first, end - 1))
                    problem = self._problem(gap, seen, most)
                    if problem is not None:
                        yield problem

    def _anchor(self, joint: int, seen: np.ndarray) -> int | None:
        """Return the joint of the torso nearest to a joint, of those seen (J,) throughout; None without any."""
        bodies = self.bodies
        always = [other for other in bodies.torso if seen[other]]
        near = [other for other in always if other == bodies.parents[joint] or bodies.parents[other] == joint]
        return next(iter([*near, *always]), None)

    def _problem(self, gap: Gap, seen: np.ndarray, most: int) -> GapProblem | None:
        bodies = self.bodies
        unseen = {joint for joint in bodies.torso if not seen[joint]}
        inputs, origins = [], []
        for other in bodies.attached:
            hangs = bodies.parents[other] in unseen
            if other not in unseen and other != gap.anchor and (seen[other] or not hangs):
                inputs.append(other)
                origins.append(gap.anchor if hangs else bodies.parents[other])
        filled = self.filled[:, gap.person]
        offsets = (filled[:, inputs] - filled[:, origins]) @ bodies.world_from_body[:, gap.person]
        side = mirrored(self.skeleton, gap.joint)
        kernel = "-".join(name_of(self.skeleton, joint, side) for joint in (gap.anchor, gap.joint))
        return self.problem(gap, kernel, inputs, offsets, gap.anchor, most)
