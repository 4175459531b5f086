"""Compare visibility labels with id images."""

from typing import NamedTuple

import cv2
import numpy as np

from dmae.data.clip import Clip
from dmae.data.images import FIRST_OBJECT_ID
from dmae.data.labels import Visibility
from synth.labels.surface_visibility import SurfaceLabels


class PixelAgreement(NamedTuple):
    """The agreement between the labels of joints and the pixels at their projections.

    Attributes:
        compared: (4,) number of compared joints: visible, hidden by their own person, by another person, by an object.
        agreeing: (4,) number of these joints with a pixel that agrees.
    """

    compared: np.ndarray
    agreeing: np.ndarray


def agreement(clip: Clip, margin: int = 5) -> PixelAgreement:
    """Compare visibility labels with id images: the pixel of a joint must show its person or its occluder.

    Joints outside the image, and joints nearer than `margin` to any silhouette, are left out, because their pixels are
    ambiguous. The top of the head is left out as well, because Shelf's annotators put it into the air in front of the
    brow.

    Args:
        clip: A clip with truth, visibility and id images. Its true cameras are used.
        margin: Least distance of a joint from a silhouette, px.
    """
    on_body = np.array([not name.endswith("top_head") for name in clip.truth.skeleton.joints])
    return _agreement(clip, clip.truth.xyz, clip.occlusion.visibility, clip.occlusion.occluder, on_body, margin)


def surface_agreement(clip: Clip, surface: SurfaceLabels, margin: int = 2) -> PixelAgreement:
    """Compare the visibility of surface points with id images, in the same way as `agreement` does for joints.

    Args:
        clip: A clip with id images. Its true cameras are used.
        surface: Its surface points.
        margin: Least distance of a point from a silhouette, px.
    """
    all_points = np.ones(len(surface.names), bool)
    return _agreement(clip, surface.xyz, surface.visibility, surface.hidden_by, all_points, margin)


def _agreement(
    clip: Clip, points: np.ndarray, visibility: np.ndarray, hidden_by: np.ndarray, which: np.ndarray, margin: int
) -> PixelAgreement:
    """Compare the labels (F, V, P, K) of points (F, P, K, 3) with id images. Only the points `which` (K,) are used."""
    rig = clip.rig if clip.true_rig is None else clip.true_rig
    xy, _ = rig.project(points)
    neighbourhood = np.ones((2 * margin + 1, 2 * margin + 1), np.uint8)
    compared, agreeing = np.zeros(4, int), np.zeros(4, int)
    for view, name in enumerate(clip.rig.names):
        for frame, ids in enumerate(clip.images.read("ids", name)):
            codes, owner = visibility[frame, view], hidden_by[frame, view].astype(int)
            judged = (codes <= Visibility.HIDDEN_BY_OBJECT) & which & np.isfinite(xy[frame, view]).all(-1)
            person, joint = np.nonzero(judged)
            column, row = np.clip(np.round(xy[frame, view, person, joint]).astype(int), 0, rig.size[view] - 1).T
            clear = cv2.dilate(ids, neighbourhood)[row, column] == cv2.erode(ids, neighbourhood)[row, column]
            code, by = codes[person, joint], owner[person, joint]
            expected = np.where(
                code == Visibility.HIDDEN_BY_OBJECT,
                FIRST_OBJECT_ID + by,
                1 + np.where(code == Visibility.HIDDEN_BY_PERSON, by, person),
            )
            compared += np.bincount(code[clear], minlength=4)
            agreeing += np.bincount(code[clear & (expected == ids[row, column])], minlength=4)
    return PixelAgreement(compared, agreeing)
