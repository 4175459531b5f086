"""How far poses are to be trusted: exact ones for how joints go on, all of them near what was seen."""

import numpy as np

from dmae.bodyframe import SHORT
from dmae.clip import Poses3D
from dmae.gaps import neighbours
from dmae.hints import stretch
from dmae.metrics import gap_lengths

_EXACT, _CAPTURED = -1.5, -0.1
"""By `dmae.hints.stretch` poses are exact up to the first (1 mm), captured from the second (8 mm) on."""
_NEARBY = 0.2
"""s; farther from any sighting of a person, regions of 90 % were seen to hold less than 80 % of the truth."""


def as_captured(poses: Poses3D) -> np.ndarray:
    """(F, P, 1) by how people's bones stretch, from 0 where poses are exact to 1 where as if captured."""
    stretched = stretch(poses.xyz.astype(np.float64), poses.skeleton.bones)[:, :, :1, 0]
    return ((stretched - _EXACT) / (_CAPTURED - _EXACT)).clip(0, 1)


def share(poses: Poses3D, fps: float) -> np.ndarray:
    """(F, P, J, 1) of what a model adds to interpolation, or to what was measured, that counts: all, but where poses
    are exact; of those nothing that was measured is moved, and little in holes that are too short for a joint to do
    otherwise than go on as it went."""
    squared = gap_lengths(poses.measured) ** 2
    long = squared / (squared + (SHORT * fps) ** 2)
    captured = as_captured(poses)
    return np.where(poses.measured, captured, captured + (1 - captured) * long)[..., None]


def nearby(poses: Poses3D, fps: float) -> np.ndarray:
    """(F, P, 1) True where a joint of the person is measured at about that time."""
    before, after = neighbours(poses.measured.any(-1))
    index, longest = np.arange(len(before))[:, None], _NEARBY * fps
    return (((before >= 0) & (index - before <= longest)) | ((after < len(after)) & (after - index <= longest)))[
        ..., None
    ]
