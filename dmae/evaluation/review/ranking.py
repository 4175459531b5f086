"""Rank the joints of a clip that may be off, so that a person can review them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dmae.data.clip import Clip, Source
from dmae.evaluation.review.decisions import Decision, ReviewVerdict, decided
from dmae.evaluation.review.signs import signs

_SECONDS = 0.2
"""s; length of an entry."""


@dataclass(frozen=True)
class Doubt:
    """A joint of one person in a stretch of frames.

    Attributes:
        person: Index of the captured person.
        joint: Name of the joint.
        first: Index of the first frame.
        last: Index of the last frame.
        worst: Index of the frame to look at.
        doubt: Root of the sum of the squared signs, averaged over the frames, m. It is a rank value, not an error bar.
        reason: The largest sign in the worst frame, with its size.
        source: `Source` of the joint in the worst frame.
        views: Number of cameras that measured it there.
    """

    person: int
    joint: str
    first: int
    last: int
    worst: int
    doubt: float
    reason: str
    source: Source
    views: int

    def decision(self, verdict: ReviewVerdict | str) -> Decision:
        """Return a decision on this joint in these frames."""
        return Decision(self.person, self.joint, self.first, self.last, ReviewVerdict(verdict))


def rank_doubts(clip: Clip, decisions: Sequence[Decision] = ()) -> list[Doubt]:
    """Return entries of one joint over 0.2 s, the most doubtful first. Together the entries cover the poses.

    Args:
        clip: Clip with captured or completed poses. Its truth is not used.
        decisions: Joints with a decision are left out.

    Raises:
        ValueError: the clip has no poses.
    """
    if clip.poses is None:
        raise ValueError(f"clip {clip.id!r} has no poses to review; run dmae capture on it first")
    poses, found = clip.poses, signs(clip)
    total = np.sqrt(sum(sign**2 for sign in found.values()))
    open_ = (poses.source != Source.ABSENT) & ~decided(poses, decisions, *ReviewVerdict)
    length = max(1, round(_SECONDS * clip.fps))
    doubts = []
    for start in range(0, len(clip), length):
        part = slice(start, start + length)
        there = open_[part]
        for person, joint in np.argwhere(there.any(0)):
            frames = np.flatnonzero(there[:, person, joint])
            sizes = total[part][frames, person, joint]
            worst = start + int(frames[sizes.argmax()])
            reason = max(found, key=lambda name: found[name][worst, person, joint])
            doubts.append(
                Doubt(
                    person=int(person),
                    joint=poses.skeleton.joints[joint],
                    first=start + int(frames[0]),
                    last=start + int(frames[-1]),
                    worst=worst,
                    doubt=float(sizes.mean()),
                    reason=f"{reason} {1000 * found[reason][worst, person, joint]:.0f} mm",
                    source=Source(poses.source[worst, person, joint]),
                    views=int(poses.views[worst, person, joint]),
                )
            )
    return sorted(doubts, key=lambda doubt: -doubt.doubt)
