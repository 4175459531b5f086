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
_STRETCH = 0.94
"""Greatest extension of an arm at ease, as a share of its length."""


def seated(body: Body) -> float:
    """Height of the hips in sitting on a stool, m."""
    return float(prop_size(STOOL).reach[2]) + _CLOTH + trunk_sections(body, np.zeros(1))[0, 2]


def arm_length(body: Body) -> float:
    """Distance from the shoulder to the palm of a straight arm, m."""
    lengths = sum(float(np.linalg.norm(body.offsets[SEGMENTS.index(f"l_{part}")])) for part in ("forearm", "hand"))
    return lengths + float(PALM[1]) * body.stature * body.arms


def thickness(body: Body) -> float:
    """Half the greatest depth of the trunk, at the belly or at the chest, m."""
    return float(trunk_sections(body, np.array((0.105, 0.21)))[:, 2].max())


def within_reach(bodies: Sequence[Body], away: Sequence[float]) -> tuple[float, float]:
    """Least and greatest height at which all people, standing upright, reach a palm, m.

    The palm is a horizontal distance `away`, m, from each person's shoulder. The least exceeds the greatest where there
    is no such height.
    """
    low, high = 0.0, np.inf
    for body, far in zip(bodies, away, strict=True):
        up = [body.offsets[SEGMENTS.index(segment)][2] for segment in ("spine", "chest", "l_upper_arm")]
        shoulder, span = body.hip_height + sum(up), _STRETCH * arm_length(body)
        rise = np.sqrt(max(span**2 - far**2, 0.0))
        low, high = max(low, shoulder - rise), min(high, shoulder + rise)
    return float(low), float(high)
