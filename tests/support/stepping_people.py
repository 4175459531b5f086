"""People who step from place to place and stand there: truth of the floor and the vertical."""

import numpy as np

from dmae.data.clip import Poses3D
from dmae.data.skeleton import BODY25
from dmae.numerics.body import rotate_z

# m forward, left, up, at rest.
BODY = {
    "mid_hip": (0, 0, 0.95), "neck": (0, 0, 1.45), "nose": (0.1, 0, 1.6),
    **{f"{side}_{joint}": (x, sign * y, z)
       for side, sign in (("l", 1), ("r", -1))
       for joint, x, y, z in (
           ("eye", 0.08, 0.03, 1.64), ("ear", 0, 0.07, 1.62), ("shoulder", 0, 0.18, 1.42), ("elbow", 0, 0.2, 1.15),
           ("wrist", 0.05, 0.2, 0.92), ("hip", 0, 0.09, 0.93), ("knee", 0, 0.1, 0.5), ("ankle", 0, 0.1, 0.075),
           ("heel", -0.05, 0.1, 0.018), ("big_toe", 0.17, 0.09, 0.016), ("small_toe", 0.14, 0.14, 0.016))},
}  # fmt: skip


def stepping_people(
    persons: int, places: int, *, rng: np.random.Generator, lean_deg: float = 3.0, noise_m: float = 0.005
) -> Poses3D:
    """Poses (F, P, 25) at 25/s: each person stands for two seconds at each place, facing anywhere, leaning forward."""
    rest = np.array([BODY[joint] for joint in BODY25.joints])
    rest[:, 0] += np.tan(np.radians(lean_deg)) * np.maximum(rest[:, 2] - 0.075, 0)
    standing, moving = 50, 10
    frames = places * (standing + moving)
    xyz = np.empty((frames, persons, len(rest), 3))
    for person in range(persons):
        spots = np.column_stack([rng.uniform(-2, 2, (places + 1, 2)), np.zeros(places + 1)])
        headings = rng.uniform(0, 2 * np.pi, places + 1)
        for k in range(places):
            start = k * (standing + moving)
            xyz[start : start + standing, person] = rotate_z(rest, headings[k]) + spots[k]
            share = np.linspace(0, 1, moving)[:, None, None]
            lifted = np.sin(np.pi * share) * (0, 0, 0.15)
            between = rotate_z(rest, headings[k]) + spots[k] + share * (spots[k + 1] - spots[k]) + lifted
            xyz[start + standing : start + standing + moving, person] = between
    return Poses3D(BODY25, xyz + rng.normal(0, noise_m, xyz.shape))
