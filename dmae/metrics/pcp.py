"""PCP, the percentage of correct parts (limbs)."""

import numpy as np

from dmae.data.skeleton import SHELF14, Skeleton
from dmae.metrics.comparison import Comparison
from dmae.metrics.percentage import percent
from dmae.metrics.registry import metric
from dmae.numerics.statistics import mean_known

_SHELF_LIMBS = (
    "r_knee-r_ankle", "l_knee-l_ankle", "r_hip-r_knee", "l_hip-l_knee", "r_elbow-r_wrist", "l_elbow-l_wrist",
    "r_shoulder-r_elbow", "l_shoulder-l_elbow", "bottom_head-top_head", "mid_hip-bottom_head",
)  # fmt: skip


def limb_names(skeleton: Skeleton) -> list[str]:
    """Return the names `start-end` of the limbs that PCP counts: the ten of the Shelf protocol, else all bones."""
    if skeleton.name == SHELF14.name:
        return list(_SHELF_LIMBS)
    return [f"{skeleton.joints[parent]}-{skeleton.joints[child]}" for parent, child in skeleton.bones]


def limb_ends(xyz: np.ndarray, skeleton: Skeleton) -> np.ndarray:
    """Return (..., L, 2, 3) starts and ends of the limbs of (..., J, 3) poses."""
    if skeleton.name == SHELF14.name:
        mid_hip = xyz[..., skeleton.index("l_hip", "r_hip"), :].mean(-2, keepdims=True)
        xyz = np.concatenate([xyz, mid_hip], -2)
        joints = (*skeleton.joints, "mid_hip")
        bones = [[joints.index(end) for end in limb.split("-")] for limb in _SHELF_LIMBS]
    else:
        bones = skeleton.bones
    return xyz[..., np.asarray(bones, int), :]


def correct_limbs(
    matched: np.ndarray, truth: np.ndarray, skeleton: Skeleton, *, at_half: bool = True
) -> tuple[np.ndarray, np.ndarray]:
    """Return the correct limbs: (d_start + d_end) / 2 <= half the true length, where d are the errors of the ends.

    Limbs with an end that was not predicted, and all limbs of a missed person, are not correct.

    Args:
        matched: (F, T, J, 3) predictions in the order of the truth, from `take_matched`, m.
        truth: (F, T, J, 3) m.
        skeleton: Skeleton of both.
        at_half: Whether a limb is correct at exactly half the length.

    Returns:
        correct: (F, T, L) bool.
        known: (F, T, L) bool, True for limbs with two known true ends; only these count.
    """
    ends, true_ends = (limb_ends(np.asarray(xyz, np.float64), skeleton) for xyz in (matched, truth))
    error = np.linalg.norm(ends - true_ends, axis=-1).mean(-1)
    length = np.linalg.norm(true_ends[..., 1, :] - true_ends[..., 0, :], axis=-1)
    # Stored coordinates are float32; their rounding must not decide about a limb at exactly the threshold.
    return error <= 0.5 * length + (1e-6 if at_half else -1e-6), ~np.isnan(length)


@metric("pcp", order=1)
def _pcp(comparison: Comparison) -> float:
    """Strict PCP, mean of the actors, %."""
    return float(mean_known(_by_person(comparison)[list(comparison.actors)]))


@metric("pcp_persons", order=2, one_clip=True)
def _pcp_persons(comparison: Comparison) -> list[float]:
    """Strict PCP of each true person, %; NaN where a person is never annotated."""
    return _by_person(comparison).tolist()


@metric("pcp_limbs", order=3)
def _pcp_limbs(comparison: Comparison) -> dict[str, float]:
    """Strict PCP of each limb, mean of the actors, %."""
    correct, known = correct_limbs(comparison.matched, comparison.truth.xyz, comparison.skeleton)
    limbs = mean_known(percent(correct, known, 0)[list(comparison.actors)])
    return dict(zip(limb_names(comparison.skeleton), limbs.tolist(), strict=True))


def _by_person(comparison: Comparison) -> np.ndarray:
    """(T,) %."""
    return percent(*correct_limbs(comparison.matched, comparison.truth.xyz, comparison.skeleton), (0, 2))
