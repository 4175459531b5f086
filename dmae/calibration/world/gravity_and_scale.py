"""Gravity and scale: the vertical direction of the world and the length of its unit, from the people measured in it."""

from functools import partial

import numpy as np

from dmae.data.skeleton import Skeleton
from dmae.files.mapped import by_frames
from dmae.numerics.statistics import mean_known

_ADULT = {("shoulder", "hip"): 0.50, ("hip", "knee"): 0.42, ("knee", "ankle"): 0.41}
"""m, mean of both sides: lengths of the limbs of an adult of 1.72 m."""
_MIN_COUNT = 10
"""Smallest number of limbs, or of people, for a result."""


def relative_size(people: np.ndarray, skeleton: Skeleton) -> float | None:
    """Return the size of people (n, J, 3) relative to adults measured in metres; None if too few limbs are known."""
    ratios = []
    for (start, end), adult in _ADULT.items():
        for side in (side for side in "lr" if {f"{side}_{start}", f"{side}_{end}"} <= set(skeleton.joints)):
            first, second = skeleton.index(f"{side}_{start}", f"{side}_{end}")
            ratios.append(np.linalg.norm(people[:, first] - people[:, second], axis=-1) / adult)
    ratios = np.concatenate(ratios) if ratios else np.empty(0)
    ratios = ratios[np.isfinite(ratios)]
    return float(np.median(ratios)) if len(ratios) >= _MIN_COUNT else None


def upright_direction(people: np.ndarray, skeleton: Skeleton) -> tuple[np.ndarray, float] | None:
    """Find the direction in which people (n, J, 3) stand.

    Returns:
        The unit vector (3,), and the agreement of people on it from 0 to 1; None if too few people are known.
    """
    direction = by_frames(partial(_directions, skeleton), people)
    direction = direction[np.isfinite(direction).all(-1)]
    if len(direction) < _MIN_COUNT:
        return None
    mean = direction.mean(0)
    length = float(np.linalg.norm(mean))
    return mean / max(length, 1e-12), length


def _directions(skeleton: Skeleton, people: np.ndarray) -> np.ndarray:
    """Return the unit vectors (n, 3) from the legs of people (n, J, 3) to their shoulders; NaN where unknown."""
    ends, people = [], people.astype(np.float64)
    for parts in (("shoulder", "neck", "nose"), ("ankle", "knee")):
        joints = [i for i, joint in enumerate(skeleton.joints) if joint.removeprefix("l_").removeprefix("r_") in parts]
        ends.append(mean_known(people[:, joints], 1) if joints else np.full((len(people), 3), np.nan))
    with np.errstate(divide="ignore", invalid="ignore"):
        return (ends[0] - ends[1]) / np.linalg.norm(ends[0] - ends[1], axis=-1, keepdims=True)
