"""MPJPE, the mean per-joint position error: of all joints, by their source, and by the length of gaps."""

import numpy as np

from dmae.data.clip import Source
from dmae.metrics.comparison import Comparison
from dmae.metrics.pck import joints_within_threshold
from dmae.metrics.percentage import percent
from dmae.metrics.registry import Column, metric
from dmae.metrics.uncertainty import in_region
from dmae.numerics.statistics import mean_known

GAPS = ((1, 5), (6, 15), (16, 40), (41, None))
"""Classes of gaps: the shortest and the longest gap of each class, in frames at 25 frames/s."""


def mpjpe(matched: np.ndarray, truth: np.ndarray, counted: np.ndarray | None = None) -> float:
    """Return the mean distance, mm, over the `counted` joints that are known in both; NaN if there are none.

    Args:
        matched: (F, T, J, 3) predictions in the order of the truth, from `take_matched`, m.
        truth: (F, T, J, 3) m.
        counted: (F, T, J) True for joints that count; by default all.
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
        Column("seen", "mm", lambda score: score["measured" if score["denoised"] is None else "denoised"], order=6),
    ),
)
def _mpjpe(comparison: Comparison) -> dict[str, float]:
    """MPJPE of all joints, and of measured, denoised and completed ones, mm."""
    kinds = [kind for kind in Source if kind != Source.ABSENT]
    matched, truth = comparison.matched, comparison.truth.xyz
    return {"all": mpjpe(matched, truth)} | {
        kind.name.lower(): mpjpe(matched, truth, comparison.source == kind) for kind in kinds
    }


@metric("hidden", order=8, columns=(Column("hidden", "mm", lambda score: score["mpjpe"], order=7),))
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
