"""Confidences of detected joints: 0 says that a joint is absent, and what is no confidence is noted."""

from dataclasses import dataclass

import numpy as np


@dataclass
class Confidences:
    """Makes joints without a positive confidence absent, and counts those with a confidence that none can be.

    Attributes:
        odd: Number of joints with a place, and a confidence that is negative or null.
        first: Place of the first of them.
    """

    odd: int = 0
    first: str = ""

    def clean(self, place: str, joints: np.ndarray) -> np.ndarray:
        """Return joints (..., 3), x, y and confidence, NaN where the confidence is not positive.

        Args:
            place: File and field, for the note.
        """
        confidence = joints[..., 2]
        odd = np.isfinite(joints[..., :2]).all(-1) & ((confidence < 0) | np.isnan(confidence))
        if odd.any():
            self.first = self.first or place
            self.odd += int(odd.sum())
        return np.where(confidence[..., None] > 0, joints, np.nan)

    @property
    def notes(self) -> tuple[str, ...]:
        """A note on what was made absent; none where all confidences were sound."""
        if not self.odd:
            return ()
        joints = (
            "1 joint has a negative or null confidence and is"
            if self.odd == 1
            else (f"{self.odd} joints have a negative or null confidence and are")
        )
        return (f"{joints} treated as absent, first in {self.first}",)
