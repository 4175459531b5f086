"""Causes of holes: the reason why cameras did not see a joint for some time."""

from enum import IntEnum

import numpy as np

from dmae.data.labels import OcclusionLabels, Visibility

ENOUGH_VIEWS = 2
"""Smallest number of views that must see a joint to triangulate it."""


class Cause(IntEnum):
    """Reason why cameras did not see or measure a joint, see `causes`."""

    thing = 0
    """Furniture, walls, carried objects."""
    person = 1
    """Other people."""
    edge = 2
    """The joint is outside the image, or behind the camera."""
    self = 3
    """The person's own body: fewer than two cameras would see the joint if nothing else were there."""
    burst = 4
    """Nothing: two cameras or more saw the joint, and yet it was not measured. The detector missed it in a burst, or
    capture rejected what was detected."""


_CODES = {
    Cause.thing: (Visibility.HIDDEN_BY_OBJECT,),
    Cause.person: (Visibility.HIDDEN_BY_PERSON,),
    Cause.edge: (Visibility.OUTSIDE_IMAGE, Visibility.BEHIND_CAMERA),
}
"""The causes that a gap can have in rule 3 of `causes`, with their labels. In a tie the first one wins."""


def causes(occlusion: OcclusionLabels, hidden: np.ndarray) -> np.ndarray:
    """Return, for each hidden joint, the cause of its gap. A gap has one cause.

    A gap is a run of frames in which one joint of one person is hidden. Its cause is

    1. `burst` if in more than half of its frames `ENOUGH_VIEWS` cameras or more saw the joint; else
    2. `self` if in more than half of its frames fewer than `ENOUGH_VIEWS` cameras would see the joint if only the
       person's own body could hide it; else
    3. the one of `thing`, `person` and `edge` that hides the joint most often, counted over the frames and cameras of
       the gap.

    Args:
        occlusion: Labels of V views, T persons and J joints in F frames.
        hidden: (F, T, J) True in gaps.

    Returns:
        (F, T, J) `Cause`, -1 where not hidden.

    Raises:
        ValueError: the shape of the labels does not fit the shape of `hidden`.
    """
    visibility = occlusion.visibility
    if (len(visibility), *visibility.shape[2:]) != hidden.shape:
        raise ValueError(f"labels of {visibility.shape} (F, V, T, J) do not fit holes of {hidden.shape} (F, T, J)")
    # With time as the last axis, the frames of a gap are next to each other.
    hidden = np.moveaxis(hidden, 0, -1)
    starts = hidden & ~np.concatenate([np.zeros_like(hidden[..., :1]), hidden[..., :-1]], -1)
    gap = (np.cumsum(starts) - 1)[hidden.ravel()]
    number = int(starts.sum())

    def per_gap(counted: np.ndarray) -> np.ndarray:
        return np.bincount(gap, np.moveaxis(counted, 0, -1)[hidden].astype(float), minlength=number)

    def mostly(views: np.ndarray) -> np.ndarray:
        return per_gap(views >= ENOUGH_VIEWS) > np.bincount(gap, minlength=number) / 2

    votes = np.stack([per_gap(np.isin(visibility, codes).sum(1)) for codes in _CODES.values()])
    by_others = sum(np.isin(visibility, codes).sum(1) for codes in _CODES.values())
    seen, seen_alone = mostly(occlusion.visible_views), mostly(occlusion.visible_views + by_others)
    of_gap = np.where(seen, Cause.burst, np.where(seen_alone, votes.argmax(0), Cause.self))
    found = np.full(hidden.shape, -1, np.int8)
    found[hidden] = of_gap[gap]
    return np.moveaxis(found, -1, 0)
