"""Pose fusion: the joints of one skeleton learned from those of another, where geometry alone is not enough.

A model of two skeletons side by side (`body21+shelf14`) is given the first, the source, with its gaps and errors. The
second, the target, is hidden whole; it alone is predicted, and it alone is trained on.
"""

import numpy as np

from dmae.data.clip import Poses3D, Source
from dmae.data.conversion import convert
from dmae.data.skeleton import Skeleton


def derive(poses: Poses3D, target: Skeleton) -> Poses3D:
    """Return what geometry makes of the poses (`dmae.data.conversion.convert`), from which a model starts.

    A joint of the target counts as measured where the joints that it is derived from were. Joints that no rule derives
    are absent.
    """
    try:
        return convert(poses, target)
    except KeyError:
        return absent(target, *poses.xyz.shape[:2])


_NEAR = {"bottom_head": "neck", "top_head": "nose"}
"""Joints of a target without a namesake, and the joint of the source that they move with."""


def namesakes(skeleton: Skeleton) -> list[int] | None:
    """Return for each joint the one whose code it has in the paper's network; None if there is one skeleton.

    A joint of the target takes the code of the source's joint with the same name, or of the joint that it moves with.
    If there is neither, it has a code of its own.
    """
    if len(skeleton.parts) < 2:
        return None
    source, target = skeleton.parts
    found = list(range(len(skeleton)))
    for number, joint in enumerate(target.joints, len(source)):
        same = joint if joint in source.joints else _NEAR.get(joint)
        if same in source.joints:
            found[number] = source.index(same)[0]
    return found


def absent(skeleton: Skeleton, frames: int, persons: int) -> Poses3D:
    """Return poses of which every joint is absent."""
    return Poses3D(skeleton, np.full((frames, persons, len(skeleton), 3), np.nan))


def true_pair(truth: Poses3D, skeleton: Skeleton) -> Poses3D:
    """Return truth on two skeletons: the target as annotated, the source where it is known as well and else absent.

    Raises ValueError if the target was not annotated; joints derived from others are no truth of it.
    """
    source, target = skeleton.parts
    if target not in truth.skeleton.parts:
        raise ValueError(
            f"{skeleton.name!r} is learned from truth on {target.name!r}; expected that, alone or with another "
            f"skeleton, found truth on {truth.skeleton.name!r}"
        )
    joined = len(truth.skeleton.parts) > 1
    parts = [convert(truth, source) if joined else absent(source, *truth.xyz.shape[:2]), convert(truth, target)]
    return Poses3D(skeleton, np.concatenate([part.xyz for part in parts], 2))


def fused(poses: Poses3D, target: Skeleton, predicted: np.ndarray, present: np.ndarray) -> Poses3D:
    """Return the target's joints as a model predicted them: none of them is `MEASURED`.

    Where the joints that one is derived from (`derive`) were measured it is `DENOISED`, with the fewest views of
    them; elsewhere, and where no rule derives it, it is `COMPLETED` and used none.

    Args:
        poses: The source's, (F, P, ...), without anything completed.
        predicted: (F, P, J, 3) m, world.
        present: (F, P) True where the person is.
    """
    derived = derive(poses, target)
    source = np.where(derived.measured, Source.DENOISED, Source.COMPLETED)
    present = present[..., None]
    return Poses3D(
        target,
        np.where(present[..., None], predicted, np.nan),
        np.where(present, source, Source.ABSENT),
        views=np.where(present, derived.views, 0),
    )
