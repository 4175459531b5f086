"""Measures of bodies that interactions need: seats, arms, trunks, and the heights that hands reach."""

from collections.abc import Sequence

import numpy as np

from synth.interactions.script import STOOL
from synth.motion.inverse_kinematics import PALM
from synth.people.body import Body
from synth.people.segments import SEGMENTS
from synth.people.shape import trunk_sections
from synth.rooms.props import prop_size

_CLOTH = 0.012
"""Distance from a seat at which contact begins, m."""
_SQUARE, _SHIRT = 2.3, 0.005
"""Exponent of the superellipse across a trunk, and thickness of cloth on it, m."""
_PROJECTIONS = 20
_STRETCH = 0.94
"""Greatest extension of an arm at ease, as a share of its length."""


def seated(body: Body) -> float:
    """Return the hip height in sitting on a stool, m."""
    return float(prop_size(STOOL).reach[2]) + _CLOTH + trunk_sections(body, np.zeros(1))[0, 2]


def arm_length(body: Body) -> float:
    """Return the distance from the shoulder to the palm of a straight arm, m."""
    lengths = sum(float(np.linalg.norm(body.offsets[SEGMENTS.index(f"l_{part}")])) for part in ("forearm", "hand"))
    return lengths + float(PALM[1]) * body.stature * body.arms


def thickness(body: Body) -> float:
    """Return half the greatest depth of the trunk, at the belly or at the chest, m."""
    return float(trunk_sections(body, np.array((0.105, 0.21)))[:, 2].max())


def on_trunk(body: Body, height: float, angle: float, press: float) -> tuple[str, np.ndarray, np.ndarray]:
    """Return a point on the clothed skin of the trunk, and the direction out of it there.

    Args:
        body: The body.
        height: Height above the hip joints, as a fraction of stature, of a person with an average trunk.
        angle: Direction from the middle of the trunk: 0 to the front, pi / 2 to the left, rad.
        press: Depth of the point below the skin, m.

    Returns:
        The segment that the point moves with, the point (3,) in its frame, m, and the unit normal (3,).
    """
    ahead, up, depth, breadth = trunk_sections(body, np.array([height]))[0]
    segment = "pelvis" if height < 0.05 else "spine" if height < 0.13 else "chest"
    origin = np.cumsum(body.offsets[: SEGMENTS.index(segment) + 1], axis=0)[-1]
    cos, sin = np.cos(angle), np.sin(angle)
    # A superellipse, as the surface is drawn.
    far = (np.abs(cos) ** _SQUARE + np.abs(sin) ** _SQUARE) ** (-1 / _SQUARE)
    normal = np.array((np.sign(cos) * np.abs(far * cos) ** (_SQUARE - 1) / depth,
                       np.sign(sin) * np.abs(far * sin) ** (_SQUARE - 1) / breadth, 0.0))  # fmt: skip
    normal /= np.linalg.norm(normal)
    point = np.array((ahead + far * cos * (depth + _SHIRT), far * sin * (breadth + _SHIRT), up))
    return segment, point - origin - press * normal, normal


def nearest_reached(points: np.ndarray, bodies: Sequence[Body], shoulders: Sequence[np.ndarray]) -> np.ndarray:
    """Return points (F, 3), m, moved as little as necessary for a palm of each person to reach them.

    Alternating projections find them. If no point is in reach of all people, the result is between them.

    Args:
        points: (F, 3) m.
        bodies: Bodies of the people.
        shoulders: (F, 3) m of each person, the shoulder of the arm.
    """
    for _ in range(_PROJECTIONS):
        for body, shoulder in zip(bodies, shoulders, strict=True):
            way = points - shoulder
            far = np.linalg.norm(way, axis=1, keepdims=True)
            points = shoulder + way * np.minimum(1, _STRETCH * arm_length(body) / np.maximum(far, 1e-6))
    return points


def within_reach(bodies: Sequence[Body], away: Sequence[float]) -> tuple[float, float]:
    """Return the least and greatest height at which the palms of all people can be, standing upright, m.

    The palm is a horizontal distance `away`, m, from each person's shoulder. If there is no such height, the
    least exceeds the greatest.
    """
    low, high = 0.0, np.inf
    for body, far in zip(bodies, away, strict=True):
        up = [body.offsets[SEGMENTS.index(segment)][2] for segment in ("spine", "chest", "l_upper_arm")]
        shoulder, span = body.hip_height + sum(up), _STRETCH * arm_length(body)
        rise = np.sqrt(max(span**2 - far**2, 0.0))
        low, high = max(low, shoulder - rise), min(high, shoulder + rise)
    return float(low), float(high)
