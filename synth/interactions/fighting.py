"""People who spar."""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d

from synth.interactions.body_measures import arm_length, on_trunk
from synth.interactions.paths import during
from synth.interactions.registry import interaction
from synth.interactions.script import Cast, Poses, Reach, Role, Script

_SIGN = {"l": 1.0, "r": -1.0}
_APART, _NEAR = (1.6, 1.8), (1.06, 1.14)
"""Distances between the hips in circling, and when a blow of the left hand lands, as shares of an arm's length."""
_BEHIND, _HIGH = 0.14, 0.10
"""Reduction of the distance for blows of the right hand, and for blows at the face, as shares of an arm's length."""
_KNUCKLES = 0.028
"""Distance of a fist's knuckles beyond the point that a palm reaches, as a fraction of stature."""
_AIMS = {"face": 0.25, "chest": 0.35, "belly": 0.25, "beside": 0.15}
"""Targets of blows, and their frequency; `beside` misses the face."""
_GUARD = (0.155, 0.055, 0.15)
"""Position of fists in the guard, in the frame of the chest, y outward, as fractions of stature."""
_OPEN = {"face": (0.12, 0.12, 0.03), "chest": (0.10, 0.15, 0.19), "belly": (0.12, 0.13, 0.20)}
"""Position of the fists of the person who is hit, as a blow at the face, chest or belly lands."""
_LEAST = 0.71
"""Least distance between the hips, m; at smaller distances feet and knees collide."""
_LEAN, _RECOIL = 0.36, 0.16
"""Greatest lean into a blow, and away from one, rad."""


@dataclass(frozen=True)
class _Blow:
    """A blow: time `at` which it lands, s, person, hand (`side`), target (`aim`), offset `aside`, depth `press`, m."""

    at: float
    person: int
    side: str
    aim: str
    aside: float
    press: float


@interaction(persons=(2, 2))
def fight(cast: Cast, *, rng: np.random.Generator) -> Script:
    """Two people spar: guards up, they circle, step in, and hit each other's face, chest and belly, or miss."""
    seconds = cast.seconds
    arms = [arm_length(body) for body in cast.bodies]
    yaw = rng.uniform(0, 2 * np.pi) + rng.choice((-1, 1)) * rng.uniform(0.1, 0.3) * seconds
    blows = _blows(seconds[-1], rng=rng)
    far, close = rng.uniform(*_APART) * np.mean(arms), rng.uniform(*_NEAR)
    # The distance is least at each blow, within reach of the striking arm: the right shoulder is behind the left one.
    apart = np.full(len(seconds), far)
    for blow in blows:
        near = (close - max(_BEHIND * (blow.side == "r"), _HIGH * (blow.aim == "face"))) * arms[blow.person]
        near = max(near, _LEAST)
        at_blow = np.minimum(1.1 * np.exp(-(((seconds - blow.at) / 0.3) ** 2)), 1)
        apart = np.minimum(apart, far - (far - near) * at_blow)
    apart = gaussian_filter1d(apart, 0.1 * cast.fps, mode="nearest")
    roles = []
    for person, sign in enumerate((-1, 1)):
        xy = sign * apart[:, None] / 2 * np.stack([np.cos(yaw), np.sin(yaw)], 1)
        path = np.column_stack([xy, yaw + (np.pi if sign > 0 else 0) - 0.35])
        lean = np.full(len(seconds), 0.05)
        for blow in blows:
            if blow.person == person:
                lean += _LEAN * during(seconds, blow.at - 0.02, blow.at + 0.04, 0.3)
            elif blow.aim != "beside":
                lean -= _RECOIL * during(seconds, blow.at + 0.2, blow.at + 0.24, 0.14)
        roles.append(
            Role(
                path,
                gaze=np.full(len(seconds), 1 - person),
                hips=np.full(len(seconds), 0.96 * cast.bodies[person].hip_height),
                lean=np.clip(lean, -0.15, 0.42),
                hands=("fist", "fist"),
            )
        )

    def strike(poses: Poses) -> list[Reach]:
        return [_hand(cast, poses, person, side, blows) for person in range(2) for side in _SIGN]

    return Script(tuple(roles), clearance=0.9 * (close - _BEHIND) * min(arms), reaches=strike)


def _blows(last: float, *, rng: np.random.Generator) -> list[_Blow]:
    """Return the blows of a clip of `last` s: single ones and combinations of both hands."""
    blows, at, pause = [], rng.uniform(0.6, 1.0), rng.uniform(0.6, 1.5)
    while at < max(last - 0.25, 0.61):
        person, side = int(rng.integers(2)), str(rng.choice(("l", "r")))
        for _ in range(1 + int(rng.random() < 0.35)):
            aim = str(rng.choice(list(_AIMS), p=list(_AIMS.values())))
            blows.append(_Blow(at, person, side, aim, float(rng.uniform(-0.5, 0.5)), float(rng.uniform(0.015, 0.035))))
            at, side = at + rng.uniform(0.4, 0.5), "l" if side == "r" else "r"
        at += pause * rng.uniform(0.5, 1.4)
    return blows


def _hand(cast: Cast, poses: Poses, person: int, side: str, blows: list[_Blow]) -> Reach:
    """Return the reach of a fist: to its guard, and to the targets of its blows."""
    body, size, sign = cast.bodies[person], cast.bodies[person].stature, _SIGN[side]
    guard = _guard(poses, person, sign, _GUARD, size)
    for blow in blows:
        if blow.person != person and blow.aim != "beside":
            # The hands of the person who is hit leave the target open.
            open_ = during(cast.seconds, blow.at - 0.12, blow.at + 0.12, 0.22)[:, None]
            guard += open_ * (_guard(poses, person, sign, _OPEN[blow.aim], size) - guard)
    shoulder = poses.point(person, "chest", (0, 0.1 * sign * size, 0.137 * size))
    palm, along = guard.copy(), np.zeros(len(cast.seconds))
    for blow in blows:
        if (blow.person, blow.side) != (person, side):
            continue
        way = _aimed(cast, poses, 1 - person, blow) - shoulder
        far = np.linalg.norm(way, axis=1, keepdims=True)
        end = shoulder + way / far * np.minimum(0.99 * arm_length(body), far - _KNUCKLES * size + blow.press)
        hit = during(cast.seconds, blow.at - 0.04, blow.at + 0.06, 0.2)[:, None]
        palm, along = palm + hit * (end - palm), np.maximum(along, hit[:, 0])
    # A fist turns as the arm stretches: from thumb up to back of the hand up.
    upright, level = poses.axis(person, "chest", (0, -sign, -0.6)), poses.axis(person, "chest", (0, -0.4 * sign, -1.0))
    normal = upright + along[:, None] * (level - upright)
    return Reach(person, side, np.ones(len(cast.seconds)), palm, normal, straight=True)


def _guard(poses: Poses, person: int, sign: float, place: tuple[float, float, float], size: float) -> np.ndarray:
    """Return the palm of a fist that is held at a place in front of the chest, (F, 3) m."""
    ahead, outward, up = (size * each for each in place)
    return poses.point(person, "chest", (ahead, sign * outward, up))


def _aimed(cast: Cast, poses: Poses, other: int, blow: _Blow) -> np.ndarray:
    """Return the point that a blow is aimed at, (F, 3) m."""
    body = cast.bodies[other]
    if blow.aim in ("face", "beside"):
        aside = 0.02 * blow.aside + 0.11 * np.copysign(blow.aim == "beside", blow.aside)
        return poses.point(other, "head", tuple(np.array((0.060, aside, 0.062)) * body.stature * body.head))
    height = 0.23 if blow.aim == "chest" else 0.11
    segment, point, _ = on_trunk(body, height + 0.02 * blow.aside, blow.aside, 0.0)
    return poses.point(other, segment, tuple(point))
