"""What a network is told of joints beside where they are, or where interpolation puts them.

Shapes: F frames, P persons, J joints.
"""

from collections.abc import Sequence

import numpy as np
from scipy.ndimage import uniform_filter1d

from dmae.bodyframe import turn
from dmae.gaps import neighbours
from dmae.series import take

_AT_ONCE, _BRIEF, _LONG = 3, 9, 51
"""Frames over which the stretch of a bone, the roughness of a joint, and either of a whole person are averaged."""
_ROUGH, _SMOOTH = 0.01, 1e-3
"""m; of what roughness is a multiple, and what is added lest nothing be infinitely smooth."""

Bones = Sequence[tuple[int, int]]


def carried(base: np.ndarray, observed: np.ndarray, parents: np.ndarray, front: np.ndarray) -> np.ndarray:
    """How far from `base` a hidden joint would be had it stayed as it was last observed, or were it already as it is
    next: beside its parent, in a frame that turns with the body, and in the world.

    Args:
        base: (F, P, J, 3) m, world; interpolated where not observed.
        observed: (F, P, J)
        parents: (J,) indices of the parents; a root is its own.
        front: (F, P) rad, where the body faces.

    Returns:
        (F, P, J, 4, 3) m, world: last and next in the body, last and next in the world. Zero where the joint is
        observed, and for a side on which it never is.
    """
    angle = front[..., None]

    def stayed(values: np.ndarray) -> list[np.ndarray]:
        off = (take(values, edge) - values for edge in neighbours(observed))
        return [np.where(observed[..., None], 0, np.nan_to_num(part)) for part in off]

    in_body = stayed(turn(base - base[:, :, parents], -angle))
    return np.stack([*(turn(part, angle) for part in in_body), *stayed(base)], -2)


def roughness(xyz: np.ndarray) -> np.ndarray:
    """How much measured paths jump about: (F, P, J, 3) logarithms, 0 at a centimetre.

    That is the third difference of neighbouring frames, next to nothing where people move and nothing is wrong;
    averaged over the person for a second or so, over the joint where it was last observed, and where it is next. Where
    too little was measured to tell, a joint is as rough as its person, and that 0.

    Args:
        xyz: (F, P, J, 3) m; NaN where not measured.
    """
    jump = np.full(xyz.shape[:-1], np.nan)
    if len(xyz) > 3:
        jump[2:-1] = np.linalg.norm(np.diff(xyz, 3, axis=0), axis=-1)
    return _in_and_about(jump, _BRIEF)


def stretch(xyz: np.ndarray, bones: Bones) -> np.ndarray:
    """How much measured bones are longer or shorter than they are by the median: (F, P, J, 3) as `roughness`, a joint's
    bone being that from its parent.

    Fast limbs are as rough as noisy ones; their bones keep their lengths.

    Args:
        xyz: (F, P, J, 3) m; NaN where not measured.
        bones: Pairs of parent and joint.
    """
    length = _lengths(xyz, bones)
    return _in_and_about(np.abs(length - _median(length)), _AT_ONCE)


def mended(base: np.ndarray, xyz: np.ndarray, bones: Bones) -> np.ndarray:
    """How far from `base` hidden joints would be if their bones were as long as they are when measured, by the median.

    Args:
        base: (F, P, J, 3) m, interpolated where not measured.
        xyz: (F, P, J, 3) m; NaN where not measured.
        bones: Pairs of parent and joint.

    Returns:
        (F, P, J, 2, 3) m: for the bone from the joint's parent, and on average for those to its children. Zero where
        the joint is measured, and for bones that never are.
    """
    now = np.maximum(_lengths(base, bones), _SMOOTH)
    short = np.nan_to_num(_median(_lengths(xyz, bones)) / now - 1)
    off, children = np.zeros((*base.shape[:-1], 2, 3)), np.zeros(base.shape[2])
    for parent, joint in bones:
        off[:, :, joint, 0] = short[..., joint, None] * (base[:, :, joint] - base[:, :, parent])
        off[:, :, parent, 1] -= off[:, :, joint, 0]
        children[parent] += 1
    off[..., 1, :] /= np.maximum(children, 1)[:, None]
    return np.where(np.isnan(xyz[..., :1, None]), off, 0)


def _lengths(xyz: np.ndarray, bones: Bones) -> np.ndarray:
    """(F, P, J) m of joints' bones from their parents; NaN where unknown, and of roots."""
    length = np.full(xyz.shape[:-1], np.nan)
    for parent, joint in bones:
        length[..., joint] = np.linalg.norm(xyz[:, :, joint] - xyz[:, :, parent], axis=-1)
    return length


def _median(values: np.ndarray) -> np.ndarray:
    """Of (F, ...) over frames; NaN where there is none."""
    found = np.full(values.shape[1:], np.nan)
    known = ~np.isnan(values).all(0)
    found[known] = np.nanmedian(values[:, known], 0)
    return found


def _in_and_about(sizes: np.ndarray, frames: int) -> np.ndarray:
    """(F, P, J, 3) logarithms of means of `sizes` (F, P, J), m, those known: of the person, and of the joint over so
    many frames about where it is known last, and next."""
    known = ~np.isnan(sizes)
    sizes = np.nan_to_num(sizes)
    own = _mean(sizes, known, frames)
    person = _mean(sizes.sum(-1), known.sum(-1), _LONG)[..., None]
    person = np.broadcast_to(np.where(np.isnan(person), _ROUGH, person), own.shape)
    sides = (take(own[..., None], edge)[..., 0] for edge in neighbours(~np.isnan(own)))
    rough = np.stack([person, *(np.where(np.isnan(side), person, side) for side in sides)], -1)
    return np.log((rough + _SMOOTH) / _ROUGH)


def _mean(sums: np.ndarray, counts: np.ndarray, frames: int) -> np.ndarray:
    """Of sums (F, ...) over counts (F, ...), within so many frames; NaN where nothing is counted."""
    total = uniform_filter1d(sums, frames, axis=0, mode="constant")
    count = uniform_filter1d(counts.astype(float), frames, axis=0, mode="constant")
    some = count * frames > 0.5
    return np.where(some, total / np.where(some, count, 1), np.nan)
