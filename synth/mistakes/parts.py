"""Joints of BODY25 as detectors confuse and lose them, and what is detected of them in one view."""

from collections.abc import Callable
from enum import IntEnum
from typing import NamedTuple

import numpy as np

from dmae.skeleton import BODY25
from synth.mistakes.config import DetectorConfig


class Effect(IntEnum):
    """What a random stream of a view is for. Never renumbered: a number is part of every data set made with it."""

    TIMING = 0
    OFFSET = 1
    BIAS = 2
    ERROR = 3
    SCORE = 4
    MISS = 5
    HANGING = 6
    PERSON_MISS = 7
    SWAP = 8
    LEG_INVERSION = 9
    ARM_INVERSION = 10
    MERGE = 11
    SPLIT = 12
    GHOSTS = 13
    DROP = 14
    ORDER = 15


Luck = Callable[[Effect], np.random.Generator]
"""The generator of each effect in a view, from its beginning."""


class Seen(NamedTuple):
    """Detections in one view, D of them at most.

    Attributes:
        xy: (F, D, 25, 2) px; NaN where missed.
        score: (F, D, 25); NaN where missed.
        owner: (F, D, 25) int16 index of the person whose joint each lies on, -1 for nobody's.
        kind: (F, D, 25) uint8 `JointError`, GOOD where nothing was taken for another, however far off it is.
    """

    xy: np.ndarray
    score: np.ndarray
    owner: np.ndarray
    kind: np.ndarray


def kind_of(joint: str) -> str:
    """A joint's name without its side."""
    return joint.removeprefix("l_").removeprefix("r_")


def joints_of(limbs: dict[str, str], otherwise: str, *, sided: tuple[str, ...]) -> dict[str, np.ndarray]:
    """Groups of joints by name: (25,) True for those of each, left and right apart for the `sided`."""
    names = []
    for joint in BODY25.joints:
        limb = limbs.get(kind_of(joint), otherwise)
        names.append(joint[:2] + limb if limb in sided else limb)
    return {name: np.array(names) == name for name in sorted(set(names))}


def by_joint(config: DetectorConfig) -> dict[str, np.ndarray]:
    """The fields of `PartConfig`, each (25, ...)."""
    parts = [getattr(config.parts, kind_of(joint)) for joint in BODY25.joints]
    names = ("noise", "tail", "score", "miss", "offset")
    return {name: np.array([getattr(part, name) for part in parts], float) for name in names}


def extent(xy: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Least and greatest pixel (..., 2) of the joints (..., J, 2) in front of the camera; 0 where there are none."""
    known = np.isfinite(xy)
    any_known = known.any(-2)
    least = np.where(known, xy, np.inf).min(-2)
    greatest = np.where(known, xy, -np.inf).max(-2)
    return np.where(any_known, least, 0), np.where(any_known, greatest, 0)


def reported(seen: Seen, size: np.ndarray, least_score: float) -> Seen:
    """NaN where place or confidence is, outside the image of that size, and where the confidence is too low."""
    with np.errstate(invalid="ignore"):
        known = ((seen.xy >= -0.5) & (seen.xy <= size - 0.5)).all(-1) & (seen.score >= least_score)
    return seen._replace(xy=np.where(known[..., None], seen.xy, np.nan), score=np.where(known, seen.score, np.nan))
