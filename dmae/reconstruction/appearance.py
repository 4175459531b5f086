"""Appearance: the colour of people's clothes, measured on the torso."""

import cv2
import numpy as np

from dmae.data.clip import Clip
from dmae.files.mapped import by_frames
from dmae.numerics.statistics import evenly_spaced
from dmae.reconstruction.association import NONE
from dmae.reconstruction.config import CaptureConfig

_TORSO = ("neck", "l_shoulder", "r_shoulder", "mid_hip", "l_hip", "r_hip")
_PATCH_SHARE = 0.25  # Half the side of the patch as a share of the torso's extent: arms and background stay outside
_MIN_HALF_SIDE = 2.0  # px; half the side of the smallest patch
_OTHER_CLOTHES = 30.0  # CIELAB units; clothes that differ by this are of two people
_SAMPLED_FRAMES = 8  # Number of frames of a track, evenly spread, from which its colour is taken


def has_appearance(clip: Clip, config: CaptureConfig) -> bool:
    """Return whether a clip has colour images, and the configuration gives them weight."""
    return config.association.colour_weight > 0 and clip.has_images


class TorsoColours:
    """Median colour of a patch in the middle of each detection's torso. Frames are read fastest in their order.

    Raises:
        ValueError: the clip has no colour images.
        FileNotFoundError: a video is missing; raised when it is first read.
    """

    def __init__(self, clip: Clip):
        if clip.images is None or not clip.has_images:
            raise ValueError(f"clip {clip.id!r} has no rgb images")
        skeleton = clip.detections.skeleton
        joints = skeleton.index(*(joint for joint in _TORSO if joint in skeleton.joints))
        torso = list(skeleton.trunk) if skeleton.defined else joints
        self._boxes = by_frames(lambda xy: _boxes(xy[:, :, :, torso]), clip.detections.xy)
        self._known = by_frames(lambda boxes: np.isfinite(boxes).all((-1, -2)), self._boxes)
        self._views = [clip.images.opened(name) for name in clip.rig.names]

    def __call__(self, frame: int) -> np.ndarray:
        """Return the colours (V, D, 3) of the detections of a frame, float32 CIELAB with L from 0 to 100.

        NaN where no joint of the torso is detected, or the patch is outside the image.
        """
        colours = np.full((*self._known.shape[1:], 3), np.nan, np.float32)
        for view, read in enumerate(self._views):
            image = read(frame)
            for detection in np.flatnonzero(self._known[frame, view]):
                (left, top), (right, bottom) = np.clip(
                    self._boxes[frame, view, detection], 0, image.shape[1::-1]
                ).astype(int)
                patch = image[top:bottom, left:right].reshape(-1, 3)
                if len(patch):
                    colour = np.median(patch, 0).astype(np.float32) / 255
                    colours[view, detection] = cv2.cvtColor(colour[None, None], cv2.COLOR_RGB2Lab)[0, 0]
        return colours


def _boxes(torso: np.ndarray) -> np.ndarray:
    """Return the corners (F, V, D, 2, 2) of patches in the middle of torsos (F, V, D, n, 2), px; NaN where unknown."""
    known = np.isfinite(torso).all(-1, keepdims=True)
    low = np.where(known, torso, np.inf).min(-2)
    high = np.where(known, torso, -np.inf).max(-2)
    with np.errstate(invalid="ignore"):
        middle, half = (low + high) / 2, np.maximum(_PATCH_SHARE * (high - low), _MIN_HALF_SIDE)
        return np.stack([np.floor(middle - half), np.ceil(middle + half) + 1], -2)


def appearance_differs(clip: Clip, assigned: np.ndarray) -> np.ndarray:
    """Find the tracks with clothes of different colours, medians over some frames and all views.

    Raises as `TorsoColours`.

    Args:
        assigned: (F, P, V, J) detections assigned to the tracks, or `NONE`.

    Returns:
        (P, P) True where two tracks differ; False where a colour is unknown.
    """
    colours_of, whole = TorsoColours(clip), by_frames(lambda assigned: assigned.max(-1), assigned)
    sampled: dict[int, list[int]] = {}
    for person in range(assigned.shape[1]):
        present = np.flatnonzero((whole[:, person] != NONE).any(-1))
        for frame in present[evenly_spaced(len(present), _SAMPLED_FRAMES)].tolist():
            sampled.setdefault(frame, []).append(person)
    samples = [[np.empty((0, 3))] for _ in range(assigned.shape[1])]
    for frame in sorted(sampled):
        colours = colours_of(frame)
        for person in sampled[frame]:
            view = np.flatnonzero(whole[frame, person] != NONE)
            samples[person].append(colours[view, whole[frame, person, view]])
    known = [rows[~np.isnan(rows).any(-1)] for rows in map(np.concatenate, samples)]
    typical = np.array([np.median(rows, 0) if len(rows) else np.full(3, np.nan) for rows in known])
    return np.linalg.norm(typical[:, None] - typical[None], axis=-1) >= _OTHER_CLOTHES
