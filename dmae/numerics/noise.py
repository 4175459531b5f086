"""Random processes over time: AR(1) noise, noise of several correlation times, events in bursts.

SciPy is loaded only when noise is made: configurations of detectors import this module.
"""

import numpy as np


def ar1_filter(white: np.ndarray, coefficient: float) -> np.ndarray:
    """Return a stationary AR(1) process with the variance of the given white noise (F, ...), which has mean zero.

    x[0] = white[0], x[n] = coefficient x[n - 1] + sqrt(1 - coefficient^2) white[n], with a coefficient from 0 to below
    1.
    """
    from scipy.signal import lfilter

    gain = np.sqrt(1 - coefficient**2)
    start = white[:1] / gain
    return lfilter([gain], [1, -coefficient], np.concatenate([start, white[1:]]), axis=0)


def ar1_noise(shape: tuple[int, ...], fps: float, seconds: float, *, rng: np.random.Generator) -> np.ndarray:
    """Return standard normal AR(1) noise (F, ...). Its correlation falls to 1/e in `seconds`; 0 gives white noise."""
    white = rng.standard_normal(shape)
    return ar1_filter(white, np.exp(-1 / (fps * seconds))) if seconds > 0 else white


def multiscale_noise(shape: tuple[int, ...], fps: float, seconds: list[float], *, rng: np.random.Generator):
    """Return standard normal noise (F, ...): equal parts of AR(1) noise with several correlation times, s."""
    return sum(ar1_noise(shape, fps, time, rng=rng) for time in seconds) / np.sqrt(len(seconds))


def bursts(probability: np.ndarray | float, noise: np.ndarray) -> np.ndarray:
    """Return events (F, ...) bool with a probability, clustered in time by correlated, standard normal noise (F, ...).

    The sum of noise with a long and a short correlation time gives many short bursts and a few very long bursts. A
    Markov chain with the same probability and mean length does not.
    """
    from scipy.special import ndtri

    return noise < ndtri(probability)


def beta_quantile(shape: np.ndarray, quantile: np.ndarray) -> np.ndarray:
    """Return quantiles (...) of Beta distributions with parameters `shape` (a, b), (..., 2) or (2,); 1 where b is 0."""
    from scipy.special import betaincinv

    a, b = np.moveaxis(np.broadcast_to(shape, (*quantile.shape, 2)), -1, 0)
    return np.where(b > 0, betaincinv(a, np.where(b > 0, b, 1), quantile), 1.0)
