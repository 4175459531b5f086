"""Replace the detections of a clip, or leave out some of them."""

from dataclasses import replace

import numpy as np

from dmae.data.clip import Clip, Detections2D


def heights(xy: np.ndarray) -> np.ndarray:
    """Return the longer side (...) of the box around the known joints of (..., J, 2), px; 0 where none is known."""
    known = np.isfinite(xy)
    low, high = np.where(known, xy, np.inf).min(-2), np.where(known, xy, -np.inf).max(-2)
    return np.where(known.any(-2), high - low, 0).max(-1)


def redetected(clip: Clip, xy: np.ndarray, score: np.ndarray) -> Clip:
    """Return the clip with other detections (F, V, D, J, ...); a joint is absent where either is NaN.

    Labels of the previous detections are removed, because they do not apply to the new ones.
    """
    absent = np.isnan(xy).any(-1) | np.isnan(score)
    xy, score = np.where(absent[..., None], np.nan, xy), np.where(absent, np.nan, score)
    return replace(clip, detections=Detections2D(clip.detections.skeleton, xy, score), detection_labels=None)


def undetected(clip: Clip, joints: np.ndarray) -> Clip:
    """Return the clip without the detected joints where `joints` (F, V, D, J) is True."""
    found = clip.detections
    return redetected(clip, found.xy, np.where(joints, np.nan, found.score))


def undetected_nearest(clip: Clip, margin: np.ndarray, percent: float) -> Clip:
    """Return the clip without the detected joints with the smallest margins, a given share of all.

    Args:
        margin: (F, V, D, J); NaN where unknown. Joints with an unknown margin stay, and do not count.
        percent: Percentage of the joints that count.
    """
    margin = np.where(clip.detections.observed, margin, np.nan)
    known = margin[~np.isnan(margin)]
    number = round(len(known) * percent / 100)
    if not number:
        return clip
    return undetected(clip, margin <= np.partition(known, number - 1)[number - 1])
