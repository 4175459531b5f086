"""Bootstrap intervals of scores and of differences between scores, over blocks of time.

Errors of neighbouring frames are nearly the same, so whole blocks of time are drawn (the block bootstrap of Künsch
1989, with blocks that do not overlap). Clips are not drawn: an interval covers other moments of these recordings, not
other recordings.
"""

from dataclasses import dataclass

import numpy as np

from dmae.metrics.time_blocks import BlockSums

_FEWEST = 5
"""Smallest number of blocks for an interval; the spread of fewer blocks is not meaningful."""


@dataclass(frozen=True)
class Interval:
    """A score, or a difference, with its percentile interval. All are NaN if there is nothing to score."""

    value: float
    low: float
    high: float

    @property
    def excludes_zero(self) -> bool:
        """True if the interval is on one side of zero, so that a difference is more than noise."""
        return self.low > 0 or self.high < 0


def bootstrap_ratio(sums: BlockSums, *, seed: int = 0, draws: int = 1000, level: float = 0.95) -> Interval:
    """Return a score with its interval.

    The interval is NaN with fewer than 5 blocks in all.

    Args:
        sums: The result of `dmae.metrics.time_blocks.block_sums`.
        seed: Seed of the draws.
        draws: Number of draws.
        level: Probability of the interval, for example 0.95.
    """
    return _interval(_score(sums, None)[0], bootstrap_scores(sums, seed=seed, draws=draws), sums, level)


def bootstrap_scores(sums: BlockSums, *, seed: int = 0, draws: int = 1000) -> np.ndarray:
    """Return the score of each draw of blocks, (draws,). With the same seed and clips, the same blocks are drawn.

    The arguments are those of `bootstrap_ratio`.
    """
    return _score(sums, _weights(sums.blocks, sums.total.shape[1], draws, seed))


def bootstrap_difference(
    one: BlockSums, other: BlockSums, *, seed: int = 0, draws: int = 1000, level: float = 0.95
) -> Interval:
    """Return `one` minus `other` with its interval. The same blocks are drawn for both, so that common errors cancel.

    Args:
        one: Sums of a score of some clips.
        other: Sums of the same clips, in the same order.
        seed: Seed of the draws.
        draws: Number of draws.
        level: Probability of the interval, for example 0.95.

    Raises:
        ValueError: the two do not have the same blocks.
    """
    if not np.array_equal(one.blocks, other.blocks):
        raise ValueError(
            f"scores of the same clips expected; found {one.blocks.tolist()} and {other.blocks.tolist()} blocks of "
            "time with truth"
        )
    weights = _weights(one.blocks, one.total.shape[1], draws, seed)
    value = _score(one, None)[0] - _score(other, None)[0]
    return _interval(value, _score(one, weights) - _score(other, weights), one, level)


def _weights(blocks: np.ndarray, longest: int, draws: int, seed: int) -> np.ndarray:
    """Return (draws, C, B), the number of times that each block of each clip is drawn."""
    rng = np.random.default_rng(seed)
    weights = np.zeros((draws, len(blocks), longest))
    for clip, number in enumerate(blocks):
        if number:
            weights[:, clip, :number] = rng.multinomial(number, np.full(number, 1 / number), size=draws)
    return weights


def _score(sums: BlockSums, weights: np.ndarray | None) -> np.ndarray:
    """Return (draws,) scores; without weights, one score of all blocks. Ratios with a count of 0 are not averaged."""
    if weights is None:
        total, count = sums.total.sum(1)[None], sums.count.sum(1)[None]
    else:
        total, count = (np.einsum("dgb,gb->dg", weights[:, sums.clip], part) for part in (sums.total, sums.count))
    known = count > 0
    ratio = np.divide(total, count, out=np.zeros_like(total), where=known)
    share = (known * sums.share).sum(1)
    score = np.full(len(total), np.nan)
    np.divide(sums.scale * (ratio * sums.share).sum(1), share, out=score, where=share > 0)
    return score


def _interval(value: float, scores: np.ndarray, sums: BlockSums, level: float) -> Interval:
    scores = scores[~np.isnan(scores)]
    if sums.blocks.sum() < _FEWEST or not len(scores):
        return Interval(float(value), np.nan, np.nan)
    low, high = np.quantile(scores, [(1 - level) / 2, (1 + level) / 2])
    return Interval(float(value), float(low), float(high))
