"""Events that occur in bursts, for a given share of the time."""

import numpy as np

from dmae.data.clip import Clip
from dmae.numerics.statistics import multiscale_noise


def share_of_time(
    clip: Clip, shape: tuple[int, ...], percent: float, times: tuple[float, float], *, rng: np.random.Generator
) -> np.ndarray:
    """Draw events (F, *shape) for every frame of a clip; they fill the requested share of all entries.

    The events of a lower share are a part of the events of a higher share. They occur in many short bursts and a few
    long ones.

    Args:
        clip: F frames.
        shape: Shape of the items that have events.
        percent: Percentage of all entries that events fill.
        times: s; correlation times, mixed half and half.
        rng: Source of randomness.
    """
    noise = multiscale_noise((len(clip), *shape), clip.fps, list(times), rng=rng)
    number = round(noise.size * percent / 100)
    return noise <= np.partition(noise.ravel(), number - 1)[number - 1] if number else np.zeros(noise.shape, bool)
