"""The shapes of hats, on the convex hull of the skull, and of bags, on the cloth that they lie on."""

from typing import NamedTuple

import numpy as np
from scipy.spatial import ConvexHull

_RIMS = {"cap": (0.0345, 0.20), "beanie": (0.021, 0.38)}
"""Height of the rim above the eyes at their distance ahead, and its slope upwards to the front; fractions of stature
and of the head's size."""
_AROUND, _ROWS = 36, 7
"""Points around a hat, and rows of them from its rim to its top."""
_LIP, _PRESSED = 0.22, 0.0015
"""How far the rim reaches inwards, fraction of its radius, and how far pressed hair is below a hat, fraction of stature
and of the head's size."""
_BRIM, _HALF_BRIM, _DOWN = 0.042, np.radians(68), np.radians(22)
"""Length of a brim, fraction of stature and of the head's size; half the angle that it covers around the head, and its
slope downwards."""


class Crown(NamedTuple):
    """The room of a hat: the convex hull of the skull above the rim, continued downwards."""

    kind: str  # One of `synth.people.clothing.HATS`
    middle: np.ndarray  # (3,) m
    planes: np.ndarray  # (K, 4) outward unit normals, and distances from the middle, m
    rim: tuple[float, float]  # Height at the middle, m, and slope upwards to the front
    size: float  # Stature times the size of the head, m

    @classmethod
    def of(cls, kind: str, scalp: np.ndarray, eyes: np.ndarray, size: float) -> "Crown":
        """Return the room of a hat on a scalp (N, 3), m, with eyes around a point (3,)."""
        height, slope = _RIMS[kind]
        middle = np.array((scalp[:, 0].min() + 0.055 * size, 0.0, eyes[2] + 0.02 * size))
        rim = eyes[2] + height * size + slope * (middle[0] - eyes[0]) - middle[2]
        above = scalp[:, 2] - middle[2] - rim - slope * (scalp[:, 0] - middle[0])
        hull = ConvexHull(scalp[above > -0.004 * size] - middle).equations
        hull = hull[hull[:, 2] > -0.2]
        return cls(kind, middle, hull * (1, 1, 1, -1), (rim, slope), size)

    def above(self, points: np.ndarray) -> np.ndarray:
        """Return the (N,) heights of points (N, 3) above the rim, m."""
        return points[:, 2] - self.middle[2] - self.rim[0] - self.rim[1] * (points[:, 0] - self.middle[0])

    def radius(self, ways: np.ndarray) -> np.ndarray:
        """Return the (N,) distances of the hull from the middle along unit vectors (N, 3), m."""
        facing = ways @ self.planes[:, :3].T
        return np.where(facing > 1e-3, self.planes[:, 3] / np.maximum(facing, 1e-3), np.inf).min(1)

    def clearance(self, around: np.ndarray, share: np.ndarray) -> np.ndarray:
        """Return how far a hat is outside of the hull, m: by the angle from the front, and the share of the way from
        the rim to the top."""
        if self.kind == "cap":
            panel = np.clip(np.cos(around), 0, 1) * np.sin(np.pi * np.clip(share, 0, 1)) ** 1.5
            return self.size * (0.005 + 0.004 * panel + 0.002 * np.sin(np.pi * share))
        cuff = np.interp(share, (0.26, 0.30), (0.0045, 0.0))
        return self.size * (0.0045 + cuff + 0.012 * np.clip(share, 0, 1) ** 3)

    def pressed(self, points: np.ndarray) -> np.ndarray:
        """Return hair (N, 3) that does not stand out of the hat, and gets its own shape back below the rim."""
        out = points - self.middle
        far = np.linalg.norm(out, axis=1)
        around = np.arctan2(out[:, 1], out[:, 0])
        room = self.radius(out / far[:, None]) + self.clearance(around, np.zeros(len(out))) - _PRESSED * self.size
        room += 0.6 * np.maximum(-self.above(points) - 0.005 * self.size, 0)
        return self.middle + out * np.minimum(1, room / far)[:, None]


def hat(crown: Crown) -> list[tuple[str, np.ndarray, np.ndarray]]:
    """Return the material, the points (N, 3), m, and the triangles (T, 3) of each part of a hat."""
    around = np.arange(_AROUND) / _AROUND * 2 * np.pi
    flat = np.stack([np.cos(around), np.sin(around)], -1)
    low = np.zeros(_AROUND)
    for _ in range(12):
        ways = np.column_stack([np.cos(low)[:, None] * flat, np.sin(low)])
        rim = (crown.radius(ways) + crown.clearance(around, 0 * low))[:, None] * ways
        low = np.arctan2(crown.rim[0] + crown.rim[1] * rim[:, 0], np.hypot(*rim[:, :2].T))
    rows = [rim * (1 - _LIP, 1 - _LIP, 1) + (0, 0, 0.004 * crown.size), rim]
    for share in np.linspace(0, 1, _ROWS + 1)[1:-1]:
        up = low + share * (np.pi / 2 - low)
        ways = np.column_stack([np.cos(up)[:, None] * flat, np.sin(up)])
        rows.append((crown.radius(ways) + crown.clearance(around, np.full(_AROUND, share)))[:, None] * ways)
    top = np.array([[0.0, 0.0, 1.0]])
    top = top * (crown.radius(top) + crown.clearance(np.zeros(1), np.ones(1)))
    points = np.concatenate([*rows, top])
    faces = [_between(row * _AROUND, (row + 1) * _AROUND, _AROUND, closed=True) for row in range(len(rows) - 1)]
    last = (len(rows) - 1) * _AROUND + np.arange(_AROUND)
    faces.append(np.column_stack([last, np.roll(last, -1), np.full(_AROUND, len(points) - 1)]))
    found = [("hat", points + crown.middle, np.concatenate(faces))]
    if crown.kind == "cap":
        found.append(("brim", *_brim(crown, rim, around)))
    return found


def _brim(crown: Crown, rim: np.ndarray, around: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return points and triangles of a brim, a closed plate, in front of a rim (A, 3)."""
    turn = np.linspace(-_HALF_BRIM, _HALF_BRIM, 15)
    start = np.stack([np.interp(turn, (around + np.pi) % (2 * np.pi) - np.pi, c, period=2 * np.pi) for c in rim.T], -1)
    long = _BRIM * crown.size * np.cos(turn / _HALF_BRIM * np.pi / 2) ** 0.7
    wide = np.abs(start[:, 1]).max()
    rows = []
    for share in (-0.08, 0.45, 0.9, 1.0):
        ahead = share * long
        drop = np.tan(_DOWN) * ahead + 0.010 * crown.size * share * (start[:, 1] / wide) ** 2
        rows.append(start + np.stack([ahead, 0 * ahead, 0.0025 * crown.size - drop], -1))
    upper = np.concatenate(rows)
    count, half = len(turn), 0.0009 * crown.size
    points = np.concatenate([upper + (0, 0, half), upper - (0, 0, half)])
    top = np.concatenate([_between(row * count, (row + 1) * count, count) for row in range(len(rows) - 1)])
    edge = np.concatenate([
        np.arange(count), np.arange(1, len(rows)) * count + count - 1,
        (len(rows) - 1) * count + np.arange(count - 2, -1, -1), np.arange(len(rows) - 2, 0, -1) * count,
    ])  # fmt: skip
    after, below = np.roll(edge, -1), len(upper)
    sides = np.concatenate([
        np.column_stack([edge, after, edge + below]), np.column_stack([after, after + below, edge + below])
    ])  # fmt: skip
    return points + crown.middle, np.concatenate([top, top[:, ::-1] + below, sides])


class _Cut(NamedTuple):
    """Measures of a bag, fractions of stature."""

    half_width: float
    below: float  # Of its top: the height of its middle
    half_height: float
    depth: float
    turn: float  # Angle from the front to its side of the trunk, rad


_CUTS = {
    "backpack": _Cut(0.080, 0.122, 0.118, 0.072, np.pi),
    "shoulder_bag": _Cut(0.070, 0.268, 0.052, 0.036, np.radians(143)),
}
# From the middle of the side that touches the person round the edges to the middle of the other: shares of the
# width and height, and of the depth.
_PROFILE = ((0.0, 0.0), (0.6, 0.0), (0.94, 0.0), (1.0, 0.14), (1.0, 0.62), (0.94, 0.86), (0.78, 0.97), (0.4, 1.0),
            (0.0, 1.0))  # fmt: skip
_OUTLINE, _POCKET = 24, (0.78, -0.40, 0.50, 0.8, 1.18)
"""Points around a bag; width of a backpack's pocket, the height of its middle, its height, and where it begins and ends
in depth, relative to the bag's."""


def bag(
    kind: str, sign: float, cloth: np.ndarray, top: float, stature: float
) -> list[tuple[str, np.ndarray, np.ndarray]]:
    """Return the material, the points (N, 3), m, and the triangles (T, 3) of each part of a bag without its straps.

    Args:
        kind: One of `synth.people.clothing.BAGS`.
        sign: 1 for a bag on the left, -1 on the right.
        cloth: (M, 3) points of what the trunk wears, m, in the bind pose.
        top: Height of the shoulder joints, m.
        stature: m.
    """
    shape = _CUTS[kind]
    half = np.array((shape.half_width, shape.half_height)) * stature
    out = np.array((np.cos(shape.turn), sign * np.sin(shape.turn)))
    across, middle = np.array((-out[1], out[0])), top - shape.below * stature
    aside, away = cloth[:, :2] @ across / half[0], cloth[:, :2] @ out
    up = (cloth[:, 2] - middle) / half[1]
    near = (away > 0) & (np.abs(aside) < 1.05) & (np.abs(up) < 1.05)
    fit = np.linalg.lstsq(_powers(aside[near], up[near]), away[near], rcond=None)[0]
    fit[0] += np.percentile(away[near] - _powers(aside[near], up[near]) @ fit, 80)
    found = []
    parts = [("bag", np.ones(2), 0.0, 0.0, shape.depth)]
    if kind == "backpack":
        wide, at, high, start, end = _POCKET
        parts.append(("strap", np.array((wide, high)), at, start * shape.depth, (end - start) * shape.depth))
    for material, share, at, start, depth in parts:
        angle = np.arange(_OUTLINE) / _OUTLINE * 2 * np.pi
        ring = np.sign([np.cos(angle), np.sin(angle)]) * np.abs([np.cos(angle), np.sin(angle)]) ** 0.4
        nothing = np.zeros((2, 1))
        places = np.concatenate([nothing, *(ring * wide for wide, _ in _PROFILE[1:-1]), nothing], 1).T * share + (0, at)
        deep = np.concatenate([[0.0], *(np.full(_OUTLINE, each) for _, each in _PROFILE[1:-1]), [1.0]])
        # A backpack is deeper below.
        belly = 1 - 0.3 * places[:, 1] if kind == "backpack" else 1.0
        far = _powers(*places.T) @ fit + (start + deep * depth) * stature * belly
        points = np.column_stack(
            [np.outer(far, out) + np.outer(places[:, 0] * half[0], across), middle + places[:, 1] * half[1]]
        )
        faces = [
            _between(1 + row * _OUTLINE, 1 + (row + 1) * _OUTLINE, _OUTLINE, closed=True)
            for row in range(len(_PROFILE) - 3)
        ]
        first, last = 1 + np.arange(_OUTLINE), len(points) - 1 - _OUTLINE + np.arange(_OUTLINE)
        faces.append(np.column_stack([np.roll(first, -1), first, 0 * first]))
        faces.append(np.column_stack([last, np.roll(last, -1), np.full(_OUTLINE, len(points) - 1)]))
        found.append((material, points, np.concatenate(faces)))
    return found


def _powers(aside: np.ndarray, up: np.ndarray) -> np.ndarray:
    return np.stack([np.ones_like(up), aside, up, aside**2, up**2, aside * up, up**3], -1)


def _between(low: int, high: int, count: int, *, closed: bool = False) -> np.ndarray:
    """Return the triangles (T, 3) between two rows of points, which begin at indices `low` and `high`."""
    one = np.arange(count if closed else count - 1)
    next_ = (one + 1) % count
    return np.concatenate([
        np.column_stack([low + one, low + next_, high + next_]), np.column_stack([low + one, high + next_, high + one])
    ])  # fmt: skip
