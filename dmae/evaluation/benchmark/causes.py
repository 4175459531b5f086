"""Causes of holes: what kept the cameras from a joint for a while."""

from enum import IntEnum

import numpy as np

from dmae.data.labels import OcclusionLabels, Visibility

ENOUGH_VIEWS = 2
"""Views that have to see a joint for it to be triangulated."""


class Cause(IntEnum):
    """What kept the cameras from a joint; see `causes`."""

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
"""The causes that compete for a gap, in the order in which ties are broken, and their labels."""


def causes(occlusion: OcclusionLabels, hidden: np.ndarray) -> np.ndarray:
    """Return the cause of the gap that each hidden joint is in; one gap has one cause.

    A gap is a run of frames in which one joint of one person is hidden. Its cause is

    1. `burst` if in more than half of its frames `ENOUGH_VIEWS` cameras or more saw the joint; else
    2. `self` if in more than half of its frames fewer cameras than that would see the joint with everything else taken
       away, so that only the person's own body is left; else
    3. the one of `thing`, `person` and `edge` that hides the joint in most frames and cameras of the gap.

    Args:
        occlusion: What V views show of J joints of T persons in F frames.
        hidden: (F, T, J) True in gaps.

    Returns:
        (F, T, J) `Cause`, -1 where not hidden.

    Raises:
        ValueError: the labels have not the shape of `hidden`.
    """
    visibility = occlusion.visibility
    if (len(visibility), *visibility.shape[2:]) != hidden.shape:
        raise ValueError(f"labels of {visibility.shape} (F, V, T, J) do not fit holes of {hidden.shape} (F, T, J)")
    # Time last: the frames of a gap are next to each other.
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
