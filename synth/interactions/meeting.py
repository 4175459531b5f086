"""People who meet without contact: crossing, walking together, queuing, talking in a circle."""

from dataclasses import replace

import numpy as np

from synth.interactions.body_measures import arm_length
from synth.interactions.paths import approach, during, standing
from synth.interactions.registry import interaction
from synth.interactions.script import Cast, Poses, Reach, Role, Script

_TIGHTEST = 1.0
"""Radius of the tightest walked turn, m."""
_SLOWEST = 0.75
"""Speed of a leisurely walk, m/s."""
_GAP = 0.62
"""Distance between people who walk abreast, m."""


@interaction(persons=(2, 6))
def crossing(cast: Cast, *, rng: np.random.Generator) -> Script:
    """People walk through the middle, from all sides, at about the same time."""
    count = len(cast.bodies)
    first, side = rng.uniform(0, 2 * np.pi), rng.choice((-1, 1))
    # People arrive one just after the other, so that no two are in the middle at the same time.
    order = (rng.permutation(count) - (count - 1) / 2) * min(0.4, 0.3 * cast.seconds[-1] / count)
    roles = []
    for person in range(count):
        heading = first + 2 * np.pi * (person + rng.uniform(-0.15, 0.15)) / count
        late, aside = order[person] + rng.uniform(-0.05, 0.05), rng.uniform(-0.12, 0.12)
        path = _through(cast, heading, rng.uniform(0.9, 1.3), side, late)
        path[:, :2] += aside * np.array((-np.sin(heading), np.cos(heading)))
        roles.append(Role(path, walks=True))
    return Script(tuple(roles))


@interaction(persons=(2, 6))
def walking_together(cast: Cast, *, rng: np.random.Generator) -> Script:
    """People walk the same way at the same pace, side by side; four or more walk in two rows."""
    count = len(cast.bodies)
    rows = 1 if count < 4 else 2
    within = replace(cast, radius=max(0.5, cast.radius - 0.5 * (rows - 1)))
    way = _through(within, rng.uniform(0, 2 * np.pi), rng.uniform(0.8, 1.2), rng.choice((-1, 1)))
    # Centre the path, so that its farthest point is near the middle.
    way[:, :2] -= (way[:, :2].min(0) + way[:, :2].max(0)) / 2
    ahead = np.stack([np.cos(way[:, 2]), np.sin(way[:, 2])], 1)
    left = np.stack([-ahead[:, 1], ahead[:, 0]], 1)
    abreast = -(-count // rows)
    roles = []
    for person in range(count):
        row, place = divmod(person, abreast)
        here = min(abreast, count - row * abreast)
        path = way.copy()
        path[:, :2] += (
            _GAP * (place - (here - 1) / 2) * left - (1.0 * (row - (rows - 1) / 2) + rng.uniform(-0.05, 0.05)) * ahead
        )
        mate = person + 1 if place < here - 1 else person - 1
        begin = rng.uniform(0, cast.seconds[-1])
        talking = (cast.seconds > begin) & (cast.seconds < begin + 1.5)
        gaze = np.where(talking & (mate // abreast == row), mate, -1)
        roles.append(Role(path, walks=True, gaze=gaze))
    return Script(tuple(roles), clearance=min(_GAP - 0.12, 0.5))


@interaction(persons=(3, 6))
def queue(cast: Cast, *, rng: np.random.Generator) -> Script:
    """People stand in a line; the first leaves, and the others move up one after the other."""
    count, seconds = len(cast.bodies), cast.seconds
    gap, yaw = rng.uniform(0.62, 0.75), rng.uniform(0, 2 * np.pi)
    leaving = rng.uniform(0.15, 0.3) * seconds[-1]
    turn = np.array([(np.cos(yaw), np.sin(yaw)), (-np.sin(yaw), np.cos(yaw))])
    places = [np.array(((count - 1) / 2 - k, rng.normal(0, 0.04) / gap)) * gap for k in range(count)]
    roles = []
    for person, place in enumerate(places):
        start = np.array((*(place @ turn), yaw + rng.normal(0, 0.08)))
        if person == 0:
            away = place + np.array((0.25, rng.choice((-1, 1)) * min(1.3, cast.radius - 0.4)))
            way = (away - place) @ turn
            end = np.array((*(away @ turn), np.arctan2(way[1], way[0])))
            path = approach(cast, start, end, begin=leaving, speed=0.75)
        else:
            end = np.array((*(places[person - 1] @ turn), yaw + rng.normal(0, 0.08)))
            path = approach(cast, start, end, begin=leaving + 0.6 + 0.35 * person, speed=0.55)
            path[:, 2] = start[2] + (path[:, 2] - start[2]) * 0.3
        roles.append(Role(path))
    return Script(tuple(roles), clearance=0.45)


@interaction(persons=(3, 6))
def circle_talk(cast: Cast, *, rng: np.random.Generator) -> Script:
    """People stand in a circle; one after the other gestures, and the others look there."""
    count, seconds = len(cast.bodies), cast.seconds
    radius = max(0.48, 0.42 / np.sin(np.pi / count)) + rng.uniform(0, 0.12)
    first = rng.uniform(0, 2 * np.pi)
    turns = max(1, round(seconds[-1] / 2.2))
    speakers = np.concatenate([rng.permutation(count) for _ in range(-(-turns // count))])[:turns]
    now = np.minimum((seconds / max(seconds[-1], 1e-9) * turns).astype(int), turns - 1)
    roles = []
    for person in range(count):
        angle = first + 2 * np.pi * (person + rng.uniform(-0.08, 0.08)) / count
        at = radius * np.array((np.cos(angle), np.sin(angle)))
        speaks = speakers[now] == person
        gaze = np.where(speaks, (person + 1 + int(rng.integers(count - 1))) % count, speakers[now])
        roles.append(Role(standing(cast, at, angle + np.pi + rng.normal(0, 0.08)), gaze=gaze))
    length, hands = seconds[-1] / turns, rng.choice(("l", "r"), turns)
    beats = rng.uniform(1.0, 1.6, turns)

    def speak(poses: Poses) -> list[Reach]:
        reaches = []
        for turn, person in enumerate(speakers):
            share = during(seconds, turn * length + 0.5, (turn + 1) * length - 0.5, 0.5)
            sign = 1 if hands[turn] == "l" else -1
            arm = arm_length(cast.bodies[person])
            beat = np.sin(2 * np.pi * beats[turn] * seconds)[:, None]
            hand = poses.point(person, "chest", (0.52 * arm, 0.30 * sign * arm, 0.05))
            hand += 0.05 * beat * poses.axis(person, "chest", (0.5, 0.3 * sign, 1))
            reaches.append(Reach(int(person), hands[turn], share, hand, poses.axis(person, "chest", (0, -sign, 0.7))))
        return reaches

    return Script(tuple(roles), clearance=0.45, reaches=speak)


def _through(cast: Cast, heading: float, speed: float, side: float, late: float = 0.0) -> np.ndarray:
    """Return a (F, 3) path that passes the origin at half time, or later by `late`, s.

    It is slower, and bent towards a `side`, as far as necessary to stay within the radius.
    """
    farthest = cast.seconds[-1] / 2 + abs(late)
    speed = max(min(speed, cast.radius / max(farthest, 1e-9)), _SLOWEST)
    along = speed * (cast.seconds - cast.seconds[-1] / 2 - late)
    if np.abs(along).max() <= cast.radius:
        xy = along[:, None] * np.array((np.cos(heading), np.sin(heading)))
        return np.column_stack([xy, np.full(len(along), heading)])
    bend = side * max(_TIGHTEST, cast.radius / 2)
    angle = along / bend
    ahead, left = bend * np.sin(angle), bend * (1 - np.cos(angle))
    x, y = np.cos(heading) * ahead - np.sin(heading) * left, np.sin(heading) * ahead + np.cos(heading) * left
    return np.column_stack([x, y, heading + angle])
