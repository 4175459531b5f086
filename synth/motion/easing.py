"""Easing curves that rise from 0 to 1 with zero slope at both ends."""

import numpy as np


def smoothstep(x: np.ndarray | float) -> np.ndarray:
    """Return the cubic 3 x^2 - 2 x^3, clamped to 0 below x = 0 and to 1 above x = 1; zero slope at both ends."""
    x = np.clip(x, 0, 1)
    return x * x * (3 - 2 * x)


def minimum_jerk(x: np.ndarray | float) -> np.ndarray:
    """Return the quintic 10 x^3 - 15 x^4 + 6 x^5, clamped to 0 below x = 0 and to 1 above x = 1.

    Hands that move from rest to rest follow this curve: Flash and Hogan, Journal of Neuroscience 5 (1985).
    """
    x = np.clip(x, 0, 1)
    return x**3 * (10 - 15 * x + 6 * x**2)
