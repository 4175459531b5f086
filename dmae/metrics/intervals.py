"""Scores summed over blocks of time. Intervals are computed from them, as neighbouring frames are nearly the same."""

from dataclasses import dataclass

import numpy as np

from dmae.metrics.comparison import Comparison
from dmae.metrics.pcp import correct_limbs
from dmae.metrics.position import joints_within_threshold

BLOCK = 1.0
"""s; length of a block."""
FIGURES = {"pcp": 100.0, "mpjpe": 1.0, "hidden": 1.0, "recall": 100.0}
"""The summed scores, and the factor from the ratio of the sums to the unit of the score: %, mm, mm, %."""


def time_blocks(comparison: Comparison) -> dict:
    """Return sums over the blocks of time that contain a true joint.

    Returns:
        A dictionary for JSON. `seconds` is the length of a block and `block` the B indices of the blocks. `pcp`
        (correct limbs of each actor), `mpjpe` (mm, all joints), `hidden` (mm, joints that capture did not measure) and
        `recall` (hidden joints within 0.2 m) each have `sum` and `count`, (G, B) numbers. G is the number of actors for
        `pcp`, otherwise 1.
    """
    truth, actors = comparison.truth.xyz, list(comparison.actors)
    correct, limbs = correct_limbs(comparison.matched[:, actors], truth[:, actors], comparison.skeleton)
    error = 1000 * np.linalg.norm(comparison.matched - truth.astype(np.float64), axis=-1)
    found = ~np.isnan(error)
    per_frame = {
        "pcp": ((correct & limbs).sum(2).T, limbs.sum(2).T),
        "mpjpe": _sums(error, found),
        "hidden": _sums(error, found & comparison.hidden),
        "recall": _sums(joints_within_threshold(comparison), comparison.known & comparison.hidden),
    }
    frames = np.flatnonzero(comparison.known.any((1, 2)))
    block, member = block_members(frames, comparison.fps)
    blocks = {"seconds": BLOCK, "block": block.tolist()}
    for figure, (total, count) in per_frame.items():
        blocks[figure] = {
            "sum": (total[:, frames] @ member.T).round(3).tolist(),
            "count": (count[:, frames] @ member.T).tolist(),
        }
    return blocks


def block_members(frames: np.ndarray, fps: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the blocks of time that contain some frames.

    Args:
        frames: (N,) indices.
        fps: Frames per second.

    Returns:
        block: (B,) indices of the blocks.
        member: (B, N) True for the frames of each block.
    """
    block, inverse = np.unique((frames / fps / BLOCK + 1e-9).astype(int), return_inverse=True)
    return block, np.arange(len(block))[:, None] == inverse


def _sums(error: np.ndarray, counted: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the sum and the number of the counted errors of each frame, (1, F) each."""
    return np.where(counted, error, 0).sum((1, 2))[None], counted.sum((1, 2))[None]


@dataclass(frozen=True, eq=False)
class BlockSums:
    """Sums of G ratios over B blocks of time. The score is the weighted mean of the ratios.

    Attributes:
        total: (G, B) numerators; 0 where a clip has fewer blocks.
        count: (G, B) denominators.
        clip: (G,) index of the clip of each ratio. The ratios of a clip share its blocks.
        share: (G,) weight of each ratio.
        blocks: (C,) the number of blocks of each clip.
        scale: Factor from a ratio to the unit of the score.
    """

    total: np.ndarray
    count: np.ndarray
    clip: np.ndarray
    share: np.ndarray
    blocks: np.ndarray
    scale: float = 1.0


def block_sums(runs: list[dict], figure: str) -> BlockSums:
    """Return the sums of a score, over clips and subsets of cameras.

    Ratios are averaged as scores are: over actors, then over the clips of a subset of cameras, then over subsets.

    Args:
        runs: The `runs` of one method and number of views, see `dmae.evaluation.evaluate.evaluate`.
        figure: One of `FIGURES`.

    Raises:
        ValueError: a run has no `blocks`, as in scores of earlier versions; or one clip has different blocks in two
            runs.
    """
    clips: dict[str, list[int]] = {}
    subsets: dict[tuple, int] = {}
    for run in runs:
        if "blocks" not in run:
            raise ValueError("these scores have no sums by time, which intervals require; run dmae evaluate again")
        if clips.setdefault(run["clip"], run["blocks"]["block"]) != run["blocks"]["block"]:
            raise ValueError(f"clip {run['clip']!r} has other annotated frames in one run than in another")
        subsets[tuple(run["cameras"])] = subsets.get(tuple(run["cameras"]), 0) + 1
    longest = max((len(block) for block in clips.values()), default=0)
    order = {name: number for number, name in enumerate(clips)}
    total, count, clip, share = [], [], [], []
    for run in runs:
        sums = run["blocks"][figure]
        ratios = len(sums["sum"])
        for numerator, denominator in zip(sums["sum"], sums["count"], strict=True):
            padding = [0] * (longest - len(numerator))
            total.append([*numerator, *padding])
            count.append([*denominator, *padding])
            clip.append(order[run["clip"]])
            share.append(1 / (len(subsets) * subsets[tuple(run["cameras"])] * ratios))
    shape = (len(total), longest)
    return BlockSums(
        np.array(total, float).reshape(shape),
        np.array(count, float).reshape(shape),
        np.array(clip, int),
        np.array(share),
        np.array([len(block) for block in clips.values()], int),
        FIGURES[figure],
    )


# Bootstrap intervals of scores and of differences between scores, over blocks of time.
#
# Errors of neighbouring frames are nearly the same, so whole blocks of time are drawn (the block bootstrap of Künsch
# 1989, with blocks that do not overlap). Clips are not drawn: an interval covers other moments of these recordings, not
# other recordings.

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
        sums: The result of `dmae.metrics.intervals.block_sums`.
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
