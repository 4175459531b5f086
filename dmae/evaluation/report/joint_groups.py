"""Counts and errors of a group of joints, which add up over clips without keeping their joints."""

from dataclasses import dataclass

import numpy as np

from dmae.data.clip import Source

BINS = 2000
"""Errors are counted in bins of one unit, mm or px; the last holds all larger ones."""


@dataclass(frozen=True)
class JointGroup:
    """A group of joints.

    Attributes:
        joints: Number of joints.
        completed: Number of completed joints.
        missing: Number of absent joints.
        compared: Number of joints with an error.
        total: Sum of the errors.
        histogram: (BINS,) counts of errors by their whole number of units.
    """

    joints: int
    completed: int
    missing: int
    compared: int
    total: float
    histogram: np.ndarray

    def __add__(self, other: "JointGroup") -> "JointGroup":
        return JointGroup(
            self.joints + other.joints,
            self.completed + other.completed,
            self.missing + other.missing,
            self.compared + other.compared,
            self.total + other.total,
            self.histogram + other.histogram,
        )

    @property
    def mean(self) -> float | None:
        """Mean error; None if no joint has an error."""
        return self.total / self.compared if self.compared else None

    def quantile(self, share: float) -> float | None:
        """Return the error that this share of joints does not exceed, within one unit; None without errors."""
        if not self.compared:
            return None
        counts = np.cumsum(self.histogram)
        bin = int(np.searchsorted(counts, share * self.compared))
        before = counts[bin - 1] if bin else 0
        return bin + (share * self.compared - before) / max(self.histogram[bin], 1)


def tally(error: np.ndarray, source: np.ndarray) -> JointGroup:
    """Return the tally of joints.

    Args:
        error: (...) errors, mm or px; NaN where there is none.
        source: (...) `Source` of each joint.
    """
    known = error[np.isfinite(error)]
    return JointGroup(
        source.size,
        int((source == Source.COMPLETED).sum()),
        int((source == Source.ABSENT).sum()),
        len(known),
        float(known.sum(dtype=np.float64)),
        np.bincount(np.minimum(known, BINS - 1).astype(int), minlength=BINS),
    )


def added(first: dict[str, JointGroup], second: dict[str, JointGroup]) -> dict[str, JointGroup]:
    """Return two sets of groups as one; groups of the same name add up."""
    return {
        name: first[name] + second[name] if name in first and name in second else (first.get(name) or second[name])
        for name in [*first, *(name for name in second if name not in first)]
    }
