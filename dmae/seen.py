"""The detections of a clip, made ready to be compared with each other and with people."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING

import numpy as np

from dmae.associate import NONE
from dmae.cameras import CameraRig
from dmae.clip import Clip
from dmae.triangulate import Points, triangulate

if TYPE_CHECKING:
    from dmae.capture import CaptureConfig


class Unit(StrEnum):
    """What distances in an image are measured in."""

    metres = "metres"
    """On the person: px x depth / focal length."""
    diagonals = "diagonals"
    """Diagonals of the image."""


@dataclass(frozen=True)
class Seen:
    """The confident detections (F, V, D, J) of a clip, ready to be compared.

    Attributes:
        rig: Pinhole cameras that see undistorted pixels.
        xy: (F, V, D, J, 2) undistorted px, NaN where absent.
        confidence: (F, V, D, J) in [0, 1], NaN where absent.
        config: How to compare them.
    """

    rig: CameraRig
    xy: np.ndarray
    confidence: np.ndarray
    config: CaptureConfig

    @classmethod
    def of(cls, clip: Clip, least: float, config: CaptureConfig) -> Seen:
        """Joint-level filtering: the detections of at least some confidence, undistorted."""
        xy, score = clip.detections.xy, clip.detections.score.astype(np.float64)
        confident = (score >= least) & np.isfinite(xy).all(-1)
        xy = clip.rig.undistort(np.where(confident[..., None], xy, np.nan))
        return cls(clip.rig.undistorted, xy, np.where(confident, np.clip(score, 0, 1), np.nan), config)

    def triangulate(self, frame: int | np.ndarray, chosen: np.ndarray, steps: int = 8) -> Points:
        """The joints (..., J) made of the chosen detections, (..., V, J) indices or `NONE`, of frames (..., 1, 1)."""
        view, joint = np.arange(len(self.rig))[:, None], np.arange(chosen.shape[-1])
        absent = chosen == NONE
        xy = np.where(absent[..., None], np.nan, self.xy[frame, view, chosen, joint])
        confidence = np.where(absent, np.nan, self.confidence[frame, view, chosen, joint])
        points = triangulate(self.rig, xy.swapaxes(-3, -2), confidence.swapaxes(-2, -1), self.config.noise, steps)
        points.xyz[points.views < self.config.th_v] = np.nan
        return points

    def distance(self, frames: slice, xyz: np.ndarray, unit: Unit) -> np.ndarray:
        """(F, V, P, D, J) from the reprojections of people (F, P, J, 3) to the detections of those frames."""
        pixels, depth = self.rig.project(xyz)
        if unit == Unit.metres:
            scale = depth / np.sqrt(self.rig.K[:, 0, 0] * self.rig.K[:, 1, 1])[:, None, None]
        else:
            scale = np.broadcast_to(1 / np.hypot(*self.rig.size.T)[:, None, None], depth.shape)
        off = pixels[:, :, :, None] - self.xy[frames, :, None]
        return np.sqrt(off[..., 0] ** 2 + off[..., 1] ** 2) * scale[:, :, :, None]
