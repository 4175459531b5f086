"""What people tell of the world they were measured in: how large it is, and which way is up."""

import numpy as np

from dmae.metrics import mean_known
from dmae.skeleton import Skeleton

_ADULT = {("shoulder", "hip"): 0.50, ("hip", "knee"): 0.42, ("knee", "ankle"): 0.41}
"""m, both sides' mean: limbs of an adult of 1.72 m."""
_LEAST = 10
"""Fewer limbs or people tell nothing."""


def size(people: np.ndarray, skeleton: Skeleton) -> float | None:
    """How large people (n, J, 3) are, 1 for adults if lengths are in m; None where too little of them is seen."""
    ratios = []
    for (start, end), adult in _ADULT.items():
        known = [side for side in "lr" if {f"{side}_{start}", f"{side}_{end}"} <= set(skeleton.joints)]
        for side in known:
            first, second = skeleton.index(f"{side}_{start}", f"{side}_{end}")
            ratios.append(np.linalg.norm(people[:, first] - people[:, second], axis=-1) / adult)
    ratios = np.concatenate(ratios) if ratios else np.empty(0)
    ratios = ratios[np.isfinite(ratios)]
    return float(np.median(ratios)) if len(ratios) >= _LEAST else None


def upright(people: np.ndarray, skeleton: Skeleton) -> tuple[np.ndarray, float] | None:
    """The direction (3,) in which people (n, J, 3) stand, and from 0 to 1 how much they agree in it.

    None where too little of them is seen.
    """
    ends = []
    for parts in (("shoulder", "neck", "nose"), ("ankle", "knee")):
        joints = [i for i, joint in enumerate(skeleton.joints) if joint.removeprefix("l_").removeprefix("r_") in parts]
        ends.append(mean_known(people[:, joints], 1) if joints else np.full((len(people), 3), np.nan))
    with np.errstate(divide="ignore", invalid="ignore"):
        direction = (ends[0] - ends[1]) / np.linalg.norm(ends[0] - ends[1], axis=-1, keepdims=True)
    direction = direction[np.isfinite(direction).all(-1)]
    if len(direction) < _LEAST:
        return None
    mean = direction.mean(0)
    length = float(np.linalg.norm(mean))
    return mean / max(length, 1e-12), length
