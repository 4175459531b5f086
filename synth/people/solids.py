"""The solid parts of people: capsules that collide, and the mass of the segments."""

from dataclasses import replace
from functools import lru_cache
from itertools import pairwise

import numpy as np
from scipy.optimize import least_squares

from synth.people.body import (
    FOREARM_LENGTH,
    SEGMENTS,
    SIDES,
    THIGH_LENGTH,
    UPPER_ARM_LENGTH,
    Body,
    segment_origins,
    side_and_name,
    sitting_depth,
    trunk_sections,
)
from synth.people.surface import bare_body

# Capsules across the trunk: height above the hips, as in `trunk_sections`, and the share of the depth there that the
# capsule fills; it is as wide as the trunk.
_ACROSS = {"pelvis": [(0.0, 1.0)], "spine": [(0.105, 1.0)], "chest": [(0.21, 1.0), (0.283, 0.75)]}
# Segment: (from, to, radius) in fractions of stature; left side. Radii widen with the body's girth.
_ALONG: dict[str, list[tuple]] = {
    "head": [((0, 0, 0), (0.010, 0, 0.050), 0.031), ((0.008, 0, 0.075), (0.004, 0, 0.100), 0.052)],
    "upper_arm": [((0, 0, 0), (0, UPPER_ARM_LENGTH, 0), 0.028)],
    "forearm": [((0, 0, 0), (0, FOREARM_LENGTH, 0), 0.021)],
    "hand": [((0, 0.008, 0), (0, 0.085, -0.004), 0.013)],
    "thigh": [((0, 0, -0.020), (0, 0, -THIGH_LENGTH), 0.041)],
    "shin": [((0, 0, 0), (0, 0, -0.235), 0.028)],
    "foot": [
        ((-0.022, -0.008, -0.021), (0.092, -0.012, -0.021), 0.018),
        ((-0.022, 0.008, -0.021), (0.080, 0.014, -0.021), 0.018),
    ],
}
_FIST = ((0, 0.008, 0), (0, 0.050, -0.008), 0.021)
"""The capsule of a hand that is closed to a fist."""
CLOTH = 0.012
"""Distance from a solid part at which contact begins, m."""
_LIMBS = ("upper_arm", "forearm", "thigh", "shin")
_SKULL = ("head", 1)
"""The capsule that scales with the head; the one before it is the neck."""
_FITTED_ACROSS = {"pelvis": (0.0, 0.05), "spine": (0.105, 0.155), "chest": (0.21, 0.26)}
"""Heights of the capsules across the trunk that are fitted to the skin."""
_SHOULDERS = _ACROSS["chest"][1]


def capsules(body: Body, hands: tuple[str, str] | None = None) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the solid parts of a body.

    Args:
        body: Proportions. If it is `snug`, trunk, arms and legs have capsules fitted to the skin.
        hands: Shapes of the left and the right hand, of `synth.people.clothing.HANDS`; a fist is shorter. They
            hold for the whole clip.

    Returns:
        segments: (C,) index into `SEGMENTS`.
        ends: (C, 2, 3) both ends of each capsule's axis in its segment's frame, m.
        radii: (C,) m.
    """
    fitted, solids = _fitted(body) if body.snug else {}, []
    for i, segment in enumerate(SEGMENTS):
        side, name = side_and_name(segment)
        if i in fitted:
            found = fitted[i]
        elif name in _ACROSS:
            found = [_across(body, i, *each) for each in _ACROSS[name]]
        elif name == "hand" and hands and hands["lr".index(side)] == "fist":
            found = [_along(body, segment, 0, _FIST)]
        else:
            found = [_along(body, segment, number, shape) for number, shape in enumerate(_ALONG[name])]
        solids += [(i, *each) for each in found]
    segments, ends, radii = zip(*solids, strict=True)
    return np.array(segments), np.array(ends), np.array(radii)


def inertias(body: Body, hands: tuple[str, str] | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Return the centre of mass (16, 3) m, and the inertia about it (16, 3, 3) kg m^2, of each segment, in its frame.

    The mass of a segment is spread over the capsules of the body's proportions, whatever collides: those that fit the
    skin overlap more.
    """
    segments, ends, radii = capsules(replace(body, snug=False), hands)
    along, middle = ends[:, 1] - ends[:, 0], ends.mean(1)
    length, square = np.linalg.norm(along, axis=1), radii**2
    volumes = np.stack([np.pi * square * length, 4 / 3 * np.pi * square * radii])
    mass = volumes * (body.masses / np.bincount(segments, volumes.sum(0)))[segments]
    # A cylinder, and two halves of a sphere at its ends, whose centres of mass are 3 r / 8 beyond them.
    around = mass[0] * square / 2 + mass[1] * square * 2 / 5
    across = mass[0] * (square / 4 + length**2 / 12)
    across += mass[1] * (square * 2 / 5 + length**2 / 4 + 3 / 8 * length * radii)
    axis = along / np.maximum(length, 1e-12)[:, None]
    own = across[:, None, None] * np.eye(3) + (around - across)[:, None, None] * axis[:, :, None] * axis[:, None]
    centres, total = np.zeros((len(SEGMENTS), 3)), np.zeros((len(SEGMENTS), 3, 3))
    np.add.at(centres, segments, mass.sum(0)[:, None] * middle / body.masses[segments][:, None])
    away = middle - centres[segments]
    shifted = (away**2).sum(1)[:, None, None] * np.eye(3) - away[:, :, None] * away[:, None]
    np.add.at(total, segments, own + mass.sum(0)[:, None, None] * shifted)
    return centres, total


def capsule_names(segments: np.ndarray) -> list[str]:
    """Return a name for each capsule, from the `segments` (C,) that `capsules` returns."""
    return [f"{SEGMENTS[each]}/solid{(segments[:number] == each).sum()}" for number, each in enumerate(segments)]


def _across(body: Body, segment: int, height: float, share: float) -> tuple[np.ndarray, float]:
    """Return the ends (2, 3) and the radius of a capsule across the trunk, m."""
    ahead, up, depth, breadth = trunk_sections(body, np.array([height]))[0]
    return _bar(body, segment, height, ahead, up, breadth - share * depth, share * depth)


def _bar(body: Body, segment: int, height: float, ahead: float, up: float, half: float, radius: float):
    if height == 0:
        # Contact with a seat begins where the surface meets it.
        up = radius + CLOTH - sitting_depth(body)
    return np.array(((ahead, -half, up), (ahead, half, up))) - body.offsets[: segment + 1].sum(0), radius


def _along(body: Body, segment: str, number: int, shape: tuple) -> tuple[np.ndarray, float]:
    """Return the ends (2, 3) and the radius of a capsule of the head or of a limb, m."""
    side, name = side_and_name(segment)
    stretch = np.full(3, body.stature)
    if name in ("upper_arm", "forearm", "hand"):
        stretch[1] *= body.arms
    elif name in ("thigh", "shin"):
        stretch[2] *= body.leg
    elif name == "head":
        stretch *= body.head
    stretch[1] *= SIDES.get(side, 1.0)
    start, stop, radius = shape
    wide = body.girth if name in _LIMBS else body.head if (name, number) == _SKULL else 1.0
    return np.array((start, stop)) * stretch, radius * body.stature * wide


# Solid parts that fit the skin

_BAND = 0.02
"""Half the height of the band of skin that a capsule across the trunk is fitted to, fraction of stature."""
_MOST_OF_ARMS, _MOST_OF_LEGS = 0.3, 0.6
"""Largest weights of arms and of legs at which skin belongs to the trunk."""
_UNDER_SKIN = 0.004
"""m; contact begins where `CLOTH` ends, 8 mm from the skin, and pushes people back to about there."""
_BULGE = 0.01
"""m; skin that is farther from a capsule counts less in its fit."""


@lru_cache(maxsize=64)
def _fitted(body: Body) -> dict[int, list[tuple[np.ndarray, float]]]:
    """Return, by segment, the ends (2, 3) and radii, m, of capsules close under the bare skin in T-pose.

    A capsule across the trunk fits a band of skin around it. A limb has one for each half, as it tapers; a thigh has
    one.
    """
    bare, upright = bare_body(body), np.tile(np.eye(3), (1, len(SEGMENTS), 1, 1))
    origins = segment_origins(body, np.zeros((1, 3)), upright)[0]
    places = np.einsum("sji,nsj->nsi", bare.rotations, bare.vertices[:, None] - bare.origins) + origins
    skin = np.einsum("ns,nsi->ni", bare.weights, places)
    names = np.array([side_and_name(segment)[1] for segment in SEGMENTS])
    arms, legs = (bare.weights[:, np.isin(names, each)].sum(1) for each in (_LIMBS[:2] + ("hand",), _LIMBS[2:]))
    trunk, found = (arms < _MOST_OF_ARMS) & (legs < _MOST_OF_LEGS), {}
    for i, name in enumerate(names.tolist()):
        if name in _FITTED_ACROSS:
            found[i] = []
            for height in _FITTED_ACROSS[name]:
                up = trunk_sections(body, np.array([height]))[0, 1]
                band = np.abs(skin[:, 2] - up) < _BAND * body.stature
                ahead, half, radius = _fit_across(skin[trunk & band, :2])
                found[i].append(_bar(body, i, height, ahead, up, half, radius - _UNDER_SKIN))
            if name == "chest":
                found[i].append(_across(body, i, *_SHOULDERS))
        elif name in _LIMBS:
            own = skin[bare.weights[:, i] > 0.5] - origins[i]
            (start, stop), _ = _along(body, SEGMENTS[i], 0, _ALONG[name][0])
            # Arms slide up thighs that taper.
            stations = np.linspace(start, stop, 2 if name == "thigh" else 3)
            found[i] = [_fit_along(own, *piece) for piece in pairwise(stations)]
    return found


def _fit_across(skin: np.ndarray) -> tuple[float, float, float]:
    """Return how far ahead a capsule across the trunk is, half the length of its axis, and its radius, m.

    It fits points (n, 2), x and y, on the skin of a trunk that is symmetric about y = 0.
    """
    ahead, aside = skin[:, 0], np.abs(skin[:, 1])
    depth = np.ptp(ahead) / 2

    def off(found: np.ndarray) -> np.ndarray:
        return np.hypot(ahead - found[0], np.maximum(aside - found[1], 0)) - found[2]

    start = ahead.mean(), max(aside.max() - depth, 0.01), depth
    low, high = (-np.inf, 0.005, 0.0), (np.inf, np.inf, np.inf)
    return tuple(least_squares(off, start, loss="soft_l1", f_scale=_BULGE, bounds=(low, high)).x.tolist())


def _fit_along(skin: np.ndarray, start: np.ndarray, stop: np.ndarray) -> tuple[np.ndarray, float]:
    """Return the ends (2, 3) and the radius of the capsule that fits points (n, 3) on the skin beside an axis, m.

    Circles are fitted to the skin across the axis (Kasa, IEEE Trans. Instrumentation and Measurement 25, 1976), whose
    middles lie on a line: x^2 + y^2 = 2 a x + 2 b y + c, with a and b linear along the axis, c quadratic.
    """
    axis = stop - start
    share = (skin - start) @ axis / (axis @ axis)
    beside = (share > -0.05) & (share < 1.05)
    across = np.linalg.svd(axis[None])[2][1:]
    t, (x, y) = share[beside], across @ (skin[beside] - start).T
    columns = np.stack([2 * x, 2 * x * t, 2 * y, 2 * y * t, np.ones_like(t), t, t**2], 1)
    a, slope_a, b, slope_b = np.linalg.lstsq(columns, x**2 + y**2, rcond=None)[0][:4]
    radius = np.median(np.hypot(x - a - slope_a * t, y - b - slope_b * t))
    shifts = np.array(((a, b), (a + slope_a, b + slope_b)))
    return np.stack([start, stop]) + shifts @ across, float(radius) - _UNDER_SKIN
