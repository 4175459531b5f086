"""Check confidences of detected joints: 0 means that a joint is absent, and impossible confidences are counted."""

from dataclasses import dataclass

import numpy as np


@dataclass
class Confidences:
    """Makes joints without a positive confidence absent, and counts joints with an impossible confidence.

    Attributes:
        odd: Number of joints with x and y, but with a negative or null confidence.
        first: File and field of the first of these joints.
    """

    odd: int = 0
    first: str = ""

    def clean(self, place: str, joints: np.ndarray) -> np.ndarray:
        """Return joints (..., 3), x, y and confidence; NaN where the confidence is not positive.

        Args:
            place: File and field of the joints, for the note.
            joints: (..., 3) x, y and confidence as the file states them.
        """
        confidence = joints[..., 2]
        odd = np.isfinite(joints[..., :2]).all(-1) & ((confidence < 0) | np.isnan(confidence))
        if odd.any():
            self.first = self.first or place
            self.odd += int(odd.sum())
        return np.where(confidence[..., None] > 0, joints, np.nan)

    @property
    def notes(self) -> tuple[str, ...]:
        """A note on the joints that were made absent; empty if all confidences were possible."""
        if not self.odd:
            return ()
        joints = (
            "1 joint has a negative or null confidence and is"
            if self.odd == 1
            else (f"{self.odd} joints have a negative or null confidence and are")
        )
        return (f"{joints} treated as absent, first in {self.first}",)
