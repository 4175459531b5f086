"""Surfaces of a body's segments in skin, hair and clothes."""

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise

import numpy as np

from synth.people.body import (
    ANKLE_HEIGHT,
    CHILD_FIGURE,
    FOREARM_LENGTH,
    SHIN_LENGTH,
    SIDES,
    THIGH_LENGTH,
    UPPER_ARM_LENGTH,
    Body,
    side_and_name,
)
from synth.people.clothing import PersonLooks
from synth.people.hands import hand
from synth.people.mesh import TILE, Mesh, dome, loft, merge
from synth.people.segments import SEGMENTS

SurfacePart = tuple[str, str, Mesh]
"""Segment, material (a name in `synth.people.mjcf`), and surface in the segment's frame, m."""

# Rows of t, p, q, a, b as `synth.people.mesh.loft` takes them, in fractions of stature for a body mass index of 22.5.
# Arms run along y with p forward and q up; legs run down with p forward and q to the left.
_UPPER_ARM = [(0, 0, -0.004, 0.031, 0.029), (0.03, 0, -0.004, 0.0325, 0.031), (0.08, 0, -0.001, 0.028, 0.028),
              (0.14, 0, 0, 0.0245, 0.0245), (UPPER_ARM_LENGTH, 0, 0, 0.0235, 0.0235)]  # fmt: skip
_FOREARM = [(0, 0, 0, 0.0235, 0.0235), (0.035, 0.002, 0, 0.026, 0.0245), (0.08, 0.001, 0, 0.022, 0.021),
            (0.125, 0, 0, 0.0175, 0.0145), (FOREARM_LENGTH, 0, 0, 0.0165, 0.0125)]  # fmt: skip
_THIGH = [(-0.005, -0.004, -0.006, 0.048, 0.041), (0.03, -0.002, -0.005, 0.0525, 0.0455),
          (0.07, 0.001, -0.003, 0.053, 0.046), (0.10, 0.004, -0.001, 0.050, 0.045), (0.18, 0.003, 0, 0.0385, 0.0375),
          (THIGH_LENGTH, 0, 0, 0.033, 0.033)]  # fmt: skip
_SHIN = [(0, 0, 0, 0.033, 0.033), (0.03, -0.002, 0, 0.0315, 0.032), (0.075, -0.008, 0, 0.034, 0.033),
         (0.15, -0.006, 0, 0.025, 0.025), (0.21, -0.003, 0, 0.019, 0.018),
         (SHIN_LENGTH, -0.002, 0, 0.020, 0.018)]  # fmt: skip
# Along x, p up and q to the left.
_SHOE = [(-0.032, -0.020, 0, 0.016, 0.016), (-0.015, -0.013, 0, 0.025, 0.0205), (0.008, -0.013, 0, 0.026, 0.021),
         (0.035, -0.019, 0, 0.019, 0.022), (0.07, -0.0245, 0.002, 0.0135, 0.0265),
         (0.098, -0.0275, 0, 0.0105, 0.024)]  # fmt: skip
# Height above the hip joints, p, depth and breadth of a masculine trunk, depth and breadth of a feminine one.
_TRUNK = [(-0.062, -0.004, 0.040, 0.052, 0.042, 0.054), (-0.035, -0.006, 0.058, 0.086, 0.061, 0.089),
          (0.0, -0.009, 0.065, 0.097, 0.069, 0.102), (0.045, -0.010, 0.066, 0.094, 0.067, 0.098),
          (0.09, -0.006, 0.062, 0.086, 0.058, 0.079), (0.13, -0.004, 0.061, 0.084, 0.054, 0.072),
          (0.18, -0.004, 0.064, 0.090, 0.060, 0.077), (0.225, -0.006, 0.069, 0.096, 0.069, 0.084),
          (0.265, -0.009, 0.065, 0.100, 0.061, 0.089), (0.290, -0.011, 0.054, 0.106, 0.050, 0.094),
          (0.303, -0.012, 0.046, 0.101, 0.043, 0.089), (0.312, -0.012, 0.040, 0.080, 0.037, 0.070),
          (0.319, -0.012, 0.036, 0.053, 0.033, 0.047), (0.325, -0.010, 0.034, 0.041, 0.031, 0.037)]  # fmt: skip
_HEAD = [(0.028, 0.034, 0, 0.024, 0.021), (0.036, 0.027, 0, 0.0345, 0.030), (0.048, 0.021, 0, 0.0430, 0.0360),
         (0.064, 0.016, 0, 0.0490, 0.0400), (0.080, 0.012, 0, 0.0535, 0.0425), (0.098, 0.0085, 0, 0.0565, 0.0445),
         (0.115, 0.006, 0, 0.0560, 0.0445), (0.132, 0.003, 0, 0.0475, 0.0390),
         (0.143, 0.001, 0, 0.0340, 0.0280)]  # fmt: skip
_NECK = [(-0.030, -0.004, 0, 0.034, 0.038), (0.0, 0.000, 0, 0.0325, 0.0335), (0.03, 0.007, 0, 0.032, 0.031),
         (0.06, 0.010, 0, 0.032, 0.030)]  # fmt: skip

_ALONG = {
    "l": np.array([(1, 0, 0), (0, 0, 1), (0, 1, 0)]).T,
    "r": np.array([(1, 0, 0), (0, 0, 1), (0, -1, 0)]).T,
    "down": np.array([(1, 0, 0), (0, 1, 0), (0, 0, -1)]).T,
    "up": np.eye(3),
    "forward": np.array([(0, 0, 1), (0, 1, 0), (1, 0, 0)]).T,
}
_BEND, _PIECES, _OVER = 0.030, 5, 0.006
"""The trunk bends from `_BEND` below to `_BEND` above each of its joints, in `_PIECES` pieces that overlap by `_OVER`.
Lengths are fractions of stature."""
_BELT = (0.060, 0.076)
"""Heights of both edges of the belt of a tucked shirt above the hip joints, fractions of stature."""
_CLOTH = 0.005
"""Thickness of cloth, m."""


def parts(body: Body, looks: PersonLooks) -> Iterator[SurfacePart]:
    """Return the visible surfaces of a person."""
    yield from _trunk(body, looks)
    yield from _head(body, looks)
    for segment in SEGMENTS:
        side, name = side_and_name(segment)
        if name in ("upper_arm", "forearm", "thigh", "shin"):
            yield from _limb(body, looks, segment, side, name)
        elif name == "hand":
            yield segment, "skin", hand(body, looks.hands["lr".index(side)], _ALONG[side])
        elif name == "foot":
            yield from _foot(body, segment)


def _limb(body: Body, looks: PersonLooks, segment: str, side: str, name: str) -> Iterator[SurfacePart]:
    arm = name in ("upper_arm", "forearm")
    rows = {"upper_arm": _UPPER_ARM, "forearm": _FOREARM, "thigh": _THIGH, "shin": _SHIN}[name]
    stations = np.array(rows) * body.stature
    stations[:, 0] *= body.arms if arm else body.leg
    slim = 1 - 0.05 * body.figure if arm else 1 + 0.05 * body.figure
    stations[:, 3:] *= body.girth * slim
    axes = _ALONG[side if arm else "down"]
    garment, material = (looks.top, "top") if arm else (looks.bottom, "bottom")
    upper = name in ("upper_arm", "thigh")
    length = stations[-1, 0]
    # A hanging arm must not rise above the shoulder.
    start = 0.5 if name == "upper_arm" else 0.9
    if garment.long:
        end = 1.0 if upper else 0.0
        yield segment, material, loft(_cloth(stations, length * 0.99, loose=name == "shin"), axes, ends=(start, end))
        return
    yield segment, "skin", loft(stations, axes, ends=(start, 0.9))
    if upper:
        hem = length * (0.62 if arm else 0.93)
        yield segment, material, loft(_cloth(stations, hem, loose=True), axes, ends=(start, 0))


def _cloth(stations: np.ndarray, stop: float, *, loose: bool) -> np.ndarray:
    """Return a limb's stations down to a hem, with cloth; loose cloth narrows only about half as much as the limb."""
    grid = np.linspace(stations[0, 0], stop, 10)
    clothed = np.stack([grid, *(np.interp(grid, stations[:, 0], column) for column in stations[:, 1:].T)], -1)
    clothed[:, 3:] += _CLOTH
    if loose:
        widest = np.maximum.accumulate(clothed[:, 3:], axis=0)
        clothed[:, 3:] = 0.45 * clothed[:, 3:] + 0.55 * widest
    return clothed


def _foot(body: Body, segment: str) -> Iterator[SurfacePart]:
    stations = np.array(_SHOE) * body.stature
    shoe = loft(stations, _ALONG["forward"], ends=(0.9, 1.0), rings=10, squareness=2.5)
    ground = -ANKLE_HEIGHT * body.stature
    shoe.vertices[:, 2] = np.maximum(shoe.vertices[:, 2], ground + 0.006)
    yield segment, "shoe", shoe
    sole = stations[:, [0, 1, 2, 4, 4]].copy()
    sole[:, 3:] += 0.003
    flat = loft(sole, _ALONG["forward"], ends=(1.0, 1.0), rings=10, squareness=2.5)
    height = flat.vertices[:, 2]
    height[:] = np.where(height > sole[:, 1].mean(), ground + 0.016, ground)
    yield segment, "sole", flat


def trunk_sections(body: Body, heights: np.ndarray) -> np.ndarray:
    """Return ellipses across the bare trunk.

    Args:
        body: The body.
        heights: (N,) heights above the hip joints, as fractions of stature, of a person with an average trunk.

    Returns:
        (N, 4) distance ahead of the hip joints and height above them, half depth and half breadth, m.
    """
    rows = np.array(_TRUNK)
    low, high, female = rows[:, :4], rows[:, 4:], body.figure
    stations = low.copy()
    stations[:, 2:] = (1 - female) * low[:, 2:] + female * high
    # The belly widens first.
    belly = np.exp(-(((rows[:, 0] - 0.1) / 0.08) ** 2))
    neck = np.clip((rows[:, 0] - 0.29) / 0.03, 0, 1)
    stations[:, 2] *= body.girth ** (1 + belly - 0.6 * neck)
    stations[:, 3] *= body.girth ** (1 + 0.4 * belly - 0.6 * neck)
    stations[:, 1] += belly * 0.04 * (body.girth - 1)
    stations *= body.stature
    up = stations[:, 0] * np.where(rows[:, 0] > 0, body.trunk, 1.0)
    columns = (stations[:, 1], up, stations[:, 2], stations[:, 3])
    return np.stack([np.interp(heights, rows[:, 0], column) for column in columns], -1)


def _trunk(body: Body, looks: PersonLooks) -> Iterator[SurfacePart]:
    grid = np.linspace(_TRUNK[0][0], _TRUNK[-1][0], 80)
    ahead, up, depth, breadth = trunk_sections(body, grid).T
    dense = np.stack([up, ahead, 0 * up, depth, breadth], -1)
    heights = np.cumsum(body.offsets[:4], axis=0)[:, [2, 0]]
    around = max(1, round(2 * np.pi * float(breadth.max()) / TILE))

    def piece(segment: str, start: float, stop: float, cloth, ends=(None, None), share: float = 1.0) -> Mesh:
        """Return the trunk between two heights with cloth on it: pairs of a height and a thickness, m."""
        z, x = heights[SEGMENTS.index(segment)]
        rows = np.linspace(start, stop, max(3, round(80 * (stop - start)))) * body.stature
        rows = np.stack([rows, *(np.interp(rows, up, column) for column in dense[:, 1:].T)], -1)
        rows[:, 3:] += np.interp(rows[:, 0] / body.stature, *np.array(cloth).T)[:, None]
        if 0 < share < 1:
            # The edges are below the surface of the adjacent pieces.
            rows[:, 3:] -= 0.001 * np.linspace(-1, 1, len(rows))[:, None] ** 8
        rows -= np.array((z, x, 0, 0, 0))
        rings = max(3, round(50 * (stop - start)))
        return replace(
            loft(rows, _ALONG["up"], ends=ends, rings=rings, sides=32, squareness=2.3, phase=z, repeats=around),
            share=share,
        )

    spine, chest = heights[1:3, 0] / body.stature
    shirt = [(-0.022, 0.020), (0.035, 0.008), (0.12, 0.006), (0.3, 0.005)]
    if looks.untucked:
        yield "pelvis", "bottom", piece("pelvis", -0.06, 0.04, [(-0.06, _CLOTH), (0.04, 0.003)], (0, None))
        yield "pelvis", "top", piece("pelvis", -0.022, spine - _BEND + _OVER, shirt, (0, None))
    else:
        shirt = [(-0.06, _CLOTH), (_BELT[1], 0.0075), *shirt[2:]]
        yield "pelvis", "bottom", piece("pelvis", -0.06, spine - _BEND + _OVER, shirt, (0, None))
        at = (np.mean(_BELT) - spine + _BEND) / (2 * _BEND)
        yield "spine", "shoe", piece("spine", *_BELT, [(0, 0.011), (1, 0.011)], (0, 0), at)
    # The trunk bends in many small steps: cloth neither tears in front nor opens at the back.
    for segment, joint, stop in (("spine", spine, chest - _BEND), ("chest", chest, None)):
        edges = np.linspace(joint - _BEND, joint + _BEND, _PIECES + 1)
        for number, (low, high) in enumerate(pairwise(edges)):
            share, belted = (number + 0.5) / _PIECES, segment == "spine" and not looks.untucked
            material = "bottom" if belted and high < _BELT[1] else "top"
            yield segment, material, piece(segment, low - _OVER, high + _OVER, shirt, share=share)
        if stop:
            yield segment, "top", piece(segment, joint + _BEND - _OVER, stop + _OVER, shirt)
    # The collar is closed around the neck.
    ribs = piece("chest", chest + _BEND - _OVER, 0.33, shirt, (None, 0.25))
    if body.figure > CHILD_FIGURE:
        ribs = ribs.pushed(_bust(body, ribs.vertices, heights[2, 0]))
    yield "chest", "top", ribs


def _bust(body: Body, points: np.ndarray, origin: float) -> np.ndarray:
    """Return the shift of points (N, 3) by a bust, (N, 3) m; the chest's origin is `origin` above the hips, m."""
    size = body.stature * body.girth**0.8
    up = (points[:, 2] - 0.222 * body.stature * body.trunk + origin) / (0.036 * size)
    aside = (np.abs(points[:, 1]) - 0.036 * body.stature) / (0.028 * size)
    bulge = np.exp(-(aside**2) - up**2) * (points[:, 0] > 0)
    share = (body.figure - CHILD_FIGURE) / (1 - CHILD_FIGURE)
    return np.outer(0.019 * size * share * bulge, (1, 0, 0))


def _head(body: Body, looks: PersonLooks) -> Iterator[SurfacePart]:
    size = body.stature * body.head
    head = loft(np.array(_HEAD), _ALONG["up"], ends=(0.9, 0.42), rings=14, sides=24, squareness=2.15)
    neck = np.array(_NECK)
    # The neck below the head does not scale with it.
    neck[:, 3:] *= body.girth**0.7 * (1 - 0.14 * body.figure) / body.head
    neck[neck[:, 0] < 0, 0] /= body.head
    flesh = [head, loft(neck, _ALONG["up"], ends=(None, None), rings=5)]
    flesh.append(_ball((0.0085, 0.0055, 0.0135), (0.0655, 0, 0.0775)))
    flesh.append(_ball((0.0085, 0.0085, 0.0060), (0.0680, 0, 0.0685)))
    flesh += [_ball((0.0085, 0.0040, 0.0155), (0.005, sign * 0.0450, 0.080)) for sign in SIDES.values()]
    yield "head", "skin", merge(*flesh).scaled(size)
    pairs = {
        "eye": ((0.0045, 0.0088, 0.0040), (0.0577, 0.0180, 0.0910)),
        "iris": ((0.0032, 0.0036, 0.0037), (0.0604, 0.0180, 0.0910)),
        "brow": ((0.0040, 0.0115, 0.0022), (0.0590, 0.0180, 0.1025)),
    }
    for material, (semi_axes, (x, y, z)) in pairs.items():
        both = [_ball(semi_axes, (x, sign * y, z)) for sign in SIDES.values()]
        yield "head", material, merge(*both).scaled(size)
    yield "head", "lip", _ball((0.0040, 0.0140, 0.0042), (0.0620, 0, 0.0510)).scaled(size)
    hair = list(_hair(looks.hair))
    if hair:
        yield "head", "hair", merge(*hair).scaled(size)


def _hair(style: str) -> Iterator[Mesh]:
    if style == "bald":
        return
    crown, semi_axes = (0.000, 0, 0.0975), np.array((0.0655, 0.0520, 0.0640))
    yield dome(semi_axes, (-0.50, 0, 0.87), 0.16 if style == "short" else 0.10).moved(crown)
    # The back of the head, down to the nape.
    yield dome((0.0635, 0.0510, 0.0660), (-0.93, 0, 0.36), -0.02).moved((-0.001, 0, 0.0900))
    if style == "bun":
        yield _ball((0.024, 0.026, 0.023), (-0.062, 0, 0.125))
    if style in ("bob", "long"):
        fall = {"bob": 0.030, "long": -0.060}[style]
        rows = [(fall, -0.036, 0, 0.010, 0.030), (fall + 0.03, -0.033, 0, 0.022, 0.044),
                (0.07, -0.024, 0, 0.034, 0.0515), (0.100, -0.020, 0, 0.038, 0.0500)]  # fmt: skip
        yield loft(np.array(rows), _ALONG["up"], ends=(0.6, 0.6), squareness=2.3)


def _ball(semi_axes, centre) -> Mesh:
    return dome(semi_axes, (0, 0, 1), -1, rings=5, sides=10).moved(centre)
