"""Tallies: numbers of correct and of counted items by blocks of time, for the cells of tables and their intervals."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dmae.evaluation.trials import Trial
from dmae.metrics.time_blocks import BlockSums, block_members


@dataclass(frozen=True, eq=False)
class Tally:
    """Sums of one clip with one subset of its cameras.

    Attributes:
        clip: Id of the clip.
        cameras: Indices of the views used.
        total: (G, K, B) numerators of G persons and K kinds (limbs), over B blocks of time.
        count: (G, K, B) denominators.
        annotated: (G, K, B) number of items with truth, counted or not.
    """

    clip: str
    cameras: tuple[int, ...]
    total: np.ndarray
    count: np.ndarray
    annotated: np.ndarray


def limb_tally(trial: Trial, correct: np.ndarray, counted: np.ndarray, known: np.ndarray) -> Tally:
    """Return the tally of the limbs (F, T, L) of a trial's actors: correct, counted, and known at all."""
    frames = np.flatnonzero(known.any((1, 2)))
    _, member = block_members(frames, trial.clip.fps)

    def summed(limbs: np.ndarray) -> np.ndarray:
        return np.einsum("ftl,bf->tlb", limbs[frames][:, actors_of(trial)].astype(float), member.astype(float))

    return Tally(trial.clip.id, tuple(trial.cameras), summed(correct & counted), summed(counted), summed(known))


def actors_of(trial: Trial) -> list[int]:
    """Return the true persons that averages include: the actors of the trial, or all annotated persons."""
    if trial.actors is not None:
        return list(trial.actors)
    return np.flatnonzero((~np.isnan(trial.truth.xyz).any(-1)).any((0, 2))).tolist()


def pooled(
    tallies: Sequence[Tally], persons: Sequence[int] | None = None, kinds: Sequence[int] | None = None, scale=100.0
) -> BlockSums:
    """Return the sums of a cell: the mean over persons, then clips, then subsets of cameras.

    Args:
        tallies: Tallies of one method for each clip and subset.
        persons: Indices into G; by default all.
        kinds: Indices into K. Their counts are added; by default all.
        scale: Factor from a ratio to the unit of the cell.
    """
    clips = list(dict.fromkeys(tally.clip for tally in tallies))
    subsets = [tally.cameras for tally in tallies]
    parts = [[_selected(part, persons, kinds) for part in (each.total, each.count, each.annotated)] for each in tallies]
    # Blocks without truth for these persons are left out. They are the same for all methods.
    kept = {each.clip: annotated.any(0) for each, (_, _, annotated) in zip(tallies, parts, strict=True)}
    longest = max((int(known.sum()) for known in kept.values()), default=0)
    total, count, clip, share = [], [], [], []
    for each, (sums, counts, _) in zip(tallies, parts, strict=True):
        padding = ((0, 0), (0, longest - int(kept[each.clip].sum())))
        total.append(np.pad(sums[:, kept[each.clip]], padding))
        count.append(np.pad(counts[:, kept[each.clip]], padding))
        clip += [clips.index(each.clip)] * len(sums)
        share += [1 / (len(set(subsets)) * subsets.count(each.cameras) * len(sums))] * len(sums)
    return BlockSums(
        np.concatenate(total), np.concatenate(count), np.array(clip, int), np.array(share),
        np.array([int(kept[name].sum()) for name in clips]), scale,
    )  # fmt: skip


def _selected(part: np.ndarray, persons: Sequence[int] | None, kinds: Sequence[int] | None) -> np.ndarray:
    """(G, B) of some persons, added up over some kinds."""
    part = part if persons is None else part[list(persons)]
    return (part if kinds is None else part[:, list(kinds)]).sum(1)
