"""A hypothesis about a recording: cameras and detections as they were read, or as a correction changes them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dmae.data.cameras import CameraRig
from dmae.data.clip import Clip
from dmae.data.skeleton import Skeleton
from dmae.formats.calibrations.conventions import Convention

CHECKED_FRAMES = 150
"""Frames sampled to check what fewer frames suggest."""
_MIN_JOINTS = 6
"""Fewest joints of a detection that is compared."""
_FINE = ("eye", "ear", "toe", "heel")
"""Joints so near to others that they add no information."""


@dataclass(frozen=True)
class Hypothesis:
    """Cameras and detections of F frames, V views, D detections a view, J joints.

    Attributes:
        rig: V cameras.
        xy: (F, V, D, J, 2) px; NaN where absent.
        skeleton: J joints.
        offsets: (V,) frames by which the detections of each camera are delayed.
        convention: How the files are assumed to write the world and the extrinsics.
    """

    rig: CameraRig
    xy: np.ndarray
    skeleton: Skeleton
    offsets: np.ndarray
    convention: Convention

    @classmethod
    def of(cls, clip: Clip, convention: Convention) -> Hypothesis:
        """Return a clip as it was read, without detections of few joints and without small joints of face and feet."""
        skeleton, xy = clip.detections.skeleton, clip.detections.xy.astype(np.float64)
        kept = [i for i, joint in enumerate(skeleton.joints) if not joint.endswith(_FINE)]
        joints = clip.detections.observed[..., kept].sum(-1)
        xy[joints < _MIN_JOINTS] = np.nan
        fullest_first = np.argsort(-joints, axis=-1, kind="stable")
        most = int((joints >= _MIN_JOINTS).sum(-1).max(initial=0))
        xy = np.take_along_axis(xy[..., kept, :], fullest_first[..., None, None], 2)[:, :, :most]
        part = Skeleton(skeleton.name, tuple(skeleton.joints[i] for i in kept), (-1,) * len(kept))
        return cls(clip.rig, xy, part, np.zeros(len(clip.rig), int), convention)

    def delayed(self, frames: np.ndarray) -> Hypothesis:
        """Return the hypothesis with the detections of each camera delayed by further frames (V,)."""
        return replace(self, offsets=self.offsets + frames)

    def sample_frames(self, most: int) -> np.ndarray:
        """Return up to `most` frames, evenly spread over those in which two views or more detect people."""
        frames = np.flatnonzero(np.isfinite(self.xy[..., 0]).any((2, 3)).sum(1) >= 2)
        return frames[np.unique(np.linspace(0, max(len(frames) - 1, 0), most).astype(int))] if len(frames) else frames
