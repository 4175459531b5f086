"""Images of distorting lenses, warped from images of pinhole cameras."""

import cv2
import mujoco
import numpy as np

from dmae.data.cameras import CameraRig
from synth.rigs.lenses import ELSEWHERE, pinholes, warps


class LensPainter:
    """Paint images through the lenses of a rig by warping images of pinhole cameras.

    Args:
        painter: Paints the pinholes of all views, in order: see `synth.rendering.opengl.Renderer`.
        rig: V cameras.
    """

    def __init__(self, painter, rig: CameraRig):
        self._painter, self._maps = painter, [warps(rig[view : view + 1]) for view in range(len(rig))]
        counts = [len(cameras) for cameras in pinholes(rig)]
        self._parts = [range(end - count, end) for end, count in zip(np.cumsum(counts).tolist(), counts, strict=True)]

    def paint(self, data: mujoco.MjData, view: int, kinds: tuple[str, ...]) -> tuple[np.ndarray | None, ...]:
        """Return images of these kinds. Pixels where the lens shows nothing are NaN or 0."""
        pictures = [self._painter.paint(data, part, kinds) for part in self._parts[view]]
        return tuple(self._bent(list(images), view) for images in zip(*pictures, strict=True))

    def paint_alone(self, data: mujoco.MjData, view: int, owner: int) -> np.ndarray:
        """Return (H, W) True for the pixels that geoms with the id `owner` would cover if nothing else were there."""
        pictures = [self._painter.paint_alone(data, part, owner) for part in self._parts[view]]
        return self._bent([picture.astype(np.uint16) for picture in pictures], view) > 0

    def _bent(self, images: list[np.ndarray | None], view: int) -> np.ndarray | None:
        """Return the distorted image from the images of the pinholes. Only colours are interpolated."""
        if images[0] is None or self._maps[view] is None:
            return images[0]
        how = cv2.INTER_LINEAR if images[0].dtype == np.uint8 else cv2.INTER_NEAREST
        nothing = (np.nan,) * 4 if images[0].dtype == np.float32 else 0
        bent = None
        for image, pixels in zip(images, self._maps[view], strict=True):
            part = cv2.remap(image, pixels, None, how, borderMode=cv2.BORDER_CONSTANT, borderValue=nothing)
            if bent is None:
                bent = part
            else:
                shown = pixels[..., 0] > ELSEWHERE
                bent[shown] = part[shown]
        return bent

    def close(self) -> None:
        """Close the painter."""
        self._painter.close()
