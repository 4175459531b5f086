"""Matching: the detections of each person in each view, even if a camera is wrong.

F frames, P people, V views, D detections a view, J joints.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import linear_sum_assignment

from dmae.calibration.adjustment.bundle import adjust
from dmae.calibration.adjustment.freedom import Freedom
from dmae.calibration.adjustment.image_tracks import ImageTracks
from dmae.calibration.adjustment.joints import coarse_skeleton
from dmae.calibration.adjustment.observations import Observations
from dmae.calibration.adjustment.parameters import Calibration
from dmae.data.clip import Clip
from dmae.numerics.statistics import mean_known
from dmae.reconstruction.config import CaptureConfig, NoiseModel
from dmae.reconstruction.pipeline import capture

_NOISE = NoiseModel()
_MIN_SCORE = 0.2
_GATES = (0.6, 0.35, 0.25)
"""Largest mean distance of a detection from its person in each round, relative to the person's size in the image."""
_MIN_JOINTS = 5
"""Smallest number of joints for which a detection and a person are compared."""
_ALIGNED_BODIES = 150
"""Number of bodies for the alignment of a camera with people that the others measured."""


def match_tracks(clip: Clip, config: CaptureConfig | None = None) -> ImageTracks:
    """Match the detections of all views to the people that capture finds, including detections of a wrong camera.

    In each round, each camera is aligned with the people and its detections are assigned to them again, with a
    narrower gate. Only the assignment depends on that alignment.
    """
    skeleton, kept = coarse_skeleton(clip.detections.skeleton)
    xyz = capture(clip, config or CaptureConfig()).xyz[:, :, kept].astype(np.float64)
    xy, score = clip.detections.xy[:, :, :, kept].astype(np.float64), clip.detections.score[:, :, :, kept]
    score = np.where(score >= _MIN_SCORE, score, np.nan)
    xy = np.where(np.isnan(score)[..., None], np.nan, xy)
    aligned = Calibration.of(clip.rig)
    for gate in _GATES:
        parts = [_assigned(aligned, view, xyz, xy[:, view], score[:, view], gate) for view in range(len(clip.rig))]
        tracks = ImageTracks(
            skeleton,
            clip.fps,
            np.stack([part[0] for part in parts], 2),
            _NOISE.sigma(np.stack([part[1] for part in parts], 2)),
            xyz,
            aligned,
        )
        if gate != _GATES[-1]:
            aligned = _align(tracks, aligned)
    return tracks


def _assigned(
    calibration: Calibration, view: int, xyz: np.ndarray, xy: np.ndarray, score: np.ndarray, gate: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return the detections (F, P, J, 2) of one view (F, D, J, 2) that show the people (F, P, J, 3), and the scores."""
    expected = calibration.rig[[view]].project(xyz)[0][:, 0]
    low, high = np.fmin.reduce(xy, 2), np.fmax.reduce(xy, 2)
    size = np.maximum(np.hypot(*np.moveaxis(high - low, -1, 0)), 1)
    distance = np.linalg.norm(expected[:, :, None] - xy[:, None], axis=-1)
    common = np.isfinite(distance).sum(-1)
    cost = mean_known(np.minimum(distance / size[:, None, :, None], 2 * gate), -1)
    cost = np.where((common >= _MIN_JOINTS) & (cost < gate), cost, 10 * gate)
    found, scores = np.full(expected.shape, np.nan), np.full(expected.shape[:-1], np.nan)
    for frame, each in enumerate(cost):
        people, detections = linear_sum_assignment(each)
        near = each[people, detections] < gate
        found[frame, people[near]] = xy[frame, detections[near]]
        scores[frame, people[near]] = score[frame, detections[near]]
    return found, scores


def _align(tracks: ImageTracks, calibration: Calibration) -> Calibration:
    """Move each camera so that it fits the people, which do not move."""
    everything = Observations.of(tracks, calibration, _ALIGNED_BODIES)
    free = Freedom.of(len(calibration.rig), rotation=True, centre=True)
    return adjust(everything, calibration, free, move_people=False, iterations=12).calibration
