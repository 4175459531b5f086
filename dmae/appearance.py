"""How people look: the colour of the clothes on their torso."""

import cv2
import numpy as np

from dmae.clip import Clip
from dmae.progress import progress

_TORSO = ("neck", "l_shoulder", "r_shoulder", "mid_hip", "l_hip", "r_hip")
_SHARE = 0.25
"""Half the side of the patch as a share of the torso's extent: arms and background stay outside."""
_LEAST = 2.0
"""Half the side of the smallest patch, px."""


def appearance(clip: Clip) -> np.ndarray:
    """Median colour of a patch in the middle of each detection's torso, reading each video once.

    Returns:
        (F, V, D, 3) float32 CIELAB (L 0..100); NaN where no torso joint is detected, or the patch lies
        outside the image.

    Raises:
        ValueError: the clip has no colour images.
        FileNotFoundError: they are not where the clip says.
    """
    if clip.images is None or "rgb" not in clip.images.kinds:
        raise ValueError(f"clip {clip.id!r} has no rgb images")
    skeleton = clip.detections.skeleton
    torso = clip.detections.xy[:, :, :, skeleton.index(*(joint for joint in _TORSO if joint in skeleton.joints))]
    known = np.isfinite(torso).all(-1, keepdims=True)
    low = np.where(known, torso, np.inf).min(-2)
    high = np.where(known, torso, -np.inf).max(-2)
    with np.errstate(invalid="ignore"):
        middle, half = (low + high) / 2, np.maximum(_SHARE * (high - low), _LEAST)
        boxes = np.stack([np.floor(middle - half), np.ceil(middle + half) + 1], -2)

    colours = np.full((*boxes.shape[:3], 3), np.nan, np.float32)
    images = (image for name in clip.rig.names for image in clip.images.read("rgb", name))
    for number, image in enumerate(progress(images, "colours", len(clip) * len(clip.rig))):
        view, frame = divmod(number, len(clip))
        size = image.shape[1::-1]
        for detection in np.flatnonzero(known[frame, view].any((-2, -1))):
            (left, top), (right, bottom) = np.clip(boxes[frame, view, detection], 0, size).astype(int)
            patch = image[top:bottom, left:right].reshape(-1, 3)
            if len(patch):
                colour = np.median(patch, 0).astype(np.float32) / 255
                colours[frame, view, detection] = cv2.cvtColor(colour[None, None], cv2.COLOR_RGB2Lab)[0, 0]
    return colours
