"""Joints that are compared between views."""

from dmae.data.skeleton import Skeleton

_FINE = ("eye", "ear", "toe", "heel")
"""Joints that are too near to other joints to add information."""


def coarse_skeleton(skeleton: Skeleton) -> tuple[Skeleton, list[int]]:
    """Return the skeleton without the small joints of face and feet, and the indices of the remaining joints."""
    kept = [i for i, joint in enumerate(skeleton.joints) if not joint.endswith(_FINE)]
    parents = []
    for joint in kept:
        parent = skeleton.parents[joint]
        while parent >= 0 and parent not in kept:
            parent = skeleton.parents[parent]
        parents.append(kept.index(parent) if parent >= 0 else -1)
    return Skeleton(skeleton.name, tuple(skeleton.joints[i] for i in kept), tuple(parents)), kept
