"""Cut synthetic gaps into true poses and add errors as capture makes them, to test completion."""

import numpy as np

from dmae.completion.config import MaskingConfig
from dmae.data.clip import Poses3D
from dmae.numerics.noise import ar1_filter
from dmae.numerics.paths import neighbours

_NOISE = 0.02  # m; the standard deviation of the noise of a person's joints is uniform between 0 and this
_CORRELATION = 0.75  # Correlation of errors in frames 40 ms apart, similar to OpenPose's errors
_DRIFT = 0.05  # m; mean error of a joint in the last frame before a gap, and in the first one after it
_DRIFT_TIME = 0.2  # s; longest time over which a joint drifts away before a gap, or comes back after it
_OUTLIER_RATE = 0.1
"""Outliers per second and joint. Each lasts up to `_DRIFT_TIME` and has an offset of `_OUTLIER_SIZE`."""
_OUTLIER_SIZE = (0.05, 0.5)  # m; log-uniform between these


def cut_gaps(truth: Poses3D, fps: float, *, rng: np.random.Generator) -> Poses3D:
    """Return true poses with gaps drawn as in training. Each gap has a known sample before and after it."""
    from dmae.completion.training_data import mask_bursts  # it loads torch

    known = ~np.isnan(truth.xyz).any(-1)
    frames, persons = known.shape[:2]
    hidden = mask_bursts(frames, persons, truth.skeleton, fps, MaskingConfig(), rng=rng)
    before, after = neighbours(known & ~hidden)
    hidden &= (before >= 0) & (after < len(known))
    return Poses3D(truth.skeleton, np.where(hidden[..., None], np.nan, truth.xyz))


def perturb(poses: Poses3D, fps: float, *, rng: np.random.Generator) -> Poses3D:
    """Return poses with errors as capture makes them: correlated noise, drift next to gaps, and outliers."""
    xyz = poses.xyz.astype(np.float64)
    error = _noise(xyz.shape, fps, rng) + _drift(~np.any(np.isnan(xyz), -1), fps, rng) + _outliers(xyz.shape, fps, rng)
    return Poses3D(poses.skeleton, xyz + error)


def _noise(shape: tuple[int, ...], fps: float, rng: np.random.Generator) -> np.ndarray:
    """Return AR(1) noise (F, P, J, 3), m, with the same correlation over time at any frame rate."""
    noise = ar1_filter(rng.normal(size=shape), _CORRELATION ** (25 / fps))
    return rng.uniform(0, _NOISE, (shape[1], 1, 1)) * noise


def _drift(observed: np.ndarray, fps: float, rng: np.random.Generator) -> np.ndarray:
    """Return offsets (F, P, J, 3), m, that grow evenly in the frames before each gap, and shrink in those after it."""
    last, first = neighbours(~observed)
    index = np.arange(len(observed))[:, None, None]
    drift = np.zeros((*observed.shape, 3))
    for gap, distance in ((first, first - index), (last, index - last)):
        # Use one draw for each side of each gap: the draw of the frame where the gap begins or ends.
        edge = np.clip(gap, 0, len(observed) - 1)
        size, frames = rng.exponential(_DRIFT, observed.shape), rng.uniform(0, _DRIFT_TIME * fps, observed.shape)
        direction = rng.normal(size=drift.shape)
        direction /= np.linalg.norm(direction, axis=-1, keepdims=True)
        size, frames = (np.take_along_axis(drawn, edge, 0) for drawn in (size, frames))
        fraction = np.clip(1 - (distance - 1) / np.maximum(frames, 1), 0, 1)
        adjacent = observed & (gap >= 0) & (gap < len(observed))
        drift += np.where(adjacent, fraction * size, 0)[..., None] * np.take_along_axis(direction, edge[..., None], 0)
    return drift


def _outliers(shape: tuple[int, ...], fps: float, rng: np.random.Generator) -> np.ndarray:
    """Return offsets (F, P, J, 3), m, of outliers; zero elsewhere."""
    offsets = np.zeros(shape)
    frames, persons, joints, _ = shape
    for _ in range(rng.poisson(_OUTLIER_RATE * frames / fps * persons * joints)):
        start, person, joint = (int(rng.integers(length)) for length in (frames, persons, joints))
        length = max(round(rng.uniform(0, _DRIFT_TIME) * fps), 1)
        direction = rng.normal(size=3)
        size = np.exp(rng.uniform(*np.log(_OUTLIER_SIZE)))
        offsets[start : start + length, person, joint] += size * direction / np.linalg.norm(direction)
    return offsets
