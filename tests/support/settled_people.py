"""People who sit at a table, stand, dance and step: errors of their feet stay the same as long as they stay."""

from collections.abc import Callable

import numpy as np

from dmae.data.clip import Poses3D
from dmae.data.skeleton import BODY25
from dmae.numerics.body import rotate_z
from tests.support.stepping_people import BODY, stepping_people

_FPS = 25
_UPRIGHT = np.array([BODY[joint] for joint in BODY25.joints])
_FEET = {
    side: [i for i, joint in enumerate(BODY25.joints) if joint in {f"{side}_{part}" for part in
           ("ankle", "heel", "big_toe", "small_toe")}]
    for side in "lr"
}  # fmt: skip
_LEG = {"hip": (0, 0.45), "knee": (0.42, 0.48), "ankle": (0.40, 0.075), "heel": (0.35, 0.018), "big_toe": (0.57, 0.016)}
"""m forward and up of people who sit."""


def _sitting() -> np.ndarray:
    body = _UPRIGHT - (0, 0, 0.48)
    for side in "lr":
        for part, (forward, up) in (_LEG | {"small_toe": (0.54, 0.016)}).items():
            body[BODY25.index(f"{side}_{part}")[0], [0, 2]] = forward, up
    return body


def seated(rng: np.random.Generator, guess_m: float, straight: bool = False, persons: int = 5) -> Poses3D:
    """Return poses (1500, P, 25) of a meal: legs under a table are guessed, wrong by the same until the feet move.

    Args:
        guess_m: m, standard deviation of the error of a foot.
        straight: Whether the legs of three in five are guessed straight below the hips, half as long as legs are.
    """
    frames, parts = 60 * _FPS, []
    for person in range(persons):
        angle = 2 * np.pi * person / persons + rng.uniform(-0.2, 0.2)
        body, blocks, done = _sitting(), [], 0
        above = body[:, 2] > 0.5
        body[above, 0] += np.tan(np.radians(rng.normal(8, 6))) * (body[above, 2] - 0.45)
        guessed = straight and rng.random() < 0.6
        while done < frames:
            stays, now = int(rng.uniform(5, 30) * _FPS), body.copy()
            for side, feet in _FEET.items():
                moved = (rng.uniform(-0.3, 0.1), 0, rng.uniform(0, 0.15)) if rng.random() < 0.4 else (0, 0, 0)
                now[feet] += rng.normal(0, guess_m, 3) + moved + rng.normal(0, guess_m / 2, (len(feet), 3))
                if guessed:
                    hip, knee = BODY25.index(f"{side}_hip", f"{side}_knee")
                    now[knee] = now[hip] + (*rng.normal(0, 0.03, 2), -0.22)
                    now[feet] = now[hip] + (*rng.normal(0, 0.06, 2), -0.42) + rng.normal(0, 0.02, (len(feet), 3))
            blocks.append(np.repeat(now[None], stays, 0))
            done += stays
        seat = 1.1 * np.array([np.cos(angle), np.sin(angle), 0])
        parts.append(rotate_z(np.concatenate(blocks)[:frames], angle + np.pi) + seat)
    xyz = np.stack(parts, 1)
    return Poses3D(BODY25, xyz + rng.normal(0, 0.008, xyz.shape))


def standing(rng: np.random.Generator, foot_m: float, persons: int = 3) -> Poses3D:
    """Return poses (750, P, 25) of people who stand, turn and step; `foot_m`, m: error of a foot."""
    frames, parts = 30 * _FPS, []
    for _ in range(persons):
        spot, heading = np.array([*rng.uniform(-1.5, 1.5, 2), 0]), rng.uniform(0, 2 * np.pi)
        lean, blocks, done = rng.normal((2, 0), (3, 1.5)), [], 0
        while done < frames:
            stays, now = int(rng.uniform(5, 15) * _FPS), _UPRIGHT.copy()
            now[:, :2] += np.tan(np.radians(lean + rng.normal(0, 1.2, 2))) * np.maximum(now[:, 2:] - 0.075, 0)
            for feet in _FEET.values():
                now[feet] += rng.normal(0, foot_m, 3)
            blocks.append(np.repeat((rotate_z(now, heading) + spot)[None], stays, 0))
            spot, heading, done = spot + (*rng.normal(0, 0.3, 2), 0), heading + rng.normal(0, 0.6), done + stays
        parts.append(np.concatenate(blocks)[:frames])
    xyz = np.stack(parts, 1)
    return Poses3D(BODY25, xyz + rng.normal(0, 0.006, xyz.shape))


def dancing(rng: np.random.Generator, persons: int = 2) -> Poses3D:
    """Return poses (1200, P, 25) of people who lean anywhere at each of twenty places."""
    poses = stepping_people(persons, 20, rng=rng, lean_deg=rng.normal(3, 3), noise_m=0.008)
    xyz = poses.xyz.astype(np.float64).reshape(20, 60, persons, len(BODY25), 3)
    lean = np.tan(rng.normal(0, np.radians(5), (20, 1, persons, 1, 2)))
    xyz[..., :2] += lean * np.maximum(xyz[..., 2:] - 0.075, 0)
    for feet in _FEET.values():
        xyz[..., feet, :] += rng.normal(0, 0.015, (20, 1, persons, 1, 3))
    return Poses3D(BODY25, xyz.reshape(poses.xyz.shape))


KINDS: dict[str, Callable[[np.random.Generator], Poses3D]] = {
    "five at a table, feet guessed to 3 cm": lambda rng: seated(rng, 0.03),
    "five at a table, feet guessed to 5 cm": lambda rng: seated(rng, 0.05),
    "five at a table, legs guessed straight": lambda rng: seated(rng, 0.02, straight=True),
    "two at a table, feet guessed to 2 cm": lambda rng: seated(rng, 0.02, persons=2),
    "three stand, feet to 1.5 cm": lambda rng: standing(rng, 0.015),
    "three stand, feet to 3 cm": lambda rng: standing(rng, 0.03),
    "two dance": dancing,
    "two step from place to place": lambda rng: stepping_people(2, 8, rng=rng),
}
