"""Randomness that does not depend on the order in which things are drawn."""

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
    HIDING = 6
    VALIDATION = 7
    LAYOUT = 8
    CALIBRATION = 9
    INTERACTION = 10


def generator(seed: int, clip: int, stream: Stream) -> np.random.Generator:
    """The generator of one clip's stream: the same wherever, whenever and beside whatever it is drawn."""
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(clip, int(stream))))
