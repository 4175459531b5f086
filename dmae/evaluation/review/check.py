"""Check, with known truth, how well the ranking of doubtful joints finds the wrong ones."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dmae.data.clip import Clip
from dmae.evaluation.report.joints import joints_of
from dmae.evaluation.review.ranking import Doubt

OFF = 100.0
"""mm; a joint is off if it is farther than this from the truth."""
FIRST = 0.1
"""Share of the entries that a reviewer looks at."""


@dataclass(frozen=True)
class RankingCheck:
    """Counts of the joints that are off, in the first entries of a ranking and in all.

    Attributes:
        off: Number of joints that are off, counted in each frame.
        found: Number of these that are in the first entries.
        entries: Number of entries with joints that the truth has.
    """

    off: int
    found: int
    entries: int


def check_ranking(clip: Clip, ranking: Sequence[Doubt]) -> RankingCheck | None:
    """Return the number of joints that are off, in the first tenth of the entries and in all; None without truth.

    Only joints with the same name in the skeletons of truth and poses count. Entries without these joints are left out.
    """
    if clip.truth is None or not np.isfinite(clip.truth.xyz).any():
        return None
    poses, joints = clip.poses, joints_of(clip)
    judged, off = np.zeros((2, *poses.source.shape), bool)
    for index, name in enumerate(joints.skeleton.joints):
        if name not in poses.skeleton.joints:
            continue
        counts = joints.counted[..., index] & (joints.person >= 0) & ~np.isnan(joints.error[..., index])
        frame, number = np.nonzero(counts)
        at = frame, joints.person[frame, number], poses.skeleton.joints.index(name)
        judged[at], off[at] = True, joints.error[frame, number, index] > OFF
    places = [(slice(d.first, d.last + 1), d.person, poses.skeleton.joints.index(d.joint)) for d in ranking]
    places = [place for place in places if judged[place].any()]
    first = places[: int(FIRST * len(places))]
    return RankingCheck(int(off.sum()), int(sum(off[place].sum() for place in first)), len(places))
