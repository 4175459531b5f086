"""Arms, gestures and small random movements of procedural people."""

import numpy as np

from synth.motion.easing import minimum_jerk
from synth.motion.rotations import about

HANGING = np.radians((0, 8, 20, 20, 20))
"""(5,) angles of an arm at ease, rad: flexion (forward) and abduction (outward) of the upper arm from hanging, inward
turn about its length, flexion of the elbow, pronation (turn of the thumb inward) from thumb forward."""


def arm(chest: np.ndarray, side: float, angles: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return upper arm, forearm and hand, (F, 3, 3) each, on a chest (F, 3, 3).

    Args:
        chest: (F, 3, 3) orientation of the chest.
        side: 1 for left, -1 for right.
        angles: (F, 5) as `HANGING`, rad.
    """
    flexion, abduction, inward, elbow, pronation = angles.T
    hanging = about("x", -side * (np.pi / 2 - abduction))
    upper = chest @ about("y", -flexion) @ hanging @ about("y", inward)
    forearm = upper @ about("z", -side * elbow) @ about("y", pronation)
    return upper, forearm, forearm


def random_drift(rng: np.random.Generator, times: np.ndarray, rms: float, fastest: float) -> np.ndarray:
    """Return random smooth drift (F,): eight sines of random phase and frequency, up to `fastest`, Hz.

    Unlike AR(1) noise it is smooth enough to move a body.

    Args:
        rng: Draws frequencies and phases.
        times: (F,) s.
        rms: Root mean square of the drift.
        fastest: Greatest frequency, Hz; the least is a tenth of it.
    """
    frequencies, phases = rng.uniform(0.1 * fastest, fastest, 8), rng.uniform(0, 2 * np.pi, 8)
    return rms * 0.5 * np.sin(2 * np.pi * frequencies * times[:, None] + phases).sum(1)


def swing_width(speed: float) -> float:
    """Return the swing of the arms, rad, at a walking speed, m/s.

    Murray, Sepic and Barnard, Physical Therapy 47 (1967).
    """
    return float(np.radians(np.interp(speed, (0.7, 1.6), (8, 20))))


def hang(rng: np.random.Generator, times: np.ndarray, swing: np.ndarray) -> np.ndarray:
    """Return angles (F, 5), as `HANGING`, of an arm at ease that swings to the front by `swing` (F,), rad."""
    angles = HANGING + np.radians(rng.uniform((-8, -3, -15, -10, -15), (3, 6, 15, 15, 20)))
    angles = angles + np.stack([random_drift(rng, times, np.radians(1.5), 0.5) for _ in range(5)], axis=1)
    angles[:, 0] += swing
    # The elbow bends as the arm comes forward.
    angles[:, 3] += 0.5 * (np.abs(swing).max() + swing)
    return angles


def gesture(rng: np.random.Generator, kind: str, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Draw a gesture of one arm at a random time of the clip.

    Args:
        rng: Draws everything.
        kind: `reach` or `wave`.
        times: (F,) s, evenly spaced.

    Returns:
        share: (F,) weight of the gesture against the other motion of the arm, 0 to 1.
        angles: (F, 5) as `HANGING`, rad.
    """
    move = rng.uniform(0.6, 1.0)
    hold = rng.uniform(0.3, 1.0) if kind == "reach" else rng.uniform(1.2, 2.5)
    first = times[0] + rng.uniform(0, max(times[-1] - times[0] - 2 * move - hold, 0.1))
    share = minimum_jerk((times - first) / move) - minimum_jerk((times - first - move - hold) / move)
    if kind == "reach":
        angles = np.radians(rng.uniform((50, 0, -10, 5, 0), (115, 35, 30, 45, 60)))
        return share, np.tile(angles, (len(times), 1))
    # The forearm is upright and swings back and forth as the upper arm turns about its length.
    angles = np.tile(np.radians(rng.uniform((5, 65, -85, 80, -10), (30, 95, -60, 105, 20))), (len(times), 1))
    angles[:, 2] += np.radians(rng.uniform(15, 25)) * np.sin(2 * np.pi * rng.uniform(1.4, 2.4) * (times - first))
    return share, angles
