"""Protocols of PCP: how predictions are assigned to true persons, what counts as missed, and how a head is placed.

This project reports `strict`. The other protocols are those of published evaluations, taken from the code of their
authors. They serve only for comparison with published rows: none of them penalises a false positive person.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dmae.data.skeleton import Skeleton
from dmae.metrics.comparison import Comparison
from dmae.metrics.matching import match, match_claimed, match_nearest, take_matched
from dmae.metrics.pcp import correct_limbs
from dmae.metrics.percentage import percent
from dmae.metrics.registry import metric
from dmae.numerics.statistics import mean_known
from dmae.registry import Entry, Registry

_UNGATED = 100.0
"""m; a gate that is larger than any distance between persons."""


@dataclass(frozen=True)
class Protocol(Entry):
    """A protocol: its function assigns predictions to true persons, as `dmae.metrics.matching.match` does.

    Attributes:
        missed_count: Whether limbs of a person without a prediction count as not correct.
        at_half: Whether a limb with an error of exactly half its length is correct.
        head: How the ends of the annotated head are placed (`dmae.evaluation.paper_tables.head_placement`).
    """

    missed_count: bool = True
    at_half: bool = True
    head: str = "4da"


protocol = Registry("protocol", Protocol, __package__)


@protocol("strict")
def _strict(pred: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """One prediction for one person, within 0.5 m; a missed person fails all limbs."""
    return match(pred, truth)


@protocol("mvpose", head="mvpose")
def _mvpose(pred: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """The nearest prediction, however far; persons may share one (Dong et al. 2019)."""
    return match_nearest(pred, truth)


@protocol("voxelpose", missed_count=False, head="voxelpose")
def _voxelpose(pred: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """As mvpose, without the frames that have no prediction at all (Tu et al. 2020)."""
    return match_nearest(pred, truth)


@protocol("4da", missed_count=False, at_half=False)
def _4da(pred: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Hungarian assignment, however far; missed persons do not count (Zhang et al. 2020)."""
    return match(pred, truth, _UNGATED)


@protocol("hkbu", at_half=False)
def _hkbu(pred: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Predictions claim the nearest person within 0.5 m, first come first served (Jiang et al. 2022)."""
    return match_claimed(pred, truth)


def count_limbs(
    rules: Protocol, pred: np.ndarray, truth: np.ndarray, skeleton: Skeleton
) -> tuple[np.ndarray, np.ndarray]:
    """Return which limbs of the true persons are correct, and which count.

    Args:
        rules: The protocol.
        pred: (F, P, J, 3) m, with the head placed as in the protocol.
        truth: (F, T, J, 3) m.
        skeleton: Skeleton of both, with L limbs.

    Returns:
        correct: (F, T, L) bool.
        counted: (F, T, L) bool.
    """
    matches = rules.function(pred, truth)
    correct, counted = correct_limbs(take_matched(pred, matches), truth, skeleton, at_half=rules.at_half)
    return correct, counted if rules.missed_count else counted & (matches >= 0)[..., None]


def better_limbs(
    rules: Protocol, first: np.ndarray, second: np.ndarray, truth: np.ndarray, skeleton: Skeleton
) -> tuple[np.ndarray, np.ndarray]:
    """Return the limbs of the better of two predictions, chosen for each person and frame by means of the truth.

    The released evaluation of Jiang et al. 2022 does this with the poses before and after their fusion. No system can
    make this choice. The score is therefore an upper bound for both, and comparable only with that publication.

    Args:
        rules: The protocol.
        first: (F, P, J, 3) m; determines the assignment.
        second: (F, P, J, 3) m, the same persons.
        truth: (F, T, J, 3) m.
        skeleton: Skeleton of all three.

        Returns:
        correct, counted: As from `count_limbs`.
    """
    matches = rules.function(first, truth)
    (one, counted), (other, _) = (
        correct_limbs(take_matched(pred, matches), truth, skeleton, at_half=rules.at_half) for pred in (first, second)
    )
    better = (other & counted).sum(-1) > (one & counted).sum(-1)
    return np.where(better[..., None], other, one), counted


def published_pcp(pred: np.ndarray, truth: np.ndarray, skeleton: Skeleton, actors: Sequence[int]) -> dict[str, float]:
    """Return the average PCP, %, of some true persons by each published protocol, without its placement of the head.

    Args:
        pred: (F, P, J, 3) m.
        truth: (F, T, J, 3) m.
        skeleton: Skeleton of both.
        actors: Indices of true persons.
    """
    counts = {name: count_limbs(rules, pred, truth, skeleton) for name, rules in protocol.items() if name != "strict"}
    return {name: float(mean_known(percent(*found, (0, 2))[list(actors)])) for name, found in counts.items()}


@metric("pcp_published", order=4)
def _pcp_published(comparison: Comparison) -> dict[str, float]:
    """PCP by the protocols of published tables, mean of the actors, %."""
    pred, truth = (xyz / comparison.scale for xyz in (comparison.pred.xyz, comparison.truth.xyz))
    return published_pcp(pred, truth, comparison.skeleton, comparison.actors)
