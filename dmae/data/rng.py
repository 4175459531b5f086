"""Random generators: one for each clip and purpose, independent of the order in which clips are made."""

from enum import IntEnum

import numpy as np


class Stream(IntEnum):
    """Purpose of a random stream. Streams are never renumbered, because every data set depends on their numbers."""

    SCENE = 0
    MOTION = 1
    CAMERAS = 2
    DETECTOR = 3
    STRESS = 4
    WINDOWS = 5
    MASKING = 6
    VALIDATION = 7
    LAYOUT = 8
    CALIBRATION = 9
    INTERACTION = 10
    SENSOR = 11


def generator(seed: int, clip: int, stream: Stream, *parts: int) -> np.random.Generator:
    """Return the generator for one stream of a clip, by the number of the clip, or for numbered parts of the stream.

    It depends on the arguments alone; 0 is a seed.
    """
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(clip, int(stream), *parts)))
