"""Observations: detected positions of the joints of bodies, at any time between frames.

M bodies, each a person at one time; V views, J joints.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dmae.calibration.adjustment.image_tracks import ImageTracks
from dmae.calibration.adjustment.parameters import Calibration

_LINE_FRAMES = 2
"""Number of frames before and after a time to which a line is fitted."""
_MOST_SHARE = 0.04
"""Largest movement of a joint from frame to frame, as a share of the image's diagonal."""


@dataclass(frozen=True)
class Observations:
    """Detections of M bodies.

    Attributes:
        tracks: The tracks that contain the bodies.
        frame, person: (M,) indices of each body.
        start: (M, J, 3) m, a first estimate of the joints; NaN where unknown.
    """

    tracks: ImageTracks
    frame: np.ndarray
    person: np.ndarray
    start: np.ndarray

    @classmethod
    def of(cls, tracks: ImageTracks, calibration: Calibration, most: int, frames: np.ndarray | None = None):
        """Return up to `most` bodies, evenly spread over all frames or over the given ones.

        If a frame has too many bodies, those that more views see are preferred.
        """
        seen = np.isfinite(tracks.sigma).sum(-1) >= 4
        usable = (seen.sum(-1) >= 2) & np.isfinite(tracks.start[..., 0]).any(-1)
        if frames is not None:
            usable &= np.isin(np.arange(len(usable)), frames)[:, None]
        frame, person = np.nonzero(usable)
        chosen = np.unique(np.linspace(0, len(frame) - 1, min(most, len(frame))).astype(int)) if len(frame) else []
        frame, person = frame[chosen], person[chosen]
        return cls(tracks, frame, person, tracks.start[frame, person])

    def __len__(self) -> int:
        return len(self.frame)

    def at(self, bodies: np.ndarray) -> Observations:
        """Return some of the bodies."""
        return replace(self, frame=self.frame[bodies], person=self.person[bodies], start=self.start[bodies])

    def bodies_a_second(self) -> float:
        """Return the largest number of bodies of one person per second."""
        seconds = np.ptp(self.frame) / self.tracks.fps + 1 / self.tracks.fps if len(self) else 1.0
        return len(self) / max(len(np.unique(self.person)), 1) / seconds

    def seen(self, calibration: Calibration) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the detections of each body in the cameras, given their clocks.

        Returns:
            xy: (M, V, J, 2) px.
            velocity: (M, V, J, 2) px/s; 0 where unknown.
            sigma: (M, V, J) m, expected error at the depth of the body; NaN where xy is.
        """
        tracks, fps = self.tracks, self.tracks.fps
        view = np.arange(len(calibration.rig))
        shift = (calibration.offset + calibration.drift * self.frame[:, None] / fps) * fps
        whole = np.rint(shift).astype(int)
        place, velocity = self._line(whole, view, np.linalg.norm(calibration.rig.size, axis=-1)[:, None, None])
        xy = place + velocity * (shift - whole)[..., None, None]
        sigma = self._sample(tracks.sigma, whole, view)
        velocity = np.nan_to_num(velocity) * fps
        return xy, velocity, sigma

    def _line(self, shift: np.ndarray, view: np.ndarray, diagonal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return position (M, V, J, 2), px, and velocity, px/frame, of a line fitted to the frames around each time.

        The noise of a line is the same between frames as on them. Interpolation between two frames has the least noise
        half way between them, so that any camera would seem to be half a frame late.
        """
        middle = self._sample(self.tracks.xy, shift, view)
        n = k1 = k2 = x = kx = 0
        for k in range(-_LINE_FRAMES, _LINE_FRAMES + 1):
            off = self._sample(self.tracks.xy, shift + k, view) - middle
            # A jump means another person or a gross error.
            known = np.abs(off) < _MOST_SHARE * diagonal * (abs(k) + 1)
            off = np.where(known, off, 0)
            n, k1, k2, x, kx = n + known, k1 + k * known, k2 + k * k * known, x + off, kx + k * off
        spread = n * k2 - k1 * k1
        velocity = np.where(spread > 0, (n * kx - k1 * x) / np.maximum(spread, 1), 0)
        return middle + (x - velocity * k1) / np.maximum(n, 1), velocity

    def _sample(self, array: np.ndarray, shift: np.ndarray, view: np.ndarray) -> np.ndarray:
        """Return (M, V, ...) of an array (F, P, V, ...), shifted by frames (M, V); NaN outside of the clip."""
        row = self.frame[:, None] + shift
        inside = (row >= 0) & (row < len(array))
        found = array[np.where(inside, row, 0), self.person[:, None], view]
        return np.where(inside.reshape(*inside.shape, *(1,) * (found.ndim - 2)), found, np.nan)
