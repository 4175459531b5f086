"""Images of another size than the calibration: scaling and black borders are found and undone."""

from dataclasses import dataclass

import numpy as np

from dmae.data.cameras import camera_label

_RATIO = 0.003
"""Largest relative difference between the scales of width and height of an image that was scaled without margins."""
_BLACK = 40  # Largest mean brightness of a margin, of 255; compressed black is not quite black


@dataclass(frozen=True)
class Fitting:
    """Scale and margin of images relative to the images of the calibration."""

    scale: float = 1.0  # Pixels of the image per pixel of the calibration
    margin: tuple[float, float] = (0.0, 0.0)  # (left, top) black border of the image, px

    @property
    def is_same(self) -> bool:
        """True if the pixels are the same as in the calibration."""
        return self == Fitting()

    def to_calibration(self, xy: np.ndarray) -> np.ndarray:
        """Return pixels (..., 2) of the calibration for pixels of the image."""
        return xy if self.is_same else (xy + 0.5 - np.array(self.margin)) / self.scale - 0.5

    def from_calibration(self, xy: np.ndarray) -> np.ndarray:
        """Return pixels (..., 2) of the image for pixels of the calibration."""
        return xy if self.is_same else (xy + 0.5) * self.scale + np.array(self.margin) - 0.5

    @property
    def note(self) -> str:
        """The text of a note, to be printed after the name of the camera."""
        left, top = self.margin
        border = f" and have a black border of {left:.2g} px at the sides" if left >= 0.5 else ""
        border += f" and have a black border of {top:.2g} px above and below" if top >= 0.5 else ""
        return f"pictures are {self.scale:.4f} times the size of the calibration{border}; this is undone"


def fit_pictures(camera: str, picture: tuple[int, int], calibration: tuple[int, int], sample: np.ndarray) -> Fitting:
    """Return the scale and margin of images relative to the images of the calibration.

    Args:
        camera: Name, for messages.
        picture: Width and height of the images, px.
        calibration: Width and height that the calibration is for, px.
        sample: (N, H, W, 3) uint8, some images of the camera.

    Raises:
        ValueError: the images cannot be smaller or larger copies of the images of the calibration.
    """
    if tuple(picture) == tuple(calibration):
        return Fitting()
    width, height = (a / b for a, b in zip(picture, calibration, strict=True))
    scale = min(width, height)
    # Rounding to even numbers changes a side by less than 2 px.
    rounded = all(abs(a - scale * b) < 2 for a, b in zip(picture, calibration, strict=True))
    if rounded and abs(width - height) <= _RATIO * scale:
        return Fitting((width + height) / 2)
    left, top = ((a - scale * b) / 2 for a, b in zip(picture, calibration, strict=True))
    if _is_black(sample, round(left), round(top)):
        return Fitting(scale, (left, top))
    turned = tuple(picture) == tuple(calibration)[::-1]
    advice = "turn them" if turned else "calibrate at this size, or give the pictures as they were calibrated"
    raise ValueError(
        f"{camera_label(camera)}: its pictures have {picture[0]} x {picture[1]} px, its calibration is for "
        f"{calibration[0]} x {calibration[1]} px; they are no copy of that in another size, with or without black "
        f"borders; {advice}"
    )


def _is_black(sample: np.ndarray, left: int, top: int) -> bool:
    if not len(sample) or left + top == 0:
        return False
    height, width = sample.shape[1:3]
    borders = [sample[:, :top], sample[:, height - top :], sample[:, :, :left], sample[:, :, width - left :]]
    means = [border.mean() for border in borders if border.size]
    return bool(max(means) < _BLACK)
