"""Pose fusion: the joints of one skeleton learned from those of another, where geometry alone is not enough.

A model of two skeletons side by side (`body21+shelf14`) is shown the first, the source, with its holes and errors; the
second, the target, is hidden whole and alone is what the model is asked for and taught.
"""

import numpy as np

from dmae.clip import Poses3D, Source
from dmae.mapping import convert
from dmae.skeleton import Skeleton


def derive(poses: Poses3D, target: Skeleton) -> Poses3D:
    """What geometry makes of the poses (`dmae.mapping.convert`), from which a model then starts.

    It says besides what the target's joints rest on: one counts as measured where those that it is made of were.
    Joints that no rule makes are absent.
    """
    try:
        return convert(poses, target)
    except KeyError:
        return nobody(target, *poses.xyz.shape[:2])


def nobody(skeleton: Skeleton, frames: int, persons: int) -> Poses3D:
    """Nobody's joints."""
    return Poses3D(skeleton, np.full((frames, persons, len(skeleton), 3), np.nan))


def true_pair(truth: Poses3D, skeleton: Skeleton) -> Poses3D:
    """Truth on two skeletons: the target as annotated, the source where it is known as well and else absent.

    Raises:
        ValueError: the target is not what was annotated; what is derived from other joints is no truth of it.
    """
    source, target = skeleton.parts
    if target not in truth.skeleton.parts:
        raise ValueError(
            f"{skeleton.name!r} is learned from truth on {target.name!r}; expected that, alone or beside another "
            f"skeleton, found truth on {truth.skeleton.name!r}"
        )
    beside = len(truth.skeleton.parts) > 1
    parts = [convert(truth, source) if beside else nobody(source, *truth.xyz.shape[:2]), convert(truth, target)]
    return Poses3D(skeleton, np.concatenate([part.xyz for part in parts], 2))


def answer(poses: Poses3D, target: Skeleton, predicted: np.ndarray, there: np.ndarray) -> Poses3D:
    """The target's joints as a model predicted them: none of them is `MEASURED`.

    Where what a joint rests on (`derive`) was measured it counts as that, moved: `DENOISED`, with the fewest views of
    it; elsewhere, and where no rule says what it rests on, it is `COMPLETED` and used none.

    Args:
        poses: The source's, (F, P, ...), without anything completed.
        predicted: (F, P, J, 3) m, world.
        there: (F, P) True where the person is.
    """
    given = derive(poses, target)
    source = np.where(given.measured, Source.DENOISED, Source.COMPLETED)
    there = there[..., None]
    return Poses3D(
        target,
        np.where(there[..., None], predicted, np.nan),
        np.where(there, source, Source.ABSENT),
        views=np.where(there, given.views, 0),
    )
