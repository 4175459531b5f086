"""Checks of numbers from files against limits that no real lens, room or clock exceeds."""

import numpy as np

from dmae.files.mapped import frame_blocks

MOST_PIXELS, MOST_METRES, MOST_SCORE, MOST_VARIANCE = 1e7, 1e7, 1e6, 1e30
"""Largest coordinate, px and m, largest confidence, and largest covariance, m^2."""
LEAST_FOCAL, MOST_FOCAL, MOST_DISTORTION, MOST_SIZE = 0.1, 1e6, 1e4, 100_000
"""Largest focal length and principal point, px, and largest coefficient of distortion."""
LEAST_RATE, MOST_RATE = 0.01, 100_000.0
"""Largest number of frames per second."""


def check_numbers(what: str, values, most: float | np.ndarray, least: float | None = None) -> None:
    """Raise ValueError, which names `what`, unless all numbers except NaN are from `least` (or -`most`) to `most`."""
    array = np.asarray(values)
    if array.ndim > np.ndim(most):
        for part in frame_blocks(array):
            _check_numbers(what, array[part], most, least)
    else:
        _check_numbers(what, array, most, least)


def _check_numbers(what: str, array: np.ndarray, most: float | np.ndarray, least: float | None) -> None:
    least = -most if least is None else least
    with np.errstate(invalid="ignore"):
        wrong = (array > most) | (array < least)
    if wrong.any():
        most = np.broadcast_to(most, array.shape)[wrong].flat[0]
        raise ValueError(f"{what}: expected numbers from {least:g} to {most:g}, found {array[wrong].flat[0]:g}")


def check_rate(what: str, fps) -> float:
    """Return frames per second as a float; raise ValueError, which names `what`, if the number is impossible."""
    if isinstance(fps, bool) or not isinstance(fps, int | float | np.number) or not LEAST_RATE <= fps <= MOST_RATE:
        raise ValueError(f"{what}: expected frames per second from {LEAST_RATE:g} to {MOST_RATE:g}, found {fps!r:.40}")
    return float(fps)
