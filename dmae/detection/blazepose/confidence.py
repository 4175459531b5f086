"""Confidence: the probability that a joint was found near its true place."""

import numpy as np

from dmae.detection.blazepose.landmarks import Person


def confidence(person: Person) -> np.ndarray:
    """Return (33,) probabilities that joints lie within 5 % of the height of the body from their true places."""
    return 1 / (1 + np.exp(-person.visibility))
