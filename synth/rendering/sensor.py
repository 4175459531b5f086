"""What a sensor makes of light: exposure, white balance, noise and compression of colour images."""

import cv2
import numpy as np
from scipy.special import ndtri

from dmae.data.rng import Stream, generator
from synth.rendering.config import ImagingConfig


def light_of(values: np.ndarray) -> np.ndarray:
    """Return the light, 1 for white, of values of sRGB from 0 to 1 (IEC 61966-2-1)."""
    return np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)


_TO_LINEAR = light_of(np.arange(256) / 255)
"""Light of the 256 values of a channel."""
_TO_VALUE = np.searchsorted((_TO_LINEAR[1:] + _TO_LINEAR[:-1]) / 2, np.arange(65536) / 65535).astype(np.uint8)
"""Nearest sRGB values of 65,536 levels of light."""
_NORMAL = ndtri((np.arange(256) + 0.5) / 256)
_NORMAL /= _NORMAL.std()
"""256 equally likely values of a normal distribution, of variance 1."""


def encode(light: np.ndarray) -> np.ndarray:
    """Return values of sRGB, uint8, of light, 1 for white; more is overexposed."""
    return _TO_VALUE[(np.clip(light, 0, 1) * 65535 + 0.5).astype(np.uint16)]


def decode(values: np.ndarray) -> np.ndarray:
    """Return the light, float32, of values of sRGB, uint8."""
    return _TO_LINEAR.astype(np.float32)[values]


class Sensor:
    """The sensor of one camera in one clip.

    Args:
        config: Light and camera.
        seed, clip: Seed and number of the clip.
        view: Index of the camera. Its exposure and white balance depend on these three alone.
    """

    def __init__(self, config: ImagingConfig, seed: int, clip: int, view: int):
        self._config, self._key = config, (seed, clip, Stream.SENSOR, view)
        rng = generator(*self._key)
        stops = config.exposure * rng.standard_normal() + config.white_balance * rng.standard_normal(3) * (1, 0, 1)
        self.gains = 2.0**stops
        """(3,) factors of the red, green and blue of light."""
        # The value of a pixel is a function of the light's value and of one number that is drawn.
        light = _TO_LINEAR[:, None] * self.gains
        noise = np.zeros_like(light)
        if config.electrons:
            noise = np.sqrt(light / config.electrons + (config.read_noise / config.electrons) ** 2)
        self._table = encode(light[..., None] + noise[..., None] * _NORMAL)
        self._noisy = bool(config.electrons)

    def image(self, rgb: np.ndarray, frame: int) -> np.ndarray:
        """Return the image (H, W, 3) uint8 that the camera stores of an image without its faults.

        Noise is independent from pixel to pixel and from channel to channel, before compression.
        """
        drawn = np.zeros(rgb.shape, np.uint8)
        if self._noisy:
            drawn = np.frombuffer(generator(*self._key, frame).bytes(rgb.size), np.uint8).reshape(rgb.shape)
        index = rgb.astype(np.int32) << 8 | drawn
        found = np.stack([self._table[:, channel].ravel()[index[..., channel]] for channel in range(3)], -1)
        if self._config.jpeg:
            quality = [cv2.IMWRITE_JPEG_QUALITY, self._config.jpeg]
            _, stored = cv2.imencode(".jpg", np.ascontiguousarray(found[..., ::-1]), quality)
            found = np.ascontiguousarray(np.asarray(cv2.imdecode(stored, cv2.IMREAD_COLOR))[..., ::-1])
        return found
