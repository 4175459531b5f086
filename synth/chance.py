"""Random processes in time: values that wander, events that come in bursts."""

import numpy as np
from scipy.signal import lfilter
from scipy.special import betaincinv, ndtri


def wander(shape: tuple[int, ...], fps: float, seconds: float, *, rng: np.random.Generator) -> np.ndarray:
    """Standard normal values (F, ...) whose correlation falls to 1/e in `seconds`: AR(1), stationary."""
    steps = rng.standard_normal(shape)
    if seconds <= 0:
        return steps
    keep = np.exp(-1 / (fps * seconds))
    innovation = np.sqrt(1 - keep**2)
    steps[:1] /= innovation
    return lfilter([innovation], [1, -keep], steps, axis=0)


def unrest(shape: tuple[int, ...], fps: float, seconds: list[float], *, rng: np.random.Generator) -> np.ndarray:
    """Standard normal values (F, ...) that wander on several time scales at once, in equal parts."""
    return sum(wander(shape, fps, time, rng=rng) for time in seconds) / np.sqrt(len(seconds))


def in_bursts(share: np.ndarray, level: np.ndarray) -> np.ndarray:
    """Events that happen `share` of the time and hang together as `level` (standard normal) does.

    A level that wanders on a long and a short time scale gives many short bursts and a few very long ones, which
    a Markov chain of the same share and mean length does not.
    """
    return level < ndtri(share)


def beta_quantile(shape: np.ndarray, quantile: np.ndarray) -> np.ndarray:
    """Quantiles (...) of Beta distributions of shape (a, b), (..., 2) or (2,); 1 where b is 0."""
    a, b = np.moveaxis(np.broadcast_to(shape, (*quantile.shape, 2)), -1, 0)
    return np.where(b > 0, betaincinv(a, np.where(b > 0, b, 1), quantile), 1.0)
