"""People at work at a shelf."""

import numpy as np

from synth.interactions.body_measures import arm_length
from synth.interactions.carrying import hand_over, holding_place
from synth.interactions.paths import during, ease, wrapped
from synth.interactions.registry import interaction
from synth.interactions.script import Cast, Poses, Reach, Role, Script
from synth.motion.easing import minimum_jerk
from synth.motion.procedural.upper_body import random_drift
from synth.rooms.props import PlacedProp, prop_size

_NEAR = (0.28, 0.55)
"""Distance from the hips of a person at work to the shelf's surface, m."""
_AWAY = (0.9, 1.7)
"""The same distance of a person who has not arrived yet, m."""
_BACK = 0.85
"""The same distance of a person with a box, m."""
_ASIDE = 0.55
"""Greatest movement around the shelf, rad; in a crowd at most a third of the way to the next person."""
_PAUSE, _MOVE = (0.2, 2.0), 1.2
"""Time between two movements, and duration of one, s."""
_ROUND = 3.0
"""Time for which the hands stay at one point, and the gaze at one target, s."""
_FACING = np.radians(65)
"""Greatest angle of a trunk away from the shelf, rad."""
_PASSING = 0.5
"""Share of the clips in which a box is passed."""


@interaction(persons=(2, 6))
def shelving(cast: Cast, *, rng: np.random.Generator) -> Script:
    """People stand around a shelf, shift and turn, and put hands to it; all but two of them walk up to it.

    In half of the clips the last person has a box, which the first one takes. Distances, headings and their changes
    follow the people of the Shelf recording: their trunks face the shelf within 60 degrees for five sixths of the time,
    moving or not.
    """
    # Rounded up to centimetres: hands keep clear of the posts.
    half_length, half_depth = np.ceil(100 * prop_size("shelf").reach[:2]) / 100
    count, seconds = len(cast.bodies), cast.seconds
    last, first = max(seconds[-1], 1e-9), rng.uniform(0, 2 * np.pi)
    passing, rounds = rng.random() < _PASSING, max(1, round(last / _ROUND))
    giver, taken, quick = count - 1, rng.uniform(0.4, 0.6) * last, min(1.2, 0.25 * last)
    # The two people are side by side where they meet, as seen from the shelf.
    middle, meeting = first - np.pi / count, during(seconds, taken - 0.5, taken + 0.9, quick)
    paths, gazes, free, gaps = [], [], [], []
    for person in range(count):
        moves = _moves(last, rng=rng)
        aside = rng.uniform(-1, 1, len(moves) + 1) * min(_ASIDE, 2 / 3 * np.pi / count)
        gap = rng.uniform(*_NEAR, len(moves) + 1)
        angle = first + 2 * np.pi * person / count + _held(aside, moves, seconds)
        gap = _held(gap, moves, seconds) + random_drift(rng, seconds, 0.03, 0.4)
        away, begin, speed = rng.uniform(*_AWAY), rng.uniform(0.05, 0.7) * last, rng.uniform(0.5, 1.0)
        here = np.ones(len(seconds)) if person < 2 else ease((seconds - begin) * speed / away)
        away = away + random_drift(rng, seconds, 0.1, 0.3)
        moves = _moves(last, rng=rng)
        astray = _FACING * np.tanh(rng.normal(0, 0.9, len(moves) + 1))
        astray = _held(astray, moves, seconds) + random_drift(rng, seconds, np.radians(4), 0.3)
        looked_at = np.where(rng.random(rounds) < 0.3, (person + rng.integers(1, count, rounds)) % count, -1)
        gaze = looked_at[np.minimum((seconds / last * rounds).astype(int), rounds - 1)]
        free.append(np.clip(2 * here - 1, 0, 1))
        if passing and person in (0, giver):
            # The box needs space: the person who holds it stays farther from the shelf.
            gives = person == giver
            back = minimum_jerk((seconds - taken + 0.5 + quick) / quick)
            back = 1 - minimum_jerk((seconds - taken - 0.9) / quick) if gives else back
            gap, free[-1] = gap + back * np.maximum(_BACK - gap, 0), free[-1] * (1 - back)
            held = holding_place([cast.bodies[giver], cast.bodies[0]])[0][0 if gives else 1] * (-1 if gives else 1)
            angle = angle - 2 * np.pi * gives
            angle = angle + meeting * (middle + np.arctan2(held, half_length + _BACK) - angle)
            gaze = np.where(meeting > 0.5, giver - person, gaze)
        out = np.stack([np.cos(angle), np.sin(angle)], 1)
        surface = np.minimum(
            half_length / np.maximum(np.abs(out[:, 0]), 1e-9), half_depth / np.maximum(np.abs(out[:, 1]), 1e-9)
        )
        far = np.minimum(away, np.maximum(cast.radius - surface, gap))
        distance, heading = surface + gap + (1 - here) * (far - gap), angle + np.pi + astray
        if passing and person in (0, giver):
            distance += meeting * (np.hypot(half_length + _BACK, held) - distance)
            towards = middle + np.copysign(np.pi / 2, -held)
            heading += meeting * wrapped(towards - heading)
        paths.append(np.column_stack([distance[:, None] * out, heading]))
        gazes.append(gaze)
        gaps.append(gap)
    busy, heights = rng.random((count, 2, rounds)) < 0.55, rng.uniform(0.75, 1.45, (count, 2, rounds))
    box, hold = hand_over(cast, (giver, 0), (paths[giver], paths[0]), taken) if passing else (None, None)
    length = last / rounds

    def work(poses: Poses) -> list[Reach]:
        reaches = []
        for person, path in enumerate(paths):
            arm = arm_length(cast.bodies[person])
            ahead = np.stack([np.cos(path[:, 2]), np.sin(path[:, 2]), 0 * path[:, 2]], 1)
            left = np.stack([-ahead[:, 1], ahead[:, 0], 0 * path[:, 2]], 1)
            # No farther than the shelf's surface, whatever the heading.
            forward = np.minimum(0.75 * arm, gaps[person] - 0.1)[:, None]
            for hand, (side, sign) in enumerate((("l", 1.0), ("r", -1.0))):
                for turn in np.flatnonzero(busy[person, hand]):
                    share = during(seconds, turn * length + 0.5, (turn + 1) * length - 0.5, 0.5)
                    palm = poses.origins[:, person, 0] + forward * ahead + 0.22 * sign * arm * left
                    palm[:, 2] = heights[person, hand, turn]
                    reaches.append(Reach(person, side, share * free[person], palm, ahead))
        return reaches + (hold(poses) if hold else [])

    return Script(
        tuple(Role(path, gaze=gaze) for path, gaze in zip(paths, gazes, strict=True)),
        clearance=0.45,
        furniture=(PlacedProp("shelf", (0.0, 0.0), 0.0),),
        loads=(box,) if box else (),
        reaches=work,
    )


def _moves(last: float, *, rng: np.random.Generator) -> np.ndarray:
    """Return (K,) times before `last`, s, at which a person moves to another place or heading."""
    steps = rng.uniform(*_PAUSE, int(last / (_PAUSE[0] + _MOVE)) + 2) + _MOVE
    times = np.cumsum(steps) - rng.uniform() * steps[0]
    return times[times < last]


def _held(values: np.ndarray, moves: np.ndarray, seconds: np.ndarray) -> np.ndarray:
    """Return a curve (F,) through K + 1 values in turn, each held until the next of K moves, s."""
    return values[0] + (np.diff(values) * minimum_jerk((seconds[:, None] - moves) / _MOVE)).sum(1)
