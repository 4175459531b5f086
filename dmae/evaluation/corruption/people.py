"""The people of a clip, and the detections that show each of them. Corruptions depend on both."""

import numpy as np

from dmae.data.clip import Clip, Poses3D
from dmae.data.conversion import convert
from dmae.evaluation.corruption.detections import heights
from dmae.metrics.comparison import match
from dmae.numerics.filling import fill_body_frame
from dmae.numerics.paths import linear
from dmae.reconstruction.config import CaptureConfig
from dmae.reconstruction.pipeline import capture

_GATE = 0.25
"""Share of a person's height in the image. A detection with a greater mean distance shows another person."""
_FRAMES = 200
"""Number of frames that are matched together, to limit memory."""


def people_of(clip: Clip, config: CaptureConfig) -> Poses3D:
    """Return the people of a clip on the skeleton of its detections, with gaps filled linearly in the body's frame.

    They are the truth if it has the skeleton of the detections, otherwise the people that all cameras measure.
    """
    skeleton = clip.detections.skeleton
    known = clip.truth is not None and skeleton.name in clip.truth.skeleton.name.split("+")
    found = convert(clip.truth, skeleton) if known else capture(clip, config)
    return fill_body_frame(found, clip.fps, linear)


def pixels_of_people(clip: Clip) -> np.ndarray:
    """Return the pixels (F, V, P, J, 2) of `clip.poses` in the true cameras."""
    return (clip.true_rig or clip.rig).project(clip.poses.xyz)[0]


def detections_of_people(clip: Clip) -> np.ndarray:
    """Return the index (F, V, P) of the detection that shows each person of `clip.poses`; -1 for none."""
    projected, found = pixels_of_people(clip), clip.detections.xy
    frames, views, people = projected.shape[:3]
    shown = np.full((frames, views, people), -1)
    for start in range(0, frames, _FRAMES):
        part = slice(start, start + _FRAMES)
        wanted, detected = (xy[part].reshape(-1, *xy.shape[2:]).astype(np.float64) for xy in (projected, found))
        scale = _median_height(wanted)[:, None, None, None]
        shown[part] = match(detected / scale, wanted / scale, _GATE).reshape(-1, views, people)
    return shown


def people_of_detections(clip: Clip) -> np.ndarray:
    """Return the index (F, V, D) of the person that each detection shows; P for none of them."""
    shown = detections_of_people(clip)
    persons = np.full(clip.detections.score.shape[:3], shown.shape[2])
    frame, view, person = np.nonzero(shown >= 0)
    persons[frame, view, shown[frame, view, person]] = person
    return persons


def by_detection(clip: Clip, values: np.ndarray, missing=np.nan) -> np.ndarray:
    """Return values (F, V, P, ...) of people as (F, V, D, ...) of the detections that show them."""
    spare = np.full((*values.shape[:2], 1, *values.shape[3:]), missing, values.dtype)
    padded, persons = np.concatenate([values, spare], 2), people_of_detections(clip)
    return np.take_along_axis(padded, persons.reshape(*persons.shape, *(1,) * (values.ndim - 3)), 2)


def _median_height(xy: np.ndarray) -> np.ndarray:
    """Return the median height (N,) of the people in (N, P, J, 2), px; 1 where there are none."""
    height = np.where((found := heights(xy)) > 0, found, np.nan)
    median = np.ones(len(xy))
    known = ~np.isnan(height).all(1) if height.size else np.zeros(len(xy), bool)
    median[known] = np.nanmedian(height[known], 1)
    return median
