"""Random processes in time: AR(1) noise, and events that occur in bursts."""

import numpy as np
from scipy.signal import lfilter
from scipy.special import betaincinv, ndtri


def ar1_filter(white: np.ndarray, coefficient: float) -> np.ndarray:
    """Filter white noise into a stationary AR(1) process of the same variance.

    x[0] = white[0], x[n] = coefficient x[n - 1] + sqrt(1 - coefficient^2) white[n]

    Args:
        white: (F, ...) independent values of zero mean and equal variance.
        coefficient: Correlation of successive frames, from 0 to below 1.
    """
    gain = np.sqrt(1 - coefficient**2)
    start = white[:1] / gain
    return lfilter([gain], [1, -coefficient], np.concatenate([start, white[1:]]), axis=0)


def ar1_noise(shape: tuple[int, ...], fps: float, seconds: float, *, rng: np.random.Generator) -> np.ndarray:
    """Draw standard normal AR(1) noise (F, ...); its correlation falls to 1/e in `seconds`; white where that is 0."""
    white = rng.standard_normal(shape)
    return ar1_filter(white, np.exp(-1 / (fps * seconds))) if seconds > 0 else white


def multiscale_noise(shape: tuple[int, ...], fps: float, seconds: list[float], *, rng: np.random.Generator):
    """Draw standard normal noise (F, ...): the sum of AR(1) noise of several correlation times, in equal parts."""
    return sum(ar1_noise(shape, fps, time, rng=rng) for time in seconds) / np.sqrt(len(seconds))


def bursts(probability: np.ndarray | float, noise: np.ndarray) -> np.ndarray:
    """Return events (F, ...) of a probability, clustered in time as standard normal noise (F, ...) is correlated.

    Noise of a long and a short correlation time gives many short bursts and a few very long ones. A Markov chain of the
    same probability and mean length does not.
    """
    return noise < ndtri(probability)


def beta_quantile(shape: np.ndarray, quantile: np.ndarray) -> np.ndarray:
    """Return quantiles (...) of Beta distributions of shape (a, b), (..., 2) or (2,); 1 where b is 0."""
    a, b = np.moveaxis(np.broadcast_to(shape, (*quantile.shape, 2)), -1, 0)
    return np.where(b > 0, betaincinv(a, np.where(b > 0, b, 1), quantile), 1.0)
