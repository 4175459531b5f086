"""Review: doubtful joints, and decisions on them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from dmae.data.clip import Clip
from dmae.evaluation.review import Decision, ReviewVerdict, decided, save_decisions
from dmae.public.arguments import checked

if TYPE_CHECKING:
    from dmae.evaluation.review import Doubt


@checked
def review(clip: Clip, decisions: Sequence[Decision] = ()) -> list[Doubt]:
    """Rank the joints of a clip by how far off they may be, the most doubtful first.

    Args:
        clip: A captured clip, completed or not. The truth is not used.
        decisions: Joints with a decision are left out of the ranking.

    Returns:
        Entries, each for one joint of one person in 0.2 s. `entry.decision("blank")` returns a decision on it.

    Raises:
        ValueError: the clip has no poses.

    Examples:
        >>> clip = next(synth.generate(seconds=1, clips=1, seed=7))
        >>> clip = replace(clip, poses=dmae.capture(clip))
        >>> first, *others = dmae.review(clip)
        >>> first.doubt >= others[0].doubt
        True
        >>> len(dmae.review(clip, [first.decision("accept")])) == len(others)
        True
    """
    from dmae.evaluation.review import rank_doubts

    return rank_doubts(clip, decisions)


@checked
def decide(clip: Clip, decisions: Sequence[Decision], folder: str | Path | None = None) -> Clip:
    """Return a clip without the joints that decisions blank or hand back.

    Args:
        clip: A captured clip, completed or not.
        decisions: If there are several on one joint, the last one counts.
        folder: Folder of the clip, where the decisions are saved for `dmae export` and `dmae complete`.

    Raises:
        ValueError: a decision names a person, joint or frame that the poses do not have, or there are no poses.

    Examples:
        >>> clip = next(synth.generate(seconds=1, clips=1, seed=7))
        >>> clip = replace(clip, poses=dmae.capture(clip))
        >>> first = dmae.review(clip)[0]
        >>> kept = dmae.decide(clip, [first.decision("blank")])
        >>> joint = kept.poses.skeleton.joints.index(first.joint)
        >>> np.isnan(kept.poses.xyz[first.worst, first.person, joint]).all()
        np.True_
    """
    if clip.poses is None:
        raise ValueError(f"clip {clip.id!r} has no poses to decide on; run dmae.capture on it first")
    left_out = decided(clip.poses, decisions, ReviewVerdict.blank, ReviewVerdict.hand_back)
    if folder is not None:
        save_decisions(Path(folder), clip.poses, decisions)
    return replace(clip, poses=clip.poses.without(left_out))
