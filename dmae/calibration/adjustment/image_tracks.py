"""Image tracks: the positions of tracked people in the images of each view.

F frames, P people, V views, J joints.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dmae.calibration.adjustment.parameters import Calibration
from dmae.data.skeleton import Skeleton


@dataclass(frozen=True)
class ImageTracks:
    """The image positions of tracked people.

    Attributes:
        skeleton: J joints.
        fps: 1/s.
        xy: (F, P, V, J, 2) px, distorted; NaN where absent.
        sigma: (F, P, V, J) m, expected error of each position at the depth of the person; NaN where absent.
        start: (F, P, J, 3) m, a first estimate of the joints; NaN where unknown.
        aligned: V cameras, each aligned separately with these people.
    """

    skeleton: Skeleton
    fps: float
    xy: np.ndarray
    sigma: np.ndarray
    start: np.ndarray
    aligned: Calibration

    def select(self, views: list[int]) -> ImageTracks:
        """Return the tracks in some views."""
        return replace(self, xy=self.xy[:, :, views], sigma=self.sigma[:, :, views], aligned=self.aligned[views])
