"""How people look: closed surfaces of skin, hair and clothes, swept along limbs and trunk; cached on disk."""

import hashlib
import itertools
import os
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cache, cached_property
from importlib import metadata
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
import trimesh
from safetensors import SafetensorError
from safetensors.numpy import load, save
from scipy.interpolate import PchipInterpolator

from dmae.files.contents import write_atomic
from synth.people import body as bodies
from synth.people.body import (
    ANKLE_HEIGHT,
    CHILD_FIGURE,
    FOREARM_LENGTH,
    SEGMENTS,
    SHIN_LENGTH,
    SIDES,
    THIGH_LENGTH,
    UPPER_ARM_LENGTH,
    Body,
    side_and_name,
)
from synth.people.clothing import PersonLooks

TILE = 0.3
"""Length of cloth that one repeat of a texture covers, m."""


@dataclass(frozen=True)
class Mesh:
    """A textured triangle mesh.

    Attributes:
        vertices: (N, 3) m.
        uv: (N, 2) texture coordinates, 1 per repeat.
        faces: (T, 3) vertex indices, counter-clockwise seen from outside.
        swept: (N, 4) number of each vertex's surface, and the vertex's position when swept. Shading is computed from
            them, so that it does not change as the mesh moves.
        share: Share of the rotation of its segment's joint that the mesh follows: 1 for all of it, less for a piece of
            cloth between the segment and its parent.
    """

    vertices: np.ndarray
    uv: np.ndarray
    faces: np.ndarray
    swept: np.ndarray
    share: float = 1.0

    @cached_property
    def normals(self) -> np.ndarray:
        """(N, 3) unit normals, outward. Vertices of a surface in the same place share one: no seam is visible."""
        places, place = np.unique(np.round(self.swept, 6), axis=0, return_inverse=True)
        return trimesh.Trimesh(places[:, 1:], place[self.faces], process=False).vertex_normals[place]

    def moved(self, offset) -> "Mesh":
        """Return the mesh moved by an offset (3,), m."""
        return replace(self, vertices=self.vertices + offset)

    def pushed(self, offsets: np.ndarray) -> "Mesh":
        """Return the mesh with each vertex moved by its own offset, (N, 3) m; the shading follows."""
        swept = self.swept + np.concatenate([np.zeros((len(offsets), 1)), offsets], axis=1)
        return replace(self, vertices=self.vertices + offsets, swept=swept)

    def scaled(self, factor: float) -> "Mesh":
        """Return the mesh scaled about the origin."""
        return replace(self, vertices=self.vertices * factor)


def merge(*meshes: Mesh) -> Mesh:
    """Merge meshes into one."""
    vertices, uv, swept = (
        np.concatenate([getattr(mesh, field) for mesh in meshes]) for field in ("vertices", "uv", "swept")
    )
    starts = np.cumsum([0] + [len(mesh.vertices) for mesh in meshes])
    surfaces = np.cumsum([0] + [mesh.swept[-1, 0] + 1 for mesh in meshes])
    swept[:, 0] += np.repeat(surfaces[:-1], np.diff(starts))
    faces = np.concatenate([mesh.faces + start for mesh, start in zip(meshes, starts, strict=False)])
    return Mesh(vertices, uv, faces, swept)


def loft(
    stations: np.ndarray,
    axes: np.ndarray,
    *,
    ends: tuple[float | None, float | None] = (1.0, 1.0),
    rings: int = 9,
    sides: int = 16,
    squareness: float = 2.0,
    phase: float = 0.0,
    repeats: int | None = None,
) -> Mesh:
    """Return the surface that an ellipse sweeps along an axis.

    Args:
        stations: (S, 5) rows of t, p, q, a, b, m: position along the axis, centre and half widths of the ellipse across
            it; smooth and monotone in between (PCHIP).
        axes: (3, 3) columns are the directions of p, q and t.
        ends: Bulge of the first and the last ellipse into a cap, relative to its smaller half width; 0 closes it flat,
            as a hem; None leaves it open, where another surface continues.
        rings: Number of ellipses along the axis, without caps.
        sides: Number of vertices around the axis.
        squareness: Exponent of the superellipse, 2 for an ellipse.
        phase: Texture coordinate along the axis at t = 0.
        repeats: Number of texture repeats around the axis; by default as many as fit.
    """
    t = stations[:, 0]
    grid = np.linspace(t[0], t[-1], rings)
    p, q, a, b = PchipInterpolator(t, stations[:, 1:])(grid).T
    body = np.stack([grid, p, q, a, b], -1)
    profile = np.concatenate([_cap(body[0], ends[0], -1)[::-1], body, _cap(body[-1], ends[1], 1)])

    angle = np.linspace(0, 2 * np.pi, sides + 1)
    cos, sin = np.cos(angle), np.sin(angle)
    around = [np.sign(wave) * np.abs(wave) ** (2 / squareness) for wave in (cos, sin)]
    height, centre_p, centre_q, half_p, half_q = profile.T[..., None]
    local = np.stack(
        np.broadcast_arrays(centre_p + half_p * around[0], centre_q + half_q * around[1], height), -1
    )  # (R, sides + 1, 3)
    repeats = repeats or max(1, round(2 * np.pi * float(max(a.max(), b.max())) / TILE))
    uv = np.stack(np.broadcast_arrays(angle / (2 * np.pi) * repeats, (height + phase) / TILE), -1)
    return _surface(local @ np.asarray(axes).T, uv, inverted=bool(np.linalg.det(axes) < 0))


def _cap(end: np.ndarray, bulge: float | None, direction: int) -> np.ndarray:
    """Return rings (C, 5) that close an ellipse by half an ellipsoid or, without bulge, flat; nearest first."""
    if bulge is None:
        return np.empty((0, 5))
    angle = np.radians((32.0, 60.0, 80.0, 90.0))
    # A ring just inside a flat rim keeps the rim's shading sharp; a pole of zero size would make empty triangles.
    shrink = np.maximum(np.cos(angle), 1e-3) if bulge else np.array([0.97, 1e-3])
    cap = np.repeat(end[None], len(shrink), axis=0)
    if bulge:
        cap[:, 0] += direction * bulge * min(end[3], end[4]) * np.sin(angle)
    cap[:, 3:] *= shrink[:, None]
    return cap


def _surface(points: np.ndarray, uv: np.ndarray, *, inverted: bool) -> Mesh:
    """Return triangles between neighbours in a grid of points (R, C, 3), the last column repeating the first."""
    index = np.arange(points.shape[0] * points.shape[1]).reshape(points.shape[:2])
    low, high, low_next, high_next = index[:-1, :-1], index[1:, :-1], index[:-1, 1:], index[1:, 1:]
    triangles = [np.stack(three, -1).reshape(-1, 3) for three in ((low, low_next, high_next), (low, high_next, high))]
    faces, vertices = np.concatenate(triangles), points.reshape(-1, 3)
    faces = faces[:, ::-1] if inverted else faces
    one, two, three = vertices[faces.T]
    (ax, ay, az), (bx, by, bz) = (two - one).T, (three - one).T
    # Written out because numpy's cross and norm take longer than the rest of this function.
    double_area = np.sqrt((ay * bz - az * by) ** 2 + (az * bx - ax * bz) ** 2 + (ax * by - ay * bx) ** 2)
    swept = np.concatenate([np.zeros((len(vertices), 1)), vertices], axis=1)
    return Mesh(vertices, uv.reshape(-1, 2), faces[double_area > 2e-10], swept)


def dome(semi_axes, towards, cut: float, *, rings: int = 10, sides: int = 24) -> Mesh:
    """Return the part of an ellipsoid beyond a plane, closed flat: a cap of hair with a clean rim.

    Args:
        semi_axes: (3,) of the ellipsoid, m, along x, y, z; its centre is the origin.
        towards: (3,) normal of the plane in coordinates in which the ellipsoid is a unit sphere.
        cut: Distance of the plane from the centre in those coordinates, -1..1.
        rings: Rings from rim to pole.
        sides: Vertices around.
    """
    direction = np.asarray(towards, float) / np.linalg.norm(towards)
    side = np.cross((0.0, 1.0, 0.0), direction)
    side /= np.linalg.norm(side)
    across = np.cross(direction, side)
    polar = np.linspace(np.arccos(cut), 2e-3, rings)
    height = np.concatenate([np.cos(polar[[0, 0]]), np.cos(polar)])
    radius = np.concatenate([(2e-3, 0.97 * np.sin(polar[0])), np.sin(polar)])
    angle = np.linspace(0, 2 * np.pi, sides + 1)
    ring = np.cos(angle)[:, None] * side + np.sin(angle)[:, None] * across
    unit = radius[:, None, None] * ring + height[:, None, None] * direction
    points = unit * np.asarray(semi_axes)
    return _surface(points, points[..., 1:] / TILE, inverted=False)


# Hands: relaxed, open, round a grip, closed to a fist, pointing.

# Along the hand with p towards the thumb and q up from the palm, fractions of stature; rows as `loft` takes them.
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


# Surfaces of a body's segments in skin, hair and clothes.

SurfacePart = tuple[str, str, Mesh]
"""Segment, material (a name in `synth.people.mjcf`), and surface in the segment's frame, m."""

# Rows of t, p, q, a, b as `loft` takes them, in fractions of stature for a body mass index of 22.5.
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


# Surfaces of people, made once and cached on disk.

_SLOTS = 512
"""Number of cached files, of half a megabyte each. Each person is assigned to one file and overwrites what is there."""
_DIGEST = hashlib.sha256().digest_size


class Surface(NamedTuple):
    """A part of the visible surface of a person.

    Attributes:
        segment: Segment that it moves with.
        material: Name of its material.
        vertices: (N, 3) m, in the segment's frame.
        faces: (T, 3) vertex indices, counter-clockwise seen from outside.
        normals: (N, 3) float32, unit; None without shading.
        uv: (N, 2) float32 texture coordinates, 1 per repeat; None without shading.
        share: (1,) share of the rotation of the segment's joint that it follows, see `Mesh`.
    """

    segment: str
    material: str
    vertices: np.ndarray
    faces: np.ndarray
    normals: np.ndarray | None
    uv: np.ndarray | None
    share: np.ndarray


def surfaces(body: Body, looks: PersonLooks, *, shaded: bool) -> list[Surface]:
    """Return the surfaces of a person, `parts`, from the cache if they were made before.

    The cache is the folder DMAE_CACHE, else `dmae-synth` in XDG_CACHE_HOME or `~/.cache`. There is none if DMAE_CACHE
    is empty or the folder cannot be written. If the code or the libraries changed, or a file is damaged, surfaces are
    computed again.

    Args:
        body: Proportions.
        looks: Hair, cut of the clothes, and shapes of the hands.
        shaded: Whether to add normals and texture coordinates.
    """
    cut = (looks.hair, looks.top.long, looks.bottom.long, looks.untucked, looks.hands)
    key = hashlib.sha256(repr((_made_by(), body, cut, shaded)).encode()).digest()
    return _cached(key, lambda: _make(body, looks, shaded))


def _make(body: Body, looks: PersonLooks, shaded: bool) -> list[Surface]:
    def light(values: np.ndarray) -> np.ndarray:
        return values.astype(np.float32)

    return [
        Surface(
            segment,
            material,
            mesh.vertices,
            mesh.faces.astype(np.int32),
            light(mesh.normals) if shaded else None,
            light(mesh.uv) if shaded else None,
            np.array([mesh.share]),
        )
        for segment, material, mesh in parts(body, looks)
    ]


@cache
def _made_by() -> str:
    """Return a hash of the code that makes surfaces, and the versions of its libraries."""
    source = Path(bodies.__file__).read_bytes() + Path(__file__).read_bytes()
    libraries = [f"{name} {metadata.version(name)}" for name in ("numpy", "scipy", "trimesh")]
    return " ".join([hashlib.sha256(source).hexdigest(), *libraries])


def _folder() -> Path | None:
    asked = os.environ.get("DMAE_CACHE")
    if asked is not None:
        return Path(asked) if asked else None
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "dmae-synth"


def _cached(key: bytes, make: Callable[[], list[Surface]]) -> list[Surface]:
    folder = _folder()
    if folder is None:
        return make()
    path = folder / f"person{int.from_bytes(key[:8]) % _SLOTS:03d}.bin"
    try:
        return _unpack(key, path.read_bytes())
    except (OSError, ValueError, SafetensorError):
        made = make()
    data = save(
        {
            f"{number}/{surface.segment}/{surface.material}/{field}": np.ascontiguousarray(values)
            for number, surface in enumerate(made)
            for field, values in zip(Surface._fields[2:], surface[2:], strict=True)
            if values is not None
        }
    )
    # If the disk is full or read-only, the surfaces are computed again next time.
    with suppress(OSError):
        write_atomic(path, key + hashlib.sha256(data).digest() + data, lasting=False)
    return made


def _unpack(key: bytes, data: bytes) -> list[Surface]:
    """Return the surfaces in a file's bytes. Raise ValueError if they belong to another person, or are damaged."""
    digest, packed = data[len(key) : len(key) + _DIGEST], data[len(key) + _DIGEST :]
    if data[: len(key)] != key or hashlib.sha256(packed).digest() != digest:
        raise ValueError("the file holds another surface, or is damaged")
    fields: dict[int, dict] = {}
    for name, values in load(packed).items():
        number, segment, material, field = name.split("/")
        fields.setdefault(int(number), {"segment": segment, "material": material})[field] = values
    return [Surface(**{"normals": None, "uv": None} | fields[number]) for number in sorted(fields)]
