"""Hands: relaxed, open, round a grip, closed to a fist, pointing."""

import itertools

import numpy as np

from synth.people.body import Body
from synth.people.mesh import Mesh, loft, merge

# Along the hand with p towards the thumb and q up from the palm, fractions of stature; rows as `mesh.loft` takes them.
_PALM = [(-0.004, 0, 0, 0.0155, 0.0115), (0.015, 0.002, 0, 0.021, 0.0105), (0.04, 0.002, 0, 0.0235, 0.009),
         (0.056, 0.001, 0, 0.022, 0.0075)]  # fmt: skip
_FINGERS = [(0.0165, 0.038), (0.006, 0.046), (-0.0045, 0.042), (-0.0145, 0.033)]
"""Position across the palm, and length, from the index finger."""
_KNUCKLES, _FIRST = 0.050, 0.5
"""Position along the hand at which fingers begin, and the share of a finger before its middle joint."""
_THIN, _TIP = 0.0056, 0.0045
"""Half widths of a finger at its beginning and its tip."""
# For each finger, degrees below the palm's plane before and after the middle joint.
_BENDS = {
    "relaxed": ((8, 22), (11, 30), (13, 34), (15, 38)),
    "open": ((0, 4), (0, 5), (0, 5), (0, 5)),
    "grip": ((38, 105), (42, 110), (44, 112), (46, 114)),
    "fist": ((78, 185), (80, 188), (82, 190), (84, 190)),
    "point": ((4, 8), (80, 188), (82, 190), (84, 190)),
}
_SPREAD = {"open": 0.35}
"""Relative increase of the distance between fingers from the knuckles to the tips; 0.1 for other shapes."""
_THUMBS = {
    "relaxed": ((0.014, 0.0), (0.027, -0.008), (0.029, -0.018)),
    "open": ((0.014, 0.0), (0.034, -0.004), (0.046, -0.006)),
    "grip": ((0.014, 0.0), (0.028, -0.016), (0.020, -0.034)),
    "fist": ((0.014, 0.0), (0.026, -0.016), (0.008, -0.024)),
    "point": ((0.014, 0.0), (0.026, -0.016), (0.006, -0.024)),
}
"""Position across the hand and above the palm at the base, the joint and the tip of the thumb."""
_ALONG_THUMB = (0.004, 0.028, 0.052)
"""The same points along the hand."""


def hand(body: Body, shape: str, axes: np.ndarray) -> Mesh:
    """Return the surface of a hand in its segment's frame, m.

    Args:
        body: Proportions.
        shape: One of `synth.people.clothing.HANDS`.
        axes: (3, 3) columns are the directions towards the thumb, up from the palm, and along the hand.
    """
    size = body.stature * body.arms * (1 - 0.05 * body.figure)
    parts = [loft(np.array(_PALM) * size, axes, ends=(0.6, 0.6), rings=5, sides=12, squareness=2.6)]
    for (across, length), bends in zip(_FINGERS, _BENDS[shape], strict=True):
        spread = across * _SPREAD.get(shape, 0.1)
        start, widths = np.array((across, 0.0, _KNUCKLES)), np.linspace(_THIN, _TIP, 3)
        for number, (bend, share) in enumerate(zip(np.radians(bends), (_FIRST, 1 - _FIRST), strict=True)):
            way = share * length * np.array((0, -np.sin(bend), np.cos(bend))) + (spread * share, 0, 0)
            parts.append(_bone(start * size, (start + way) * size, widths[number : number + 2] * size, axes, number))
            start = start + way
    joints = [np.array((*at, along)) for at, along in zip(_THUMBS[shape], _ALONG_THUMB, strict=True)]
    for number, (start, end) in enumerate(itertools.pairwise(joints)):
        thick = np.array((0.0082, 0.0070, 0.0052))[number : number + 2]
        parts.append(_bone(start * size, end * size, thick * size, axes, number))
    return merge(*parts)


def _bone(start: np.ndarray, end: np.ndarray, widths: np.ndarray, axes: np.ndarray, number: int) -> Mesh:
    """Return a round bar between two points (3,) in the hand's axes; bars after the first have closed ends."""
    along = (end - start) / np.linalg.norm(end - start)
    across = np.array((1.0, 0, 0)) - along[0] * along
    across /= np.linalg.norm(across)
    own = axes @ np.stack([across, np.cross(along, across), along], axis=1)
    rows = np.array([(0, 0, 0, widths[0], widths[0]), (np.linalg.norm(end - start), 0, 0, widths[1], widths[1])])
    return loft(rows, own, ends=(1.0, 1.0) if number else (None, None), rings=2, sides=6).moved(axes @ start)
