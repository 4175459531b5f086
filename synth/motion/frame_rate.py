"""The frame rate that gravity shows: people in the air fall with 9.81 m/s^2."""

from dataclasses import replace

import numpy as np

from synth.motion.feet import sole_points
from synth.motion.motion import Motion
from synth.people.body import Body, segment_origins

_GRAVITY = 9.81
"""m/s^2."""
_STATED = (119.0, 121.0)
"""Rates, frames a second, that conversions state whatever the true one is."""
_FLIGHT = 0.2
"""Least length of a flight at the stated rate, s."""
_CLEAR = 0.06
"""Height of the soles above which nobody stands on the floor, m."""
_HALF = (2.8, 5.7)
"""Fall, in units of gravity, that shows half the stated rate, which makes it four times as fast. At true rates it was
0.8 to 1.2 in flights, and below 0.2 of people on platforms and bars."""
_ODD = 0.1
"""Greatest deviation of a flight from a parabola, as a share of its height."""


def correct_rate(motion: Motion) -> Motion:
    """Return a motion at half its rate if that is a stated 120 with which people in the air would fall too fast."""
    if not _STATED[0] < motion.fps < _STATED[1]:
        return motion
    falls = _falls(motion)
    if not falls or not _HALF[0] < np.median(falls) < _HALF[1]:
        return motion
    note = f"at {motion.fps / 2:.4g}, as it falls with {np.median(falls):.2g} g at {motion.fps:.4g}"
    return replace(motion, fps=motion.fps / 2, name=f"{motion.name}, {note}")


def _falls(motion: Motion) -> list[float]:
    """Return the acceleration of the body's mass in each flight, in units of gravity."""
    body = Body(1.70)
    root = motion.root * body.hip_height / motion.hip_height
    origins = segment_origins(body, root, motion.rotations)
    height = (origins[..., 2] @ body.masses) / body.masses.sum()
    above = sole_points(body, root, motion.rotations)[..., 2].min((1, 2)) > _CLEAR
    edges = np.flatnonzero(np.diff(above, prepend=False, append=False))
    found = []
    for first, end in zip(edges[::2], edges[1::2], strict=True):
        if end - first < _FLIGHT * motion.fps:
            continue
        time = np.arange(end - first) / motion.fps
        parabola = np.polynomial.Polynomial.fit(time, height[first:end], 2).convert().coef
        left = height[first:end] - np.polynomial.polynomial.polyval(time, parabola)
        if left.std() < _ODD * np.ptp(height[first:end]):
            found.append(-2 * parabola[2] / _GRAVITY)
    return found
