"""Drawing primitives for images of clips: colours, text, lines and marks."""

from enum import Enum
from functools import lru_cache

import cv2
import numpy as np
from matplotlib import font_manager
from PIL import ImageFont

from dmae.data.cameras import CameraRig
from dmae.reporting.figures import COMPLETED, PERSONS

RGB = tuple[int, int, int]
PAPER, INK, FAINT = (22, 25, 30), (233, 236, 240), (139, 148, 158)
_EMPTY, _GRID = (58, 63, 71), (84, 91, 101)
_FINE = 4  # Number of fractional bits of pixel positions in OpenCV's drawing functions
_FAR = 20  # Multiple of the image width; points farther outside the image are not drawn


def _rgb(text: str) -> RGB:
    return tuple(int(text[i : i + 2], 16) for i in (1, 3, 5))


RED = _rgb(COMPLETED)
"""Colour of completed joints, which no camera measured."""


def person_colour(person: int) -> RGB:
    """Return the colour of a person, the same in every view and frame."""
    return _rgb(PERSONS[person % len(PERSONS)])


class Mark(Enum):
    """Shapes of joints."""

    DISC = "disc"
    SQUARE = "square"
    CROSS = "cross"
    RING = "ring"


@lru_cache
def font(size: int, bold: bool = False) -> ImageFont.FreeTypeFont:
    """Return Matplotlib's default font at a size in px."""
    weight = "bold" if bold else "normal"
    return ImageFont.truetype(
        font_manager.findfont(font_manager.FontProperties(family="DejaVu Sans", weight=weight)), size
    )


def drawable(pixels: np.ndarray, width: int) -> np.ndarray:
    """Return (...) True for the pixels (..., 2) that are known and not too far outside the image to be drawn."""
    return np.isfinite(pixels).all(-1) & (np.abs(np.nan_to_num(pixels)) < _FAR * width).all(-1)


def draw_line(canvas: np.ndarray, points: np.ndarray, colour: RGB, thick: int, *, outlined: bool = False) -> None:
    """Draw a line through points (n, 2), px, with a dark outline if `outlined`."""
    if outlined:
        cv2.polylines(canvas, [_fixed(points)], False, PAPER, thick + 2, cv2.LINE_AA, _FINE)
    cv2.polylines(canvas, [_fixed(points)], False, colour, thick, cv2.LINE_AA, _FINE)


def draw_mark(canvas: np.ndarray, point: np.ndarray, mark: Mark, colour: RGB, thick: int) -> None:
    """Draw a mark at a point (2,), px. Discs and squares have a dark outline."""
    x, y = _fixed(point[None])[0].tolist()
    size = (2 * thick) << _FINE
    edge = thick << _FINE
    if mark is Mark.DISC:
        cv2.circle(canvas, (x, y), size + edge, PAPER, -1, cv2.LINE_AA, _FINE)
        cv2.circle(canvas, (x, y), size, colour, -1, cv2.LINE_AA, _FINE)
    elif mark is Mark.SQUARE:
        for half, filling in ((size + edge, PAPER), (size, colour)):
            cv2.rectangle(canvas, (x - half, y - half), (x + half, y + half), filling, -1, cv2.LINE_AA, _FINE)
    elif mark is Mark.RING:
        cv2.circle(canvas, (x, y), size + edge, colour, thick, cv2.LINE_AA, _FINE)
    else:
        for sign in (1, -1):
            ends = np.array([[x - size, y - sign * size], [x + size, y + sign * size]], np.int32)
            cv2.polylines(canvas, [ends], False, colour, thick, cv2.LINE_AA, _FINE)


def floor(rig: CameraRig, size: tuple[int, int], scale: float) -> np.ndarray:
    """Draw lines on the floor, 1 m apart over 10 m, as one camera sees it; `size` in px, `scale` px/camera px."""
    canvas = np.full((size[1], size[0], 3), _EMPTY, np.uint8)
    along, across = np.meshgrid(np.linspace(-5, 5, 201), np.arange(-5.0, 6.0))
    lines = np.stack([along, across, np.zeros_like(along)], -1)
    lines = np.concatenate([lines, lines[..., [1, 0, 2]]])
    pixels = rig.project(lines[None])[0][0, 0] * scale
    near = drawable(pixels, size[0])
    for line, fits in zip(pixels, near, strict=True):
        edges = np.flatnonzero(np.diff(fits)) + 1
        for run, inside in zip(np.split(line, edges), np.split(fits, edges), strict=True):
            if inside[0]:
                draw_line(canvas, run, _GRID, 1)
    return canvas


def _fixed(points: np.ndarray) -> np.ndarray:
    """Return pixels (n, 2) as OpenCV's fixed-point numbers with `_FINE` fractional bits."""
    return np.round(points * (1 << _FINE)).astype(np.int32)
