"""Metrics of joints: shares by source, PCK, position errors, and whether they are in the regions that poses state."""

import numpy as np

from dmae.data.clip import Source
from dmae.metrics.comparison import Comparison, take_matched
from dmae.metrics.registry import Column, metric
from dmae.numerics.statistics import mean_known


def percent(counted: np.ndarray, known: np.ndarray, axis=None):
    """Return the percentage of the `known` entries that are `counted`, over some axes; NaN where nothing is known."""
    return 100 * mean_known(np.where(known, counted, np.nan), axis)


def source_shares(source: np.ndarray, known: np.ndarray) -> dict[str, float]:
    """Return the percentages of the known joints (F, T, J) that are absent, measured, denoised and completed.

    `source` (F, T, J) are the matched predictions', ABSENT for missed persons.
    """
    return {kind.name.lower(): float(percent(source == kind, known)) for kind in Source}


@metric(
    "shares",
    order=7,
    columns=(
        Column("filled", "%", lambda shares: shares["completed"], order=3),
        Column("absent", "%", lambda shares: shares["absent"], order=4),
    ),
)
def _shares(comparison: Comparison) -> dict[str, float]:
    """True joints that are absent, measured, denoised, completed, %."""
    return source_shares(comparison.source, comparison.known)


PCK_THRESHOLD = 0.2
"""m. The 0.2 of PCK@0.2 is in metres in multi-person capture, not in torso sizes as in single images. It applies to
bodies of human size, and is scaled with the size of other bodies."""


def joints_within_threshold(comparison: Comparison) -> np.ndarray:
    """Return (F, T, J) True where a joint is within 0.2 m, scaled with the size of the body, of the true joint."""
    return correct_joints(comparison.matched, comparison.truth.xyz, comparison.scale * PCK_THRESHOLD)


def correct_joints(matched: np.ndarray, truth: np.ndarray, threshold: float = PCK_THRESHOLD) -> np.ndarray:
    """Return (F, T, J) True where a predicted joint is within the threshold, m, of the true joint."""
    error = np.linalg.norm(matched - truth.astype(np.float64), axis=-1)
    return np.where(np.isnan(error), np.inf, error) <= threshold


def pck(pred: np.ndarray, truth: np.ndarray, matches: np.ndarray, threshold: float = PCK_THRESHOLD) -> dict[str, float]:
    """Return the % of joints within the threshold, m: `recall` of true joints, `precision` of predicted ones.

    In annotated frames, joints that are too far off, and all joints of a prediction without a match, are false
    positives. Joints of a matched person without a true position do not count. Predictions are (F, P, J, 3) m, truth
    (F, T, J, 3) m, and matches (F, T) from `match`.
    """
    matched = take_matched(pred, matches)
    correct = correct_joints(matched, truth, threshold)
    known, predicted = ~np.isnan(truth).any(-1), ~np.isnan(pred).any(-1)
    spare = predicted & known.any((1, 2))[:, None, None]
    frame, person = np.nonzero(matches >= 0)
    spare[frame, matches[frame, person]] = False
    claimed = (known & ~np.isnan(matched).any(-1)).sum() + spare.sum()
    return {
        "recall": float(percent(correct, known)),
        "precision": float(100 * correct.sum() / claimed) if claimed else float("nan"),
    }


@metric(
    "pck",
    order=5,
    columns=(
        Column("recall", "%", lambda score: score["recall"], order=1),
        Column("precision", "%", lambda score: score["precision"], order=2),
    ),
)
def _pck(comparison: Comparison) -> dict[str, float]:
    """PCK@0.2: recall and precision of joints within 0.2 m, %; precision is too low where persons lack annotation."""
    threshold = comparison.scale * PCK_THRESHOLD
    return pck(comparison.pred.xyz, comparison.truth.xyz, comparison.matches, threshold)


REGION_PROBABILITY = 0.9
"""Probability of the regions by which stated covariances are judged."""

REGION_RADIUS = 2.5003
"""Standard deviations of an isotropic Gaussian in three dimensions within which that probability lies."""


def in_region(error: np.ndarray, cov: np.ndarray) -> np.ndarray:
    """Return 1 for errors (..., 3) m inside the ellipsoid that contains `REGION_PROBABILITY` of a Gaussian, or else 0.

    `cov` (..., 3, 3) are covariances of the Gaussians, m^2. NaN where either is unknown, or a covariance is singular.
    """
    squared = squared_deviations(error, cov)
    return np.where(np.isnan(squared), np.nan, squared <= REGION_RADIUS**2)


def squared_deviations(error: np.ndarray, cov: np.ndarray) -> np.ndarray:
    """Return the squares (...) of errors (..., 3) in standard deviations of Gaussians; NaN as in `in_region`."""
    squared = np.full(error.shape[:-1], np.nan)
    known = np.isfinite(error).all(-1) & np.isfinite(cov).all((-1, -2))
    known[known] = np.linalg.det(cov[known].astype(np.float64)) > 0
    solved = np.linalg.solve(cov[known].astype(np.float64), error[known][..., None])[..., 0]
    squared[known] = (error[known] * solved).sum(-1)
    return squared


GAPS = ((1, 5), (6, 15), (16, 40), (41, None))
"""Classes of gaps: the shortest and the longest gap of each class, in frames at 25 frames/s."""
GAP_NAMES = [f"{low}-{high}" if high else f">{low - 1}" for low, high in GAPS]


def mpjpe(matched: np.ndarray, truth: np.ndarray, counted: np.ndarray | None = None) -> float:
    """Return the mean distance, mm, over the `counted` joints (by default all) known in both; NaN if there are none.

    `matched` (F, T, J, 3) m are predictions in the order of the truth, from `take_matched`.
    """
    error = np.linalg.norm(matched - truth.astype(np.float64), axis=-1)
    return 1000 * float(mean_known(error if counted is None else np.where(counted, error, np.nan), None))


def error_by_gap(matched: np.ndarray, truth: np.ndarray, lengths: np.ndarray, cov: np.ndarray) -> list[dict]:
    """Return the errors of joints in gaps, by the length of the gap.

    Args:
        matched: (F, T, J, 3) filled predictions in the order of the truth, m.
        truth: (F, T, J, 3) m.
        lengths: (F, T, J) length of the gap around each joint, in frames at 25 frames/s; 0 where it was measured.
        cov: (F, T, J, 3, 3) covariance of the predictions, m^2; NaN where unknown.

    Returns:
        One entry for each of `GAPS`: `frames`, the class; `hidden`, the number of true joints in gaps of the class;
        `filled`, the number of filled joints; `mpjpe` of filled joints, mm; `stated`, the number of joints with a
        covariance; `held`, the percentage of these with a true position inside the stated region (`in_region`).
    """
    known, filled = ~np.isnan(truth).any(-1), ~np.isnan(matched).any(-1)
    within = in_region(matched - truth.astype(np.float64), cov)
    entries = []
    for name, (low, high) in zip(GAP_NAMES, GAPS, strict=True):
        inside = (lengths >= low) & (lengths <= (high or np.inf)) & known
        entries.append({
            "frames": name,
            "hidden": int(inside.sum()),
            "filled": int((inside & filled).sum()),
            "mpjpe": mpjpe(matched, truth, inside),
            "stated": int((inside & ~np.isnan(within)).sum()),
            "held": 100 * float(mean_known(np.where(inside, within, np.nan), None)),
        })  # fmt: skip
    return entries


def pool_gaps(runs: list[list[dict]]) -> list[dict]:
    """Pool the errors by gap of several runs: counts are added, and errors are averaged over joints."""

    def mean(entries: tuple[dict, ...], value: str, count: str) -> float:
        total = sum(entry[count] for entry in entries)
        return sum(entry[count] * entry[value] for entry in entries if entry[count]) / total if total else float("nan")

    counts = ("hidden", "filled", "stated")
    return [
        {
            "frames": entries[0]["frames"],
            **{count: sum(entry[count] for entry in entries) for count in counts},
            "mpjpe": mean(entries, "mpjpe", "filled"),
            "held": mean(entries, "held", "stated"),
        }
        for entries in zip(*runs, strict=True)
    ]


@metric(
    "mpjpe",
    order=6,
    columns=(
        Column("MPJPE", "mm", lambda score: score["all"], order=5),
        Column("measured", "mm", lambda score: score["measured"], order=6),
    ),
)
def _mpjpe(comparison: Comparison) -> dict[str, float]:
    """MPJPE of all joints, of those that cameras measured, denoised or not, and of completed ones, mm."""
    matched, truth = comparison.matched, comparison.truth.xyz
    return {
        "all": mpjpe(matched, truth),
        "measured": mpjpe(matched, truth, take_matched(comparison.pred.measured, comparison.matches, False)),
        "completed": mpjpe(matched, truth, comparison.source == Source.COMPLETED),
    }


@metric("hidden", order=8, columns=(Column("unmeasured", "mm", lambda score: score["mpjpe"], order=7),))
def _hidden(comparison: Comparison) -> dict[str, float]:
    """PCK@0.2 recall, %, and MPJPE, mm, of the true joints that capture did not measure."""
    return {
        "recall": float(percent(joints_within_threshold(comparison), comparison.known & comparison.hidden)),
        "mpjpe": mpjpe(comparison.matched, comparison.truth.xyz, comparison.hidden),
    }


@metric("gaps", order=9, pool=pool_gaps)
def _gaps(comparison: Comparison) -> list[dict]:
    """MPJPE, mm, and shares within stated regions, %, by the length of the gap."""
    compared, matched = comparison.compared, comparison.matched
    if compared is not None:
        matched = np.where(compared[..., None], matched, np.nan)
    return error_by_gap(matched, comparison.truth.xyz, comparison.gap_lengths, comparison.cov)
