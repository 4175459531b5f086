"""Batches of examples for training and validation, and poses for calibration."""

import time
from collections.abc import Iterator

from torch.utils.data import Dataset

from dmae.completion.training.augmentation import augment
from dmae.completion.training.examples import Examples, Recipe, cut_examples, masked_poses, masked_rows
from dmae.completion.training.pose_pairs import PosePair
from dmae.completion.windows import join_rows
from dmae.data.clip import Poses3D
from dmae.data.conversion import convert
from dmae.data.rng import Stream, generator

_DRAWS = 5
"""Masks drawn for each true recording that uncertainty is calibrated on."""


class TrainingBatches(Dataset):
    """The batches of one epoch. Batch i is the same whenever and by whichever worker it is made.

    In every epoch recordings are augmented, masked and interpolated whole, so that gaps may be longer than windows;
    then windows are drawn from all of them.
    """

    def __init__(
        self,
        pairs: list[PosePair],
        recipe: Recipe,
        *,
        seed: int,
        epoch: int,
        steps: int,
        batch: int,
        extra: list[PosePair] | None = None,
        replay: float = 0.0,
        until: float = float("inf"),
        rank: int = 0,
        ranks: int = 1,
    ):
        """
        Args:
            extra: Pairs that a share `replay` of the windows is drawn from.
            until: Time, by `time.monotonic`, after which no more recordings are made.
            rank, ranks: Which of the processes that share each batch this is.
        """
        self.recipe, self.seed, self.first, self.steps, self.batch = recipe, seed, epoch * steps, steps, batch
        rng = generator(seed, epoch, Stream.MASKING)
        pool = []
        for group, share in ((pairs, 1 - replay), (extra, replay)):
            size, order = 0, []
            # Twice as many rows as windows are drawn: neighbouring windows differ little.
            while size < 2 * steps * batch * share:
                order = order or list(rng.permutation(len(group)))
                pair = group[order.pop()]
                if rng.random() < recipe.augment.true_poses:
                    pair = PosePair(pair.truth)
                varied = augment(pair, recipe.augment, recipe.model.fps, rng=rng)
                pool.append(masked_rows(varied, recipe, rng=rng))
                size += max(len(pool[-1].starts), 1)
                if time.monotonic() > until:
                    break
        self.rows, self.share = join_rows(pool), slice(rank, None, ranks)

    def __len__(self) -> int:
        return self.steps

    def __getitem__(self, step: int) -> Examples:
        if not 0 <= step < self.steps:
            raise IndexError(step)
        rng = generator(self.seed, self.first + step, Stream.WINDOWS)
        starts = rng.choice(self.rows.starts, self.batch)
        return cut_examples(self.rows, starts[self.share], self.recipe.model)


def validation_batches(pairs: list[PosePair], recipe: Recipe, *, seed: int, batch: int) -> list[Examples]:
    """Return examples of every recording once, masked but not augmented; windows overlap by half."""
    found = []
    for number, pair in enumerate(pairs):
        rows = masked_rows(pair, recipe, rng=generator(seed, number, Stream.VALIDATION))
        starts = rows.starts[:: max(1, recipe.model.frames // 2)]
        found += [cut_examples(rows, starts[i : i + batch], recipe.model) for i in range(0, len(starts), batch)]
    return found


def calibration_poses(pairs: list[PosePair], recipe: Recipe, *, seed: int) -> Iterator[tuple[Poses3D, Poses3D]]:
    """Yield poses to complete and their truth: all captured ones, then all true ones under several masks."""
    truths = [convert(pair.truth, pair.truth.skeleton.parts[-1]) for pair in pairs]
    yield from ((pair.captured, truth) for pair, truth in zip(pairs, truths, strict=True) if pair.captured)
    # One mask of every recording before the next, so that many recordings are masked even if time runs out.
    rngs = [generator(seed, number, Stream.VALIDATION) for number in range(len(pairs))]
    for _ in range(_DRAWS):
        for pair, truth, rng in zip(pairs, truths, rngs, strict=True):
            yield masked_poses(PosePair(pair.truth), recipe, rng=rng), truth
