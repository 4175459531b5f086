"""People who carry a box and pass it on."""

from collections.abc import Callable, Sequence

import numpy as np

from synth.interactions.body_measures import arm_length, within_reach
from synth.interactions.paths import approach, arrival, during, standing, wrapped
from synth.interactions.registry import interaction
from synth.interactions.script import Cast, Grip, Load, Poses, Reach, Role, Script
from synth.motion.easing import minimum_jerk
from synth.people.body import Body
from synth.rooms.props import prop_size

_BOX = "box"
_CLOTH = 0.013
"""Distance of palms from the box at which contact begins, m."""
_LOW, _HIGH = 0.02, 0.10
"""Height of the first and the second person's grip above the box's middle, m: both above, so that it does not tip."""


@interaction(persons=(2, 2))
def pass_box(cast: Cast, *, rng: np.random.Generator) -> Script:
    """One person carries a box to another, who takes it, turns, and carries it away."""
    seconds, last = cast.seconds, cast.seconds[-1]
    yaw = rng.uniform(0, 2 * np.pi)
    ahead, left = np.array((np.cos(yaw), np.sin(yaw))), np.array((-np.sin(yaw), np.cos(yaw)))
    held, _ = holding_place(cast.bodies)
    when = min(rng.uniform(1.3, 2.4), 0.36 * last)
    start = np.array((*(-(held[0] + min(1.1, 0.6 * when)) * ahead), yaw))
    there = np.array((*(-held[0] * ahead), yaw))
    bringing = approach(cast, start, there, begin=0.0, speed=(there - start)[:2] @ ahead / max(when, 0.6))
    taken = float(arrival(start, there, 0.0, (there - start)[:2] @ ahead / max(when, 0.6))) + 0.15
    waiting = np.array((*(held[1] * ahead), yaw + np.pi))
    aside = rng.choice((-1, 1))
    away = waiting[:2] + min(1.2, max(0.0, 0.5 * (last - taken - 1.2))) * (0.5 * ahead + 0.87 * aside * left)
    going = yaw + aside * np.pi / 3
    leaving = approach(cast, waiting, np.array((*away, going)), begin=taken + 1.2, speed=0.6)
    paths = (
        bringing,
        leaving if np.linalg.norm(away - waiting[:2]) > 0.3 else standing(cast, waiting[:2], yaw + np.pi),
    )

    load, hold = hand_over(cast, (0, 1), paths, taken)
    gazes = [np.full(len(seconds), 1 - person) for person in range(2)]
    gazes[1][seconds > taken + 0.9] = -1
    roles = tuple(Role(path, gaze=gaze, hands=("open", "open")) for path, gaze in zip(paths, gazes, strict=True))
    return Script(roles, clearance=0.5, loads=(load,), reaches=hold)


def holding_place(bodies: Sequence[Body]) -> tuple[list[float], float]:
    """Return the distance of the box ahead of each of two people's hips as they pass it on, and its height, m."""
    arms = [arm_length(body) for body in bodies]
    # The nearer the box, the larger its range of heights: people of different stature pass it close by.
    for share in (0.66, 0.58, 0.50, 0.44):
        held = [share * arm for arm in arms]
        low, high = within_reach(bodies, held)
        if low - _LOW <= high - _HIGH:
            break
    return held, float(np.clip(0.60 * np.mean([body.stature for body in bodies]), low - _LOW, high - _HIGH))


def hand_over(
    cast: Cast, people: tuple[int, int], paths: Sequence[np.ndarray], taken: float
) -> tuple[Load, Callable[[Poses], list[Reach]]]:
    """Return a box that the first of two people holds at the start of the clip and the second takes.

    Args:
        cast: All people.
        people: Indices of the person who gives and of the person who takes.
        paths: (F, 3) of both; they face each other at the time `taken`, with the box between them.
        taken: Time at which the second person has the box, s.

    Returns:
        The box, and the function for the reaches of both people's hands.
    """
    half_width = float(prop_size(_BOX).reach[1])
    seconds = cast.seconds
    held, height = holding_place([cast.bodies[person] for person in people])

    def front(k: int) -> np.ndarray:
        heading = paths[k][:, 2]
        return paths[k][:, :2] + held[k] * np.stack([np.cos(heading), np.sin(heading)], 1)

    share = minimum_jerk((seconds - taken) / 0.3)
    middle = np.column_stack([front(0) + share[:, None] * (front(1) - front(0)), np.full(len(seconds), height)])
    turned = paths[0][:, 2] + share * wrapped(paths[1][:, 2] - np.pi - paths[0][:, 2])
    across = np.stack([-np.sin(turned), np.cos(turned), 0 * turned], 1)
    shares = (during(seconds, -1.0, taken + 0.45, 0.5), minimum_jerk((seconds - taken + 0.75) / 0.7))

    def hold(poses: Poses) -> list[Reach]:
        reaches = []
        for k, (way, up) in enumerate(((1, _LOW), (-1, _HIGH))):
            for side, sign in (("l", way), ("r", -way)):
                # Hands are open before they grip and after they let go.
                grip = half_width + _CLOTH + 0.06 * (1 - shares[k][:, None])
                palm = middle + sign * grip * across + (0, 0, up)
                reaches.append(Reach(people[k], side, shares[k], palm, -sign * across))
        return reaches

    grips = (Grip(people[0], -1.0, taken + 0.4, _LOW), Grip(people[1], taken, float(seconds[-1]) + 1.0, _HIGH))
    return Load(_BOX, tuple(float(x) for x in middle[0]), float(turned[0]), half_width + _CLOTH, grips), hold
