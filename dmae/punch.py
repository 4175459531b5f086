"""Holes made in true poses, with the errors that capture makes beside them: what completion is tested on."""

import numpy as np
from scipy.signal import lfilter

from dmae.clip import Poses3D
from dmae.gaps import neighbours
from dmae.hiding import HidingConfig, hide_bursts

_NOISE = 0.02
"""m; the deviation of a person's joints is uniform up to this, and their errors last."""
_LASTING = 0.75
"""How errors of frames 40 ms apart correlate, about as those of OpenPose do."""
_DRIFT = 0.05
"""m; how far a joint is off on average in the last frame before it is hidden, and in the first one after."""
_DRIFTING = 0.2
"""s; over at most so long it drifts away and comes back."""
_OUTLIERS = 0.1
"""Outliers a second and joint; each lasts up to `_DRIFTING` and is off by `_OUTLYING`."""
_OUTLYING = (0.05, 0.5)
"""m; log-uniform between these."""


def punch(truth: Poses3D, fps: float, hiding: HidingConfig, *, rng: np.random.Generator) -> Poses3D:
    """True poses less bursts of body parts, each with a known sample before and after it.

    Args:
        hiding: `bursts`, `longest` and `absence` count.
    """
    known = ~np.isnan(truth.xyz).any(-1)
    hidden = hide_bursts(*known.shape[:2], truth.skeleton, fps, hiding, rng=rng)
    before, after = neighbours(known & ~hidden)
    hidden &= (before >= 0) & (after < len(known))
    return Poses3D(truth.skeleton, np.where(hidden[..., None], np.nan, truth.xyz))


def disturb(poses: Poses3D, fps: float, *, rng: np.random.Generator) -> Poses3D:
    """Poses as if captured: errors that last, drift on the frames beside a hole, and outliers."""
    xyz = poses.xyz.astype(np.float64)
    off = _noise(xyz.shape, fps, rng) + _drift(~np.isnan(xyz).any(-1), fps, rng) + _outliers(xyz.shape, fps, rng)
    return Poses3D(poses.skeleton, xyz + off)


def _noise(shape: tuple[int, ...], fps: float, rng: np.random.Generator) -> np.ndarray:
    """An autoregressive process of first order, stationary; correlated over time alike at any frame rate."""
    lasting = _LASTING ** (25 / fps)
    white = rng.normal(size=shape)
    white[1:] *= np.sqrt(1 - lasting**2)
    return rng.uniform(0, _NOISE, (shape[1], 1, 1)) * lfilter([1], [1, -lasting], white, axis=0)


def _drift(observed: np.ndarray, fps: float, rng: np.random.Generator) -> np.ndarray:
    """(F, P, J, 3) offsets that grow evenly over the frames before each hole, and shrink over those after it."""
    last, first = neighbours(~observed)
    index = np.arange(len(observed))[:, None, None]
    off = np.zeros((*observed.shape, 3))
    for hole, away in ((first, first - index), (last, index - last)):
        # One draw for each side of each hole: that of the frame where the hole begins or ends.
        edge = np.clip(hole, 0, len(observed) - 1)
        size, lasts = rng.exponential(_DRIFT, observed.shape), rng.uniform(0, _DRIFTING * fps, observed.shape)
        direction = rng.normal(size=off.shape)
        direction /= np.linalg.norm(direction, axis=-1, keepdims=True)
        size, lasts = (np.take_along_axis(drawn, edge, 0) for drawn in (size, lasts))
        share = np.clip(1 - (away - 1) / np.maximum(lasts, 1), 0, 1)
        there = observed & (hole >= 0) & (hole < len(observed))
        off += np.where(there, share * size, 0)[..., None] * np.take_along_axis(direction, edge[..., None], 0)
    return off


def _outliers(shape: tuple[int, ...], fps: float, rng: np.random.Generator) -> np.ndarray:
    off = np.zeros(shape)
    frames, persons, joints, _ = shape
    for _ in range(rng.poisson(_OUTLIERS * frames / fps * persons * joints)):
        start, person, joint = (int(rng.integers(length)) for length in (frames, persons, joints))
        length = max(round(rng.uniform(0, _DRIFTING) * fps), 1)
        direction = rng.normal(size=3)
        size = np.exp(rng.uniform(*np.log(_OUTLYING)))
        off[start : start + length, person, joint] += size * direction / np.linalg.norm(direction)
    return off
