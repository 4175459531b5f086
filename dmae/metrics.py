"""Scores of predicted against true poses: pure functions on arrays.

Predictions are (F, P, J, 3) and truth (F, T, J, 3), m, world, on the same J joints; T true persons.
Frames without a true person are not annotated and count for nothing.
"""

from collections.abc import Sequence

import numpy as np
from scipy.optimize import linear_sum_assignment

from dmae.clip import Source
from dmae.gaps import neighbours
from dmae.skeleton import SHELF14, Skeleton

GATE = 0.5
"""m; a prediction whose joints are further off than this on average is of somebody else."""

PCK_THRESHOLD = 0.2
"""m. The 0.2 of PCK@0.2 is metres in multi-person capture, not torso sizes as in single images."""

GAPS = ((1, 5), (6, 15), (16, 40), (41, None))
"""Frames at 25/s, both included: lengths of hidden stretches that are told apart."""

SHARE = 0.9
"""Of the truth, in the regions by which stated covariances are judged."""

RADIUS = 2.5003
"""Standard deviations of an isotropic Gaussian in three dimensions that hold that share."""

_SHELF_LIMBS = (
    "r_knee-r_ankle", "l_knee-l_ankle", "r_hip-r_knee", "l_hip-l_knee", "r_elbow-r_wrist", "l_elbow-l_wrist",
    "r_shoulder-r_elbow", "l_shoulder-l_elbow", "bottom_head-top_head", "mid_hip-bottom_head",
)  # fmt: skip


def limb_names(skeleton: Skeleton) -> list[str]:
    """`start-end` of the limbs that PCP counts: the ten of the Shelf protocol, else the skeleton's bones."""
    if skeleton.name == SHELF14.name:
        return list(_SHELF_LIMBS)
    return [f"{skeleton.joints[parent]}-{skeleton.joints[child]}" for parent, child in skeleton.bones]


def limb_ends(xyz: np.ndarray, skeleton: Skeleton) -> np.ndarray:
    """(..., L, 2, 3) starts and ends of the limbs of (..., J, 3) poses."""
    if skeleton.name == SHELF14.name:
        mid_hip = xyz[..., skeleton.index("l_hip", "r_hip"), :].mean(-2, keepdims=True)
        xyz = np.concatenate([xyz, mid_hip], -2)
        joints = (*skeleton.joints, "mid_hip")
        bones = [[joints.index(end) for end in limb.split("-")] for limb in _SHELF_LIMBS]
    else:
        bones = skeleton.bones
    return xyz[..., np.asarray(bones, int), :]


def match(pred: np.ndarray, truth: np.ndarray, gate: float = GATE) -> np.ndarray:
    """Which prediction is which true person, frame by frame, each at most once (Hungarian).

    The cost of a pair is the mean, over the joints that are true, of the distance cut at the gate; a
    joint not predicted costs the gate, so that a stray hand never takes the place of a whole body.
    A pair is allowed when the joints it has in common are within the gate on average. As many persons
    as can be are matched, at the least cost.

    Returns:
        (F, T) index of the prediction, -1 where a true person is missed or absent.
    """
    matches = np.full(truth.shape[:2], -1)
    distance = _distances(pred, truth)
    allowed = mean_known(distance, -1) <= gate
    cost = np.where(np.isnan(distance), gate, np.minimum(distance, gate))
    cost = mean_known(np.where(np.isnan(truth).any(-1)[:, :, None], np.nan, cost), -1)
    # Dearer than any number of allowed pairs.
    cost = np.where(allowed, cost, 1 + gate * (1 + min(cost.shape[1:])))
    for frame in np.flatnonzero(allowed.any((1, 2))):
        rows, columns = linear_sum_assignment(cost[frame])
        kept = allowed[frame, rows, columns]
        matches[frame, rows[kept]] = columns[kept]
    return matches


def match_nearest(pred: np.ndarray, truth: np.ndarray, gate: float = np.inf) -> np.ndarray:
    """As `match`, but every true person takes the prediction of the least mean distance, which may serve two."""
    mean = mean_known(_distances(pred, truth), -1)
    mean = np.where(mean <= gate, mean, np.inf)
    return np.where((mean < np.inf).any(-1), mean.argmin(-1), -1) if pred.shape[1] else np.full(truth.shape[:2], -1)


def _distances(pred: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """(F, T, P, J) m between every true person and every prediction."""
    return np.linalg.norm(pred[:, None] - truth[:, :, None].astype(np.float64), axis=-1)


def mean_known(values: np.ndarray, axis=0):
    """Mean of what is not NaN; NaN, without a warning, where nothing is."""
    known = ~np.isnan(values)
    total, count = np.where(known, values, 0).sum(axis), known.sum(axis)
    return np.divide(total, count, out=np.full(np.shape(total), np.nan), where=count > 0)[()]


def take_matched(array: np.ndarray, matches: np.ndarray, missing=np.nan) -> np.ndarray:
    """(F, T, ...) what was predicted of each true person from (F, P, ...); `missing` where there is none."""
    taken = np.full((*matches.shape, *array.shape[2:]), missing, array.dtype)
    frame, person = np.nonzero(matches >= 0)
    taken[frame, person] = array[frame, matches[frame, person]]
    return taken


def correct_limbs(matched: np.ndarray, truth: np.ndarray, skeleton: Skeleton) -> tuple[np.ndarray, np.ndarray]:
    """Percentage of correct parts, limb by limb: (d_start + d_end) / 2 <= half the true length.

    A limb with an end that was not predicted, and every limb of a missed person, is not correct.

    Args:
        matched: (F, T, J, 3) predictions in the order of the truth, from `take_matched`.

    Returns:
        correct: (F, T, L) bool.
        known: (F, T, L) bool, limbs both ends of which are true: those that count.
    """
    ends, true_ends = (limb_ends(np.asarray(xyz, np.float64), skeleton) for xyz in (matched, truth))
    error = np.linalg.norm(ends - true_ends, axis=-1).mean(-1)
    length = np.linalg.norm(true_ends[..., 1, :] - true_ends[..., 0, :], axis=-1)
    # Stored coordinates are float32; a limb at exactly the threshold must not hang on their rounding.
    return error <= 0.5 * length + 1e-6, ~np.isnan(length)


def percent(counted: np.ndarray, known: np.ndarray, axis=None):
    """100 x the share of the known that is counted; NaN where nothing is known."""
    return 100 * mean_known(np.where(known, counted, np.nan), axis)


def right_joints(matched: np.ndarray, truth: np.ndarray, threshold: float = PCK_THRESHOLD) -> np.ndarray:
    """(F, T, J) True where a predicted joint is within the threshold, m, of the true one."""
    error = np.linalg.norm(matched - truth.astype(np.float64), axis=-1)
    return np.where(np.isnan(error), np.inf, error) <= threshold


def pck(pred: np.ndarray, truth: np.ndarray, matches: np.ndarray, threshold: float = PCK_THRESHOLD) -> dict[str, float]:
    """Joints within the threshold, %: `recall` of those true, `precision` of those predicted.

    In annotated frames every joint of a prediction that matches nobody is a false one, as is a joint
    too far off; joints of a matched person that have no truth count neither way.
    """
    matched = take_matched(pred, matches)
    right = right_joints(matched, truth, threshold)
    known, predicted = ~np.isnan(truth).any(-1), ~np.isnan(pred).any(-1)
    spare = predicted & known.any((1, 2))[:, None, None]
    frame, person = np.nonzero(matches >= 0)
    spare[frame, matches[frame, person]] = False
    claimed = (known & ~np.isnan(matched).any(-1)).sum() + spare.sum()
    return {
        "recall": float(percent(right, known)),
        "precision": float(100 * right.sum() / claimed) if claimed else float("nan"),
    }


def mpjpe(matched: np.ndarray, truth: np.ndarray, counted: np.ndarray | None = None) -> float:
    """Mean distance in mm over the joints known in both (and `counted`, (F, T, J)); NaN if there are none."""
    error = np.linalg.norm(matched - truth.astype(np.float64), axis=-1)
    return 1000 * float(mean_known(error if counted is None else np.where(counted, error, np.nan), None))


def shares(source: np.ndarray, known: np.ndarray) -> dict[str, float]:
    """How much of what is true is measured, denoised, completed, absent, in %.

    Args:
        source: (F, T, J) `Source` of the matched predictions, ABSENT for missed persons.
        known: (F, T, J) joints that are true.
    """
    return {kind.name.lower(): float(percent(source == kind, known)) for kind in Source}


def identity_switches(matches: np.ndarray) -> int:
    """How often a true person is matched to another prediction than when last matched.

    Two predictions of one person that take turns at being the nearer count every time.
    """
    switches = 0
    for person in matches.T:
        seen = person[person >= 0]
        switches += int((seen[1:] != seen[:-1]).sum())
    return switches


def idf1(pred: np.ndarray, truth: np.ndarray, gate: float = GATE) -> float:
    """Identity F1 score (Ristani et al. 2016), %; NaN where nobody is there or predicted.

    Each true person is given one prediction for the whole clip, or none, and each prediction one person
    or none, so that they are together in as many frames as can be: apart by no more than the gate, on
    the average of the joints both have. Twice those frames, of all frames of true persons and of
    predictions. Where not everybody is annotated it is too low.
    """
    here, predicted = (~np.isnan(xyz).any(-1) for xyz in (truth, pred))
    total = here.any(-1).sum() + (predicted.any(-1) & here.any((1, 2))[:, None]).sum()
    together = (mean_known(_distances(pred, truth), -1) <= gate).sum(0)
    found = together[linear_sum_assignment(together, maximize=True)].sum()
    return float(200 * found / total) if total else float("nan")


def gap_lengths(observed: np.ndarray) -> np.ndarray:
    """Of (F, ...) what is observed: the length in frames of the hidden stretch around each entry, 0 if observed."""
    before, after = neighbours(observed)
    return np.where(observed, 0, after - before - 1)


def error_by_gap(matched: np.ndarray, truth: np.ndarray, lengths: np.ndarray, cov: np.ndarray) -> list[dict]:
    """What became of joints that were hidden, by how long they were.

    Args:
        matched: (F, T, J, 3) filled predictions in the order of the truth.
        lengths: (F, T, J) frames at 25/s that each joint was hidden for around, 0 where it was not.
        cov: (F, T, J, 3, 3) m^2, of the predictions; NaN where unknown.

    Returns:
        One entry for each of `GAPS`: `frames`, how many true joints were `hidden`, how many of them were
        `filled`, and the `mpjpe` of those in mm; of how many the covariance is `stated`, and the share in % of
        those that are within their regions of `SHARE`, `held`.
    """
    known, filled = ~np.isnan(truth).any(-1), ~np.isnan(matched).any(-1)
    within = in_region(matched - truth.astype(np.float64), cov)
    entries = []
    for low, high in GAPS:
        inside = (lengths >= low) & (lengths <= (high or np.inf)) & known
        entries.append({
            "frames": f"{low}-{high}" if high else f">{low - 1}",
            "hidden": int(inside.sum()),
            "filled": int((inside & filled).sum()),
            "mpjpe": mpjpe(matched, truth, inside),
            "stated": int((inside & ~np.isnan(within)).sum()),
            "held": 100 * float(mean_known(np.where(inside, within, np.nan), None)),
        })  # fmt: skip
    return entries


def in_region(error: np.ndarray, cov: np.ndarray) -> np.ndarray:
    """(...) 1 where errors (..., 3) lie within the ellipsoids of probability `SHARE` of Gaussians of those covariances
    (..., 3, 3), 0 where they do not, NaN where either is unknown."""
    within = np.full(error.shape[:-1], np.nan)
    known = ~np.isnan(error).any(-1) & ~np.isnan(cov).any((-1, -2))
    e, c = error[known], cov[known].astype(np.float64)
    within[known] = (e * np.linalg.solve(c, e[..., None])[..., 0]).sum(-1) <= RADIUS**2
    return within


def published_pcp(pred: np.ndarray, truth: np.ndarray, skeleton: Skeleton, actors: Sequence[int]) -> dict[str, float]:
    """Average PCP of some true persons as published tables have it, for comparison only.

    `mvpose`: the nearest prediction, however far, which may serve two. `4da`: Hungarian, missed persons
    not counted. `hkbu`: the nearest within 0.5 m.
    """
    found = {
        "mvpose": match_nearest(pred, truth),
        "4da": match(pred, truth, 100.0),
        "hkbu": match_nearest(pred, truth, GATE),
    }
    scores = {}
    for protocol, matches in found.items():
        correct, known = correct_limbs(take_matched(pred, matches), truth, skeleton)
        if protocol == "4da":
            known &= (matches >= 0)[..., None]
        scores[protocol] = float(mean_known(percent(correct, known, (0, 2))[list(actors)]))
    return scores
