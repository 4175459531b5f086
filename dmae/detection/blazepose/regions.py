"""Regions of an image: rotated squares around a person, and how they are cut out of the image."""

from dataclasses import dataclass
from math import floor, log2

import cv2
import numpy as np

_MARGIN = 1.125
"""Side of a region, relative to the circle around the body. MediaPipe uses 1.25. In rendered views of people with
exact truth, 1.125 brings 2 to 6 % more of the visible joints within 5 % of the height."""
_LEVELS = 4
"""Number of levels of a pyramid; each level has half the width and height of the previous one."""


@dataclass(frozen=True)
class Region:
    """A rotated square in an image.

    Attributes:
        centre: (2,) px, from the corner of the image (pixel + 0.5).
        side: px.
        up: (2,) unit vector in the image that points up in the square.
    """

    centre: np.ndarray
    side: float
    up: np.ndarray

    @classmethod
    def around(cls, hip: np.ndarray, top: np.ndarray) -> "Region | None":
        """Return the region of a body from the middle of its hips and a point on the circle around it, (2,) px each.

        None if the two points coincide or are not finite.
        """
        along = np.asarray(top, np.float64) - hip
        radius = float(np.hypot(*along))
        if not np.isfinite(radius) or radius < 1:
            return None
        return cls(np.asarray(hip, np.float64), 2 * radius * _MARGIN, along / radius)

    @classmethod
    def upright(cls, left: float, top: float, side: float) -> "Region":
        """Return a square that is not rotated."""
        return cls(np.array([left + side / 2, top + side / 2]), side, np.array([0.0, -1.0]))

    @property
    def radius(self) -> float:
        """Radius of the circle around the body, px."""
        return self.side / 2 / _MARGIN

    def to_picture(self, points: np.ndarray) -> np.ndarray:
        """Return the places (..., 2) px in the image of points (..., 2) in the square, from 0 to 1."""
        return self.centre + (points - 0.5) * self.side @ self._axes

    def from_picture(self, places: np.ndarray) -> np.ndarray:
        """Return the points (..., 2) in the square, from 0 to 1, of places (..., 2) px in the image."""
        return (places - self.centre) @ self._axes.T / self.side + 0.5

    @property
    def _axes(self) -> np.ndarray:
        """(2, 2) unit vectors in the image, as rows, that point right and down in the square."""
        x, y = self.up
        return np.array([[-y, x], [-x, -y]])

    def cut(self, pyramid: list[np.ndarray], size: int) -> np.ndarray:
        """Return the square (size, size, 3) of an image; black outside of the image.

        Args:
            pyramid: The image, and smaller copies of it, as `pyramid_of` returns them. Nothing is shrunk by more
                than 2 without averaging.
        """
        scale = self.side / size
        level = min(max(floor(log2(max(scale, 1e-3))), 0), len(pyramid) - 1)
        axes = self._axes.T * scale / 2**level
        corner = (self.to_picture(np.zeros(2)) / 2**level + axes @ (0.5, 0.5)) - 0.5
        return cv2.warpAffine(
            pyramid[level], np.column_stack([axes, corner]), (size, size), flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        )


def pyramid_of(picture: np.ndarray) -> list[np.ndarray]:
    """Return an image (H, W, 3) and copies of half, a quarter and an eighth of its size."""
    levels = [picture]
    while len(levels) < _LEVELS and min(levels[-1].shape[:2]) >= 2:
        height, width = levels[-1].shape[:2]
        # An odd row or column at the end is left out, so that each pixel is the mean of four.
        even = levels[-1][: height // 2 * 2, : width // 2 * 2]
        levels.append(cv2.resize(even, (width // 2, height // 2), interpolation=cv2.INTER_AREA))
    return levels
