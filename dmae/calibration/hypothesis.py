"""A hypothesis about a recording: its cameras and detections as they were read, or after a correction."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dmae.calibration.adjustment.joints import coarse_skeleton
from dmae.data.cameras import CameraRig
from dmae.data.clip import Clip, Detections2D
from dmae.data.skeleton import Skeleton
from dmae.formats.config import Convention
from dmae.formats.reading import shift_views

CHECKED_FRAMES = 150
"""Number of sampled frames for a check of a result from fewer frames."""
_MIN_JOINTS = 6
"""Smallest number of joints of a detection that is compared."""


@dataclass(frozen=True)
class Hypothesis:
    """Cameras and detections of F frames, V views, D detections per view, J joints.

    Attributes:
        rig: V cameras.
        xy: (F, V, D, J, 2) px; NaN where absent.
        score: (F, V, D, J) confidence; NaN where absent.
        skeleton: J joints.
        fps: 1/s.
        offsets: (V,) frames by which the detections of each camera are delayed.
        convention: How the files are assumed to write the world and the extrinsics.
    """

    rig: CameraRig
    xy: np.ndarray
    score: np.ndarray
    skeleton: Skeleton
    fps: float
    offsets: np.ndarray
    convention: Convention

    @classmethod
    def of(cls, clip: Clip, convention: Convention) -> Hypothesis:
        """Return a clip as it was read, without detections of few joints and without small joints of face and feet."""
        skeleton, xy = clip.detections.skeleton, clip.detections.xy.astype(np.float64)
        part, kept = coarse_skeleton(skeleton)
        joints = clip.detections.observed[..., kept].sum(-1)
        xy[joints < _MIN_JOINTS] = np.nan
        fullest_first = np.argsort(-joints, axis=-1, kind="stable")
        most = int((joints >= _MIN_JOINTS).sum(-1).max(initial=0))
        xy = np.take_along_axis(xy[..., kept, :], fullest_first[..., None, None], 2)[:, :, :most]
        score = np.take_along_axis(clip.detections.score[..., kept], fullest_first[..., None], 2)[:, :, :most]
        score = np.where(np.isnan(xy[..., 0]), np.nan, score)
        return cls(clip.rig, xy, score, part, clip.fps, np.zeros(len(clip.rig), int), convention)

    def clip(self) -> Clip:
        """Return cameras and detections, synchronised, as a clip."""
        found = Detections2D(self.skeleton, self.xy, np.where(np.isnan(self.xy[..., 0]), np.nan, self.score))
        return shift_views(Clip("examined", self.fps, self.rig, found), self.offsets.tolist())

    def delayed(self, frames: np.ndarray) -> Hypothesis:
        """Return the hypothesis with the detections of each camera delayed by further frames (V,)."""
        return replace(self, offsets=self.offsets + frames)

    def sample_frames(self, most: int) -> np.ndarray:
        """Return up to `most` frames, evenly spread over the frames in which at least two views detect people."""
        frames = np.flatnonzero(np.isfinite(self.xy[..., 0]).any((2, 3)).sum(1) >= 2)
        return frames[np.unique(np.linspace(0, max(len(frames) - 1, 0), most).astype(int))] if len(frames) else frames
