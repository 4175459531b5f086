"""How far detected joints are off, and how sure of them the detector is."""

import numpy as np
from scipy.special import gammaincinv, ndtr, ndtri

from dmae.skeleton import BODY25
from synth.chance import beta_quantile, unrest, wander
from synth.mistakes.config import DetectorConfig
from synth.mistakes.parts import Effect, Luck, by_joint, extent

_MIRROR = list(BODY25.mirror)
_NECK, _MID_HIP = BODY25.index("neck", "mid_hip")
_SCALES = 3.0
"""Half of an error forgets itself so many times slower than the whole, half so many times faster."""
_WILDEST = 12.0
"""How many times wider than its scale the Gaussian under Student's t may get."""


def errors(
    xy: np.ndarray, guessed: np.ndarray, size: np.ndarray, fps: float, config: DetectorConfig, luck: Luck
) -> tuple[np.ndarray, np.ndarray]:
    """Errors of joints at `xy` (F, P, 25, 2) px in an image of `size`, definition apart.

    Student's t as a Gaussian of wandering variance (chi-square by its quantiles), the Gaussian with a constant part.

    Args:
        guessed: (F, P, 25) True for joints that are hidden.

    Returns:
        error: (F, P, 25, 2) px.
        rank: (F, P, 25) from 0 to 1, of its size among all that a joint like this could have had.
    """
    joints = xy.shape[:-1]
    tail = by_joint(config)["tail"]
    rng = luck(Effect.ERROR)
    times = [config.correlation * _SCALES, config.correlation / _SCALES]
    gaussian = np.sqrt(1 - config.bias) * unrest((*joints, 2), fps, times, rng=rng)
    spread = wander(joints, fps, config.bursts[0], rng=rng)
    if config.bias:
        gaussian += np.sqrt(config.bias) * luck(Effect.BIAS).standard_normal((*joints[1:], 2))
    precision = gammaincinv(tail / 2, ndtr(spread)) * 2 / tail
    t = gaussian * np.minimum(1 / np.sqrt(np.maximum(precision, 1e-9)), _WILDEST)[..., None]
    rank = 1 - (1 + (t**2).sum(-1) / tail) ** (-tail / 2)
    return t * _scale(xy, guessed, size, config)[..., None], rank


def _scale(xy, guessed, size, config) -> np.ndarray:
    """(F, P, 25) px: by kind of joint, size in the image, motion, truncation and visibility."""
    scale = by_joint(config)["noise"] * height(xy)[..., None]
    if config.least_noise:
        scale = np.hypot(scale, config.least_noise)
    if config.blur and len(xy) > 1:
        scale = np.hypot(scale, config.blur * np.nan_to_num(np.linalg.norm(np.gradient(xy, axis=0), axis=-1)))
    if config.cut_noise:
        with np.errstate(invalid="ignore"):
            outside = ~((xy >= -0.5) & (xy <= size - 0.5)).all(-1)
        scale = scale * (1 + config.cut_noise * outside.mean(-1, keepdims=True))
    return scale * np.where(guessed, config.guess_noise, 1)


def height(xy: np.ndarray) -> np.ndarray:
    """(F, P) the longer side of the box around the joints (F, P, 25, 2), px."""
    top, bottom = extent(xy)
    return (bottom - top).max(-1)


def offsets(xy: np.ndarray, config: DetectorConfig, luck: Luck) -> np.ndarray | float:
    """(F, P, 25, 2) px from where joints are annotated to where the detector means them to be."""
    offset, found = by_joint(config)["offset"], 0.0
    if offset.any():
        trunk = np.nan_to_num(xy[:, :, _MID_HIP] - xy[:, :, _NECK])[:, :, None]
        found = offset[:, :1] * np.nan_to_num(xy - xy[:, :, _MIRROR]) + offset[:, 1:] * trunk
    if config.view_offset:
        constant = config.view_offset * luck(Effect.OFFSET).standard_normal((len(BODY25), 2))
        found = found + constant * height(xy)[..., None, None]
    return found


def scores(rank: np.ndarray, guessed: np.ndarray, fps: float, config: DetectorConfig, luck: Luck) -> np.ndarray:
    """Confidences (F, P, 25), Beta distributed, lower where the error is of higher rank."""
    chance = wander(rank.shape, fps, config.correlation, rng=luck(Effect.SCORE))
    knowledge = -ndtri(np.clip(rank, 1e-9, 1 - 1e-9))
    level = config.score_knows * knowledge + np.sqrt(1 - config.score_knows**2) * chance
    shape = np.where(guessed[..., None], config.guess_score, by_joint(config)["score"])
    return beta_quantile(shape, ndtr(level))
