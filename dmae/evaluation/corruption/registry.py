"""The registry of corruptions: each is an axis of the stress matrix, a function under the decorator `corruption`.

The function takes a clip, a level above 0 and `rng` by keyword. It returns the clip with detections, cameras or frame
rate corrupted at that level (`docs/how-to/add.md` has an example). It never changes the truth. `clip.poses` are the
people of the clip on the skeleton of the detections, with gaps filled (`dmae.evaluation.corruption.corrupt.people_of`);
capture never reads them. As far as possible, a corruption draws the same random numbers at every level, so that a level
also hides the joints that lower levels hide.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from dmae.registry import Entry, Registry

if TYPE_CHECKING:
    from dmae.data.clip import Clip  # it loads OpenCV, which help does not need


@dataclass(frozen=True)
class Corruption(Entry):
    """An axis of the stress matrix."""

    unit: str = field(kw_only=True)  # Unit of its levels, for example "%" or "frames"
    # Levels of the full matrix, increasing. Level 0, which changes nothing, is not listed.
    levels: tuple[float, ...] = field(kw_only=True)
    small: tuple[float, ...] = field(kw_only=True)  # Levels of the small matrix
    order: int = 100  # Corruptions are applied, and listed, in this order
    most: float = float("inf")  # Greatest possible level
    whole: bool = False  # Levels are whole numbers
    people: int = 0  # Smallest number of people that must be in an image at the same time
    fewer_cameras: bool = False  # A level is the number of cameras that are left out

    def check(self, level: float, clip: Clip | None = None) -> None:
        """Raise ValueError if there is no such level, or if a clip has too few cameras or people for it."""
        given = f"{self.name}={level:g}"
        if not 0 <= level <= self.most or level == float("inf") or (self.whole and level % 1):
            most = "more" if self.most == float("inf") else f"up to {self.most:g}"
            whole = "a whole number, " if self.whole else ""
            raise ValueError(f"{given}: expected {whole}0 or {most}, in {self.unit}")
        if clip is None or not level:
            return
        cameras = len(clip.rig)
        if self.fewer_cameras and cameras - level < 2:
            raise ValueError(
                f"{given}: clip {clip.id!r} has {cameras} cameras, and two must be left; expected levels up to "
                f"{cameras - 2}"
            )
        people = int(clip.detections.observed.any(-1).sum(-1).max(initial=0))
        if people < self.people:
            raise ValueError(
                f"{given}: expected {self.people} people or more in an image, clip {clip.id!r} has at most {people}; "
                "leave this corruption out"
            )


corruption = Registry("corruption", Corruption, __package__, option="axes", plain=False, returns=("Clip",))
find_corruption = corruption.find


def corruptions() -> list[Corruption]:
    """Return all corruptions in their order."""
    return sorted(corruption.values(), key=lambda each: (each.order, each.name))
