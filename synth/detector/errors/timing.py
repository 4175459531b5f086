"""Errors of exposure times: unsynchronised cameras, and rolling shutters."""

from dataclasses import dataclass, replace

import numpy as np

from dmae.data.labels import Visibility
from synth.detector.ranges import check_amounts
from synth.detector.view import ErrorStream, View


@dataclass(frozen=True)
class Timing:
    """Cameras that do not expose their images at the times of the frames."""

    unsynchronised: float = 0.0
    """Frames: the images of each view are shifted in time by a constant, drawn uniformly from minus to plus this
    value."""
    rolling_shutter: float = 0.0
    """s; from the exposure of an image's first row to that of its last."""

    def __post_init__(self):
        check_amounts("timing", self, ("unsynchronised", "rolling_shutter"))

    def apply(self, view: View) -> View:
        """Move the truth of a view to the times of exposure.

        Positions are interpolated in the image, and extrapolated up to one frame beyond the ends of the clip.
        Visibility is taken from the nearest frame. Farther beyond the ends, nothing is known or detected.
        """
        frames, xy = len(view.true_xy), view.true_xy
        if not (self.unsynchronised or self.rolling_shutter) or frames < 2:
            return view
        time = np.arange(frames)[:, None, None] + self.unsynchronised * view.random(ErrorStream.TIMING).uniform(-1, 1)
        # Rows are taken at the time of the frame, because people move only a few rows while an image is read out.
        row = np.clip(np.nan_to_num(xy[..., 1]), 0, view.size[1])
        time = time + row / view.size[1] * self.rolling_shutter * view.fps
        before = np.clip(np.floor(time).astype(int), 0, frames - 2)
        after = (time - before)[..., None]
        person, joint = np.ogrid[: xy.shape[1], : xy.shape[2]]
        moved = xy[before, person, joint] * (1 - after) + xy[before + 1, person, joint] * after
        nearest = np.clip(np.rint(time).astype(int), 0, frames - 1)
        known = (time >= -1) & (time <= frames)
        code, occluder = view.visibility[nearest, person, joint], view.occluder[nearest, person, joint]
        with np.errstate(invalid="ignore"):
            inside = ((moved >= -0.5) & (moved <= view.size - 0.5)).all(-1)
        # A person that leaves the image between two frames is not visible outside it. Other joints keep their codes.
        code = np.where(~inside & (code <= Visibility.HIDDEN_BY_OBJECT), Visibility.OUTSIDE_IMAGE, code)
        moved = np.where(known[..., None], moved, np.nan)
        code = np.where(known, code, Visibility.ABSENT)
        return replace(view, true_xy=moved, xy=moved, visibility=code, occluder=occluder)
