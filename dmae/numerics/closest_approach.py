"""The closest approach of two lines in space."""

import numpy as np


def closest_approach(
    base: np.ndarray, direction_a: np.ndarray, direction_b: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the points at which lines a and b are closest to each other. The arguments broadcast.

    Args:
        base: (..., 3) vector from the start of a to the start of b.
        direction_a: (..., 3) unit vectors along a.
        direction_b: (..., 3) unit vectors along b.

    Returns:
        along_a: (...) distance from the start of a to the point nearest to b, negative behind the start.
        along_b: (...) the same for b.
        sine2: (...) squared sine of the angle between the lines, at least 1e-12. Parallel lines have no closest points.
    """
    cosine = (direction_a * direction_b).sum(-1)
    base_a, base_b = (direction_a * base).sum(-1), (direction_b * base).sum(-1)
    sine2 = np.maximum(1 - cosine**2, 1e-12)
    return (base_a - cosine * base_b) / sine2, (cosine * base_a - base_b) / sine2, sine2
