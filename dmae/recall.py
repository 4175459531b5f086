"""Where somebody had a joint when the rest of the body was as it is now: a Gaussian process over a person's own poses.

Markers are completed alike by the principal components of frames that have them all (Federolf 2013; Gløersen & Federolf
2016); a kernel holds what a plane cannot. The equation is (2.25) of Rasmussen & Williams 2006.
"""

import numpy as np
from scipy.linalg import cho_factor, cho_solve

_ALIKE = 0.1
"""m; poses whose joints differ by more, root mean square, tell little of each other."""
_NOISE = 0.05
"""Variance of what poses do not tell, by the variance of what they do."""
_REACH = 24.0
"""s that are remembered, those nearest in time; of their poses at most `_MOST`, evenly chosen."""
_MOST = 300
_FEWEST = 20
"""Poses; with fewer nothing is recalled."""
_BLOCK = 5.0
"""s that share what is remembered."""


def recall(
    offsets: np.ndarray, joint: int, others: list[int], known: np.ndarray, hidden: np.ndarray, fps: float
) -> np.ndarray:
    """(F, 3) where a joint of somebody is expected, given others.

    Args:
        offsets: (F, J, 3) m, from the joints' parents, in a frame that turns with the body; interpolated where hidden.
        others: Joints to go by.
        known: (F,) True where the joint and its parent were measured: what is remembered.
        hidden: (F,) True where the joint is asked for.

    Returns:
        m, an offset as those given, where the joint is asked for and in the frames beside; else, and where too little
        is known to tell, NaN.
    """
    found = np.full((len(offsets), 3), np.nan)
    usable = ~np.isnan(offsets[:, others]).any((1, 2))
    remembered = np.flatnonzero(known & usable)
    if len(remembered) < _FEWEST:
        return found
    poses = offsets[:, others].reshape(len(offsets), -1) / (_ALIKE * np.sqrt(len(others)))
    beside = hidden.copy()
    beside[1:] |= hidden[:-1]
    beside[:-1] |= hidden[1:]
    block = max(round(_BLOCK * fps), 1)
    for start in range(0, len(offsets), block):
        asked = start + np.flatnonzero((beside & usable)[start : start + block])
        if len(asked):
            near = _nearest(remembered, start + block / 2, round(_REACH * fps))
            mean = offsets[near, joint].mean(0)
            factor = cho_factor(_kernel(poses[near], poses[near]) + _NOISE * np.eye(len(near)))
            weights = cho_solve(factor, offsets[near, joint] - mean)
            found[asked] = mean + _kernel(poses[asked], poses[near]) @ weights
    return found


def _nearest(frames: np.ndarray, to: float, count: int) -> np.ndarray:
    """Of the `count` frames nearest to a time at most `_MOST`, evenly chosen."""
    close = np.sort(frames[np.argsort(np.abs(frames - to), kind="stable")[:count]])
    return close[np.linspace(0, len(close) - 1, min(len(close), _MOST)).round().astype(int)]


def _kernel(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """(n, m) how alike poses are, 1 where they are the same."""
    apart = (one**2).sum(1)[:, None] + (other**2).sum(1) - 2 * one @ other.T
    return np.exp(-np.maximum(apart, 0) / 2)
