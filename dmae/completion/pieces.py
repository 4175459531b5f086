"""What networks are given: poses in m; of long recordings, pieces and what is known of the person 20 s around them."""

from collections.abc import Callable, Iterator
from itertools import pairwise
from math import ceil

import numpy as np

from dmae.data.clip import Poses3D
from dmae.files.mapped import empty, in_steps
from dmae.numerics.body import bone_lengths
from dmae.numerics.filling import are_stills, fill_stills
from dmae.progress import progress

WHOLE, _PIECE = 4000, 3000
"""Frames; shorter recordings are completed whole, and pieces, with their sides, are about as long as the second."""
_RATE = 25.0  # 1/s; both are as many times shorter as a rate is lower, as a model sees more frames there
_UNIT = 5.0
"""s; pieces begin at multiples of it, as blocks of `dmae.completion.gaussian_process` do, and every window of a
network that is a whole number of times shorter."""
_MARGIN = 4  # Units before and after a piece that are given with it
_LONGEST = 4.0
"""m; bones of people are shorter, by a factor of ten in the median. In mm they are 250 long, in cm 25."""


def check_given(poses: Poses3D, fps: float) -> None:
    """Raise ValueError if fps is not positive and finite, or measured bones in some of the frames are so long that
    coordinates are not in m."""
    if not (np.isfinite(fps) and fps > 0):
        raise ValueError(f"fps must be positive, found {fps}")
    some = poses.select(slice(None, None, 1 + len(poses.xyz) // 100))
    lengths = bone_lengths(np.where(some.measured[..., None], some.xyz, np.nan), poses.skeleton.bones)
    lengths = lengths[np.isfinite(lengths)]
    if len(lengths) and (median := float(np.median(lengths))) > _LONGEST * poses.skeleton.scale:
        raise ValueError(
            f"poses: expected coordinates in m, found bones of {median:.3g} m; divide those in mm by 1000, in cm by 100"
        )


def in_pieces(
    complete: Callable[[Poses3D, float, slice], Poses3D], poses: Poses3D, fps: float, frames: slice = slice(None)
) -> Poses3D:
    """Return `complete(poses, fps, frames)`, of a long recording person by person, in pieces with 20 s on both sides.

    Lengths of bones are then the medians within a piece and its sides, and gaps are filled by what was measured there.
    Stills are completed each by itself.

    Args:
        complete: Returns some frames of poses, completed by all of them, with the same persons.
        frames: Those to return.
    """
    if are_stills(fps):
        return fill_stills(lambda stills, rate: complete(stills, rate, slice(None)), poses.select(frames))
    asked = range(len(poses.xyz))[frames]
    parts = list(_parts(len(poses.xyz), fps, asked))
    count, persons = poses.xyz.shape[:2]
    if not (count and persons and parts) or parts[0][1] == slice(0, count):
        return complete(poses, fps, frames)
    made, skeleton = {}, poses.skeleton
    tasks = [(person, *part) for person in range(persons) for part in parts]
    for person, inner, around in in_steps(progress(tasks, "completing")):
        inside = slice(inner.start - around.start, inner.stop - around.start)
        done = complete(poses.select(around, slice(person, person + 1)), fps, inside)
        skeleton = done.skeleton
        for name, array in done.arrays.items():
            if name not in made:
                made[name] = empty((len(asked), persons, *array.shape[2:]), array.dtype)
            made[name][inner.start - asked.start : inner.stop - asked.start, person] = array[:, 0]
    return Poses3D(skeleton, **made)


def _parts(count: int, fps: float, asked: range) -> Iterator[tuple[slice, slice]]:
    """Yield pieces of the frames asked for, of a recording of `count`, and the frames to give with each."""
    whole, piece = (frames * min(fps / _RATE, 1) for frames in (WHOLE, _PIECE))
    unit = max(_UNIT * fps, 1)
    margin = ceil(_MARGIN * unit)
    # Units at a time: as many frames as their margins have, or more where a unit is short.
    step = max(round((piece - 2 * margin) / unit), _MARGIN)
    if count <= max(whole, 2 * margin + step * unit):
        yield slice(asked.start, asked.stop), slice(0, count)
        return
    bounds = [round(number * unit) for number in range(0, ceil(count / unit), step)] + [count]
    for start, stop in pairwise(bounds):
        first = max(round(start / unit) - _MARGIN, 0)
        inner = slice(max(start, asked.start), min(stop, asked.stop))
        if inner.start < inner.stop:
            yield inner, slice(round(first * unit), min(stop + margin, count))
