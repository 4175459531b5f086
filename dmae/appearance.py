"""How people look: the colour of the clothes on their torso."""

from itertools import islice

import cv2
import numpy as np

from dmae.associate import NONE
from dmae.clip import Clip

_TORSO = ("neck", "l_shoulder", "r_shoulder", "mid_hip", "l_hip", "r_hip")
_SHARE = 0.25
"""Half the side of the patch as a share of the torso's extent: arms and background stay outside."""
_LEAST = 2.0
"""Half the side of the smallest patch, px."""
_GLANCES = 8
"""So many frames of a track, evenly spread, tell its colour."""


class Looks:
    """Median colour of a patch in the middle of each detection's torso.

    Videos are decoded once, in order, as far as the last frame that is asked for; frames are asked for in order.

    Raises:
        ValueError: the clip has no colour images.
        FileNotFoundError: when they are asked for, and are not where the clip says.
    """

    def __init__(self, clip: Clip):
        if clip.images is None or "rgb" not in clip.images.kinds:
            raise ValueError(f"clip {clip.id!r} has no rgb images")
        skeleton = clip.detections.skeleton
        torso = clip.detections.xy[:, :, :, skeleton.index(*(joint for joint in _TORSO if joint in skeleton.joints))]
        known = np.isfinite(torso).all(-1, keepdims=True)
        low = np.where(known, torso, np.inf).min(-2)
        high = np.where(known, torso, -np.inf).max(-2)
        with np.errstate(invalid="ignore"):
            middle, half = (low + high) / 2, np.maximum(_SHARE * (high - low), _LEAST)
            self._boxes = np.stack([np.floor(middle - half), np.ceil(middle + half) + 1], -2)
        self._known = known.any((-1, -2))
        self._videos = [clip.images.video(name) for name in clip.rig.names]
        self._next = 0

    def __call__(self, frame: int) -> np.ndarray:
        """(V, D, 3) float32 CIELAB (L 0..100); NaN where no torso joint is detected, or the patch is not in the image.

        Raises:
            ValueError: the frame is before the one asked for last.
        """
        if frame < self._next:
            raise ValueError(f"frame {frame} is over, the next is {self._next}")
        skipped, self._next = frame - self._next, frame + 1
        colours = np.full((*self._known.shape[1:], 3), np.nan, np.float32)
        for view, video in enumerate(self._videos):
            image = next(islice(video, skipped, None))()
            for detection in np.flatnonzero(self._known[frame, view]):
                (left, top), (right, bottom) = np.clip(
                    self._boxes[frame, view, detection], 0, image.shape[1::-1]
                ).astype(int)
                patch = image[top:bottom, left:right].reshape(-1, 3)
                if len(patch):
                    colour = np.median(patch, 0).astype(np.float32) / 255
                    colours[view, detection] = cv2.cvtColor(colour[None, None], cv2.COLOR_RGB2Lab)[0, 0]
        return colours


def strangers(clip: Clip, chosen: np.ndarray, least: float) -> np.ndarray:
    """Which tracks differ in the colour of their clothes, the median of some frames and all views.

    Args:
        chosen: (F, P, V, J) detections that the tracks are made of, or `NONE`.
        least: By at least so much, CIELAB units.

    Returns:
        (P, P) bool; False where nothing is known.

    Raises:
        ValueError, FileNotFoundError: see `Looks`.
    """
    looks, whole = Looks(clip), chosen.max(-1)
    glances: dict[int, list[int]] = {}
    for person in range(chosen.shape[1]):
        there = np.flatnonzero((whole[:, person] != NONE).any(-1))
        for index in np.unique(np.linspace(0, len(there) - 1, _GLANCES).astype(int)) if len(there) else ():
            glances.setdefault(int(there[index]), []).append(person)
    seen = [[np.empty((0, 3))] for _ in range(chosen.shape[1])]
    for frame in sorted(glances):
        colours = looks(frame)
        for person in glances[frame]:
            view = np.flatnonzero(whole[frame, person] != NONE)
            seen[person].append(colours[view, whole[frame, person, view]])
    known = [rows[~np.isnan(rows).any(-1)] for rows in map(np.concatenate, seen)]
    typical = np.array([np.median(rows, 0) if len(rows) else np.full(3, np.nan) for rows in known])
    return np.linalg.norm(typical[:, None] - typical[None], axis=-1) >= least
