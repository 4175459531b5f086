"""Trunk, head and arms of people who follow no recording."""

import numpy as np

from synth.motion.rotations import about

HANGING = np.radians((0, 8, 20, 20, 20))
"""Angles of an arm at ease: flexion (forward) and abduction (outward) of the upper arm from hanging, inward turn about
itself, flexion of the elbow, pronation (turn of the thumb inward) from thumb forward; rad."""


def arm(chest: np.ndarray, side: float, angles: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Upper arm, forearm and hand, each (F, 3, 3), on a chest (F, 3, 3).

    Args:
        side: 1 for left, -1 for right.
        angles: (F, 5) as `HANGING`.
    """
    flexion, abduction, inward, elbow, pronation = angles.T
    hanging = about("x", -side * (np.pi / 2 - abduction))
    upper = chest @ about("y", -flexion) @ hanging @ about("y", inward)
    forearm = upper @ about("z", -side * elbow) @ about("y", pronation)
    return upper, forearm, forearm


def wander(rng: np.random.Generator, times: np.ndarray, rms: float, fastest: float) -> np.ndarray:
    """(F,) aimless motion of a given size: eight sines of random phase and of frequencies up to `fastest`, Hz."""
    frequencies, phases = rng.uniform(0.1 * fastest, fastest, 8), rng.uniform(0, 2 * np.pi, 8)
    return rms * 0.5 * np.sin(2 * np.pi * frequencies * times[:, None] + phases).sum(1)


def swing_width(speed: float) -> float:
    """By how much arms swing, with the opposite legs, at a walking speed, m/s; rad.

    The wider the faster: Murray, Sepic and Barnard, Physical Therapy 47 (1967).
    """
    return float(np.radians(np.interp(speed, (0.7, 1.6), (8, 20))))


def minimum_jerk(x: np.ndarray) -> np.ndarray:
    """From 0 to 1 the way hands go from rest to rest: Flash and Hogan, Journal of Neuroscience 5 (1985)."""
    x = np.clip(x, 0, 1)
    return x**3 * (10 - 15 * x + 6 * x**2)


def hang(rng: np.random.Generator, times: np.ndarray, swing: np.ndarray) -> np.ndarray:
    """(F, 5) angles, as `HANGING`, of an arm at ease that swings (F,) to the front, rad."""
    angles = HANGING + np.radians(rng.uniform((-8, -3, -15, -10, -15), (3, 6, 15, 15, 20)))
    angles = angles + np.stack([wander(rng, times, np.radians(1.5), 0.5) for _ in range(5)], axis=1)
    angles[:, 0] += swing
    # The elbow bends as the arm comes forward.
    angles[:, 3] += 0.5 * (np.abs(swing).max() + swing)
    return angles


def gesture(rng: np.random.Generator, kind: str, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A gesture of one arm at some time of the clip.

    Args:
        kind: `reach` or `wave`.
        times: (F,) s, evenly spaced.

    Returns:
        share: (F,) of the gesture against whatever the arm does else, 0 to 1.
        angles: (F, 5) as `HANGING`.
    """
    move = rng.uniform(0.6, 1.0)
    hold = rng.uniform(0.3, 1.0) if kind == "reach" else rng.uniform(1.2, 2.5)
    first = times[0] + rng.uniform(0, max(times[-1] - times[0] - 2 * move - hold, 0.1))
    share = minimum_jerk((times - first) / move) - minimum_jerk((times - first - move - hold) / move)
    if kind == "reach":
        angles = np.radians(rng.uniform((50, 0, -10, 5, 0), (115, 35, 30, 45, 60)))
        return share, np.tile(angles, (len(times), 1))
    # The forearm stands up and swings to and fro as the upper arm turns about itself.
    angles = np.tile(np.radians(rng.uniform((5, 65, -85, 80, -10), (30, 95, -60, 105, 20))), (len(times), 1))
    angles[:, 2] += np.radians(rng.uniform(15, 25)) * np.sin(2 * np.pi * rng.uniform(1.4, 2.4) * (times - first))
    return share, angles
