"""Random generators: one for each clip and purpose, independent of the order of drawing."""

from enum import IntEnum

import numpy as np


class Stream(IntEnum):
    """What a random stream is for. Never renumbered: a number is part of every data set made with it."""

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


def generator(seed: int, clip: int, stream: Stream) -> np.random.Generator:
    """Return the generator of one stream of one clip. It depends on nothing else.

    Args:
        seed: Of the data set; 0 is a seed.
        clip: Number of the clip.
        stream: What the numbers are for.
    """
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(clip, int(stream))))
