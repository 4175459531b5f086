"""False positives: tracks without a person, from ghosts of the detector that agree by coincidence."""

import numpy as np

from dmae.files.mapped import by_frames, total
from dmae.reconstruction.association import NONE
from dmae.reconstruction.config import CaptureConfig
from dmae.reconstruction.tracks import Tracks

_MIN_AGREEMENT = 0.75
"""Smallest share of joints on which the views agree, among the joints that enough views detected. The share of people
is above 0.9, that of ghosts that line up by coincidence about 0.5."""


def false_positives(tracks: Tracks, measured: np.ndarray, frames: int, fps: float, config: CaptureConfig) -> np.ndarray:
    """Return (P,) True for tracks without a person: too brief tracks, and tracks with views that agree by coincidence.

    Args:
        measured: (P,) number of frames in which each track was measured, see `well_measured`.
        frames: Number of frames of the recording.
    """
    return too_brief(measured, frames, fps, config.tracking.min_duration_s) | coincidental(tracks, config.th_v)


def well_measured(tracks: Tracks, joints: int) -> np.ndarray:
    """Return (F, P) True where a person has at least this number of joints, and views do not agree by coincidence."""
    known = by_frames(lambda xyz: (~np.isnan(xyz[..., 0])).sum(-1), tracks.xyz)
    return (known >= joints) & tracks.supported


def too_brief(measured: np.ndarray, frames: int, fps: float, min_duration_s: float) -> np.ndarray:
    """Return (P,) True for tracks measured in fewer frames than the shortest duration or half the recording."""
    return measured < min(min_duration_s * fps, frames / 2)


def coincidental(tracks: Tracks, views: int) -> np.ndarray:
    """Return (P,) True for tracks of detections that belong to different figures and line up by coincidence.

    Args:
        views: Number of views. Nearly all joints of a person that this number of views detect can be triangulated.
    """
    detected = total(lambda assigned: ((assigned != NONE).sum(2) >= views).sum(-1), tracks.assigned)
    return total(lambda xyz: (~np.isnan(xyz[..., 0])).sum(-1), tracks.xyz) < _MIN_AGREEMENT * detected
