"""False positives: tracks of no person, made of ghosts of the detector that happen to agree."""

import numpy as np

from dmae.files.mapped import by_frames, total
from dmae.reconstruction.association import NONE
from dmae.reconstruction.config import CaptureConfig
from dmae.reconstruction.tracks import Tracks

_MIN_AGREEMENT = 0.75
"""Share of joints on which the views agree, among those that enough views detected: of people above 0.9, of ghosts that
happen to line up about a half."""


def false_positives(tracks: Tracks, measured: np.ndarray, frames: int, fps: float, config: CaptureConfig) -> np.ndarray:
    """Return (P,) True for tracks of no person: too brief, or their views agree only by coincidence.

    Args:
        measured: (P,) number of frames in which each track was measured, see `well_measured`.
        frames: Number of frames of the recording.
    """
    return too_brief(measured, frames, fps, config.tracking.min_duration_s) | coincidental(tracks, config.th_v)


def well_measured(tracks: Tracks, joints: int) -> np.ndarray:
    """Return (F, P) True where a person has at least this many joints, with views that do not agree by coincidence."""
    known = by_frames(lambda xyz: (~np.isnan(xyz[..., 0])).sum(-1), tracks.xyz)
    return (known >= joints) & tracks.supported


def too_brief(measured: np.ndarray, frames: int, fps: float, min_duration_s: float) -> np.ndarray:
    """Return (P,) True for tracks measured in fewer frames than the shortest duration, or half the recording, has."""
    return measured < min(min_duration_s * fps, frames / 2)


def coincidental(tracks: Tracks, views: int) -> np.ndarray:
    """Return (P,) True for tracks of detections that belong to different figures and happen to line up.

    Args:
        views: Number of views; nearly all joints of a person that this many views detect can be triangulated.
    """
    detected = total(lambda assigned: ((assigned != NONE).sum(2) >= views).sum(-1), tracks.assigned)
    return total(lambda xyz: (~np.isnan(xyz[..., 0])).sum(-1), tracks.xyz) < _MIN_AGREEMENT * detected
