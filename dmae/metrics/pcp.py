"""PCP, the percentage of correct parts (limbs), strict and by the protocols of published evaluations.

A protocol says how predictions are assigned to true persons, what counts as missed, and how a head is placed. This
project reports `strict`. The others are taken from the code of their authors and serve only for comparison with
published rows: none of them penalises a false positive person.
"""

from collections.abc import Sequence

import numpy as np

from dmae.data.skeleton import SHELF14, Skeleton
from dmae.metrics.comparison import GATE, Comparison, match, match_claimed, match_nearest, take_matched
from dmae.metrics.position import percent
from dmae.metrics.registry import Protocol, metric, protocol
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
        bones: Sequence[Sequence[int]] = [[joints.index(end) for end in limb.split("-")] for limb in _SHELF_LIMBS]
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


_UNGATED = 100.0  # m; a gate that is larger than any distance between persons


@protocol("strict")
def _strict(pred: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """One prediction for one person, within 0.5 m; a missed person fails all limbs."""
    return match(pred, truth)


@protocol("mvpose", head="mvpose")
def _mvpose(pred: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """The nearest prediction, however far; persons may share one (Dong et al. 2019)."""
    return match_nearest(pred, truth)


@protocol("voxelpose", missed_count=False, head="voxelpose")
def _voxelpose(pred: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """As mvpose, without the frames that have no prediction at all (Tu et al. 2020)."""
    return match_nearest(pred, truth)


@protocol("4da", missed_count=False, at_half=False)
def _4da(pred: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Hungarian assignment, however far; missed persons do not count (Zhang et al. 2020)."""
    return match(pred, truth, _UNGATED, missing=GATE)


@protocol("hkbu", at_half=False)
def _hkbu(pred: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Predictions claim the nearest person within 0.5 m, first come first served (Jiang et al. 2022)."""
    return match_claimed(pred, truth)


def count_limbs(
    rules: Protocol, pred: np.ndarray, truth: np.ndarray, skeleton: Skeleton
) -> tuple[np.ndarray, np.ndarray]:
    """Return which limbs of the true persons are correct by a protocol, and which count, (F, T, L) bool each.

    Predictions (F, P, J, 3) and truth (F, T, J, 3), m, are on one skeleton, with the head placed as in the protocol.
    """
    matches = rules.function(pred, truth)
    correct, counted = correct_limbs(take_matched(pred, matches), truth, skeleton, at_half=rules.at_half)
    return correct, counted if rules.missed_count else counted & (matches >= 0)[..., None]


def better_limbs(
    rules: Protocol, first: np.ndarray, second: np.ndarray, truth: np.ndarray, skeleton: Skeleton
) -> tuple[np.ndarray, np.ndarray]:
    """Return which limbs are correct, and count, if the truth chooses the better of two predictions in each frame.

    The released evaluation of Jiang et al. 2022 does this with the poses before and after their fusion. No system can
    make this choice. The score is therefore an upper bound for both, and comparable only with that publication. The
    first prediction determines the assignment. Arrays are as in `count_limbs`.
    """
    matches = rules.function(first, truth)
    (one, counted), (other, _) = (
        correct_limbs(take_matched(pred, matches), truth, skeleton, at_half=rules.at_half) for pred in (first, second)
    )
    better = (other & counted).sum(-1) > (one & counted).sum(-1)
    return np.where(better[..., None], other, one), counted


def published_pcp(pred: np.ndarray, truth: np.ndarray, skeleton: Skeleton, actors: Sequence[int]) -> dict[str, float]:
    """Return the average PCP, %, of some true persons by each published protocol, without its placement of the head.

    Predictions (F, P, J, 3) and truth (F, T, J, 3), m, are on one skeleton; `actors` are indices of true persons.
    """
    counts = {name: count_limbs(rules, pred, truth, skeleton) for name, rules in protocol.items() if name != "strict"}
    return {name: float(mean_known(percent(*found, (0, 2))[list(actors)])) for name, found in counts.items()}


@metric("pcp_published", order=4)
def _pcp_published(comparison: Comparison) -> dict[str, float]:
    """PCP by the protocols of published tables, mean of the actors, %."""
    pred, truth = (xyz / comparison.scale for xyz in (comparison.pred.xyz, comparison.truth.xyz))
    return published_pcp(pred, truth, comparison.skeleton, comparison.actors)
