"""What people do with things: carry a box and pass it on, fill a shelf, work at a counter or a table."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from synth.interactions.registry import interaction
from synth.interactions.script import (
    STOOL,
    STOOL_BEHIND,
    Cast,
    Grip,
    Load,
    Poses,
    Reach,
    Role,
    Script,
    approach,
    arm_length,
    arrival,
    during,
    ease,
    seated,
    standing,
    within_reach,
    wrapped,
)
from synth.motion.geometry import forwards, leftwards, minimum_jerk
from synth.motion.procedural.trajectory import random_drift
from synth.people.body import SEGMENTS, Body
from synth.rooms.props import PlacedProp, prop_size

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
    ahead, left = forwards(yaw), leftwards(yaw)
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
    """Return a box that the first of two people holds and the second takes, and the reaches of their hands.

    Their paths (F, 3) face each other at the time `taken`, s, with the box between them; then the second person has it.
    """
    half_width = float(prop_size(_BOX).reach[1])
    seconds = cast.seconds
    held, height = holding_place([cast.bodies[person] for person in people])

    def front(k: int) -> np.ndarray:
        heading = paths[k][:, 2]
        return paths[k][:, :2] + held[k] * forwards(heading)

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
    x, y, z = (float(each) for each in middle[0])
    return Load(_BOX, (x, y, z), float(turned[0]), half_width + _CLOTH, grips), hold


# At a shelf

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


@dataclass
class _Worker:
    """A person around a shelf at the origin. Angles are in rad, distances in m, curves (F,)."""

    angle: np.ndarray  # Direction of the person from the shelf
    gap: np.ndarray  # Distance from the shelf's surface at work
    away: np.ndarray  # The same before the person has arrived
    here: np.ndarray  # From 0, away, to 1, at work
    astray: np.ndarray  # Heading, from straight at the shelf
    gaze: np.ndarray  # Index of the person looked at; -1 for none
    free: np.ndarray  # Share in which the hands work
    # Share in which a box is being passed, and the distance from the origin and the heading of the person meanwhile
    passing: tuple[np.ndarray, float, float] | None = None


@interaction(persons=(2, 6))
def shelving(cast: Cast, *, rng: np.random.Generator) -> Script:
    """People stand around a shelf, shift and turn, and put hands to it; all but two of them walk up to it.

    In half of the clips the last person has a box, which the first one takes. Distances, headings and their changes
    follow the people of the Shelf recording: their trunks face the shelf within 60 degrees for five sixths of the time,
    moving or not.
    """
    # Rounded up to centimetres: hands keep clear of the posts.
    half_size = np.ceil(100 * prop_size("shelf").reach[:2]) / 100
    count, seconds = len(cast.bodies), cast.seconds
    last, first = max(seconds[-1], 1e-9), rng.uniform(0, 2 * np.pi)
    passing, rounds = rng.random() < _PASSING, max(1, round(last / _ROUND))
    giver, taken = count - 1, rng.uniform(0.4, 0.6) * last
    workers = [_around_shelf(cast, person, first, rounds, rng=rng) for person in range(count)]
    if passing:
        _meet(cast, workers[giver], workers[0], first - np.pi / count, taken, half_size[0])
    paths = [_shelf_path(worker, half_size, cast.radius) for worker in workers]
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
            forward = np.minimum(0.75 * arm, workers[person].gap - 0.1)[:, None]
            for hand, (side, sign) in enumerate((("l", 1.0), ("r", -1.0))):
                for turn in np.flatnonzero(busy[person, hand]):
                    share = during(seconds, turn * length + 0.5, (turn + 1) * length - 0.5, 0.5)
                    palm = poses.origins[:, person, 0] + forward * ahead + 0.22 * sign * arm * left
                    palm[:, 2] = heights[person, hand, turn]
                    share = share * workers[person].free
                    reaches.append(Reach(person, side, share, palm, ahead, hand=("open", "grip")))
        return reaches + (hold(poses) if hold else [])

    return Script(
        tuple(Role(path, gaze=worker.gaze) for path, worker in zip(paths, workers, strict=True)),
        clearance=0.45,
        furniture=(PlacedProp("shelf", (0.0, 0.0), 0.0),),
        loads=(box,) if box else (),
        reaches=work,
    )


def _around_shelf(cast: Cast, person: int, first: float, rounds: int, *, rng: np.random.Generator) -> _Worker:
    """Return a person who works at the shelf by themselves. `first` is the direction of the first person, rad."""
    count, seconds = len(cast.bodies), cast.seconds
    last = max(seconds[-1], 1e-9)
    moves = _moves(last, rng=rng)
    aside = rng.uniform(-1, 1, len(moves) + 1) * min(_ASIDE, 2 / 3 * np.pi / count)
    gap = rng.uniform(*_NEAR, len(moves) + 1)
    angle = first + 2 * np.pi * person / count + _held(aside, moves, seconds)
    gap = _held(gap, moves, seconds) + random_drift(rng, seconds, 0.03, 0.4)
    off, begin, speed = rng.uniform(*_AWAY), rng.uniform(0.05, 0.7) * last, rng.uniform(0.5, 1.0)
    here = np.ones(len(seconds)) if person < 2 else ease((seconds - begin) * speed / off)
    away = off + random_drift(rng, seconds, 0.1, 0.3)
    moves = _moves(last, rng=rng)
    astray = _FACING * np.tanh(rng.normal(0, 0.9, len(moves) + 1))
    astray = _held(astray, moves, seconds) + random_drift(rng, seconds, np.radians(4), 0.3)
    looked_at = np.where(rng.random(rounds) < 0.3, (person + rng.integers(1, count, rounds)) % count, -1)
    gaze = looked_at[np.minimum((seconds / last * rounds).astype(int), rounds - 1)]
    return _Worker(angle, gap, away, here, astray, gaze, free=np.clip(2 * here - 1, 0, 1))


def _meet(cast: Cast, giver: _Worker, taker: _Worker, middle: float, taken: float, half_length: float) -> None:
    """Let the last person meet the first one in the direction `middle`, rad, to pass a box at the time `taken`, s.

    The two are side by side there, as seen from the shelf, which is 2 `half_length` long, m.
    """
    seconds, last = cast.seconds, len(cast.bodies) - 1
    quick = min(1.2, 0.25 * max(seconds[-1], 1e-9))
    meeting = during(seconds, taken - 0.5, taken + 0.9, quick)
    held, _ = holding_place([cast.bodies[last], cast.bodies[0]])
    received = minimum_jerk((seconds - taken + 0.5 + quick) / quick)
    given = minimum_jerk((seconds - taken - 0.9) / quick)
    for worker, partner, has_box, aside, turn in (
        (giver, 0, 1 - given, -held[0], 2 * np.pi),
        (taker, last, received, held[1], 0.0),
    ):
        # The box needs space: the person who holds it stays farther from the shelf.
        worker.gap = worker.gap + has_box * np.maximum(_BACK - worker.gap, 0)
        worker.free = worker.free * (1 - has_box)
        angle = worker.angle - turn
        worker.angle = angle + meeting * (middle + np.arctan2(aside, half_length + _BACK) - angle)
        worker.gaze = np.where(meeting > 0.5, partner, worker.gaze)
        distance, heading = np.hypot(half_length + _BACK, aside), middle + np.copysign(np.pi / 2, -aside)
        worker.passing = meeting, distance, heading


def _shelf_path(worker: _Worker, half_size: np.ndarray, radius: float) -> np.ndarray:
    """Return the (F, 3) path of a person around a shelf of half length and depth (2,), m, within a radius, m."""
    out = forwards(worker.angle)
    surface = (half_size / np.maximum(np.abs(out), 1e-9)).min(1)
    far = np.minimum(worker.away, np.maximum(radius - surface, worker.gap))
    distance = surface + worker.gap + (1 - worker.here) * (far - worker.gap)
    heading = worker.angle + np.pi + worker.astray
    if worker.passing:
        meeting, meeting_distance, meeting_heading = worker.passing
        distance += meeting * (meeting_distance - distance)
        heading += meeting * wrapped(meeting_heading - heading)
    return np.column_stack([distance[:, None] * out, heading])


def _moves(last: float, *, rng: np.random.Generator) -> np.ndarray:
    """Return (K,) times before `last`, s, at which a person moves to another place or heading."""
    steps = rng.uniform(*_PAUSE, int(last / (_PAUSE[0] + _MOVE)) + 2) + _MOVE
    times = np.cumsum(steps) - rng.uniform() * steps[0]
    return times[times < last]


def _held(values: np.ndarray, moves: np.ndarray, seconds: np.ndarray) -> np.ndarray:
    """Return a curve (F,) through K + 1 values in turn, each held until the next of K moves, s."""
    return values[0] + (np.diff(values) * minimum_jerk((seconds[:, None] - moves) / _MOVE)).sum(1)


# At a counter, at a table

_HAND = 0.012
"""Height of a resting palm above a board, m."""
_SHOULDER, _OUT = 0.15, (-0.1, 1.0, 0.35)
"""Height of shoulders above a table, m, below which elbows point outward, and that direction, clear of the edge."""


@interaction(persons=(3, 6))
def counter(cast: Cast, *, rng: np.random.Generator) -> Script:
    """People stand on both sides of a counter, hands on the board; one person behind it walks to and fro."""
    half_depth, half_length, top = prop_size("counter").reach.tolist()
    count, seconds = len(cast.bodies), cast.seconds
    yaw = rng.uniform(0, 2 * np.pi)
    turn = np.array([(np.cos(yaw), np.sin(yaw)), (-np.sin(yaw), np.cos(yaw))])
    behind = -(-count // 2)
    reach = half_depth + 0.24
    roles = []
    for person in range(count):
        staff = person < behind
        number, side_count = (person, behind) if staff else (person - behind, count - behind)
        across = (number - (side_count - 1) / 2) * min(0.8, 2 * half_length / side_count) + rng.uniform(-0.06, 0.06)
        side = -1 if staff else 1
        facing = yaw if staff else yaw + np.pi
        at = np.array((side * (reach + rng.uniform(0, 0.05)), across))
        start = np.array((*(at @ turn), facing + rng.normal(0, 0.1)))
        if staff and number == 0:
            # The person moves only sideways, because the counter is an obstacle.
            end = np.array((*((at - (0.04, 0.35)) @ turn), facing))
            path = approach(cast, start, end, begin=0.3 * seconds[-1], speed=0.4)
            path[:, 2] = facing
        else:
            path = standing(cast, start[:2], start[2])
        opposite = behind + min(number, count - behind - 1) if staff else min(number, behind - 1)
        roles.append(Role(path, gaze=np.full(len(seconds), opposite)))
    resting = [
        (person, str(side)) for person in range(count) for side in rng.permutation(("l", "r"))[: rng.integers(1, 3)]
    ]
    normal = np.tile((0.0, 0.0, -1.0), (len(seconds), 1))

    def rest(poses: Poses) -> list[Reach]:
        reaches = []
        for person, side in resting:
            sign, arm = (1 if side == "l" else -1), arm_length(cast.bodies[person])
            if poses.origins[:, person, SEGMENTS.index(f"{side}_upper_arm"), 2].min() < top:
                continue
            hips, heading = poses.origins[:, person, 0], roles[person].path[:, 2]
            ahead, left = forwards(heading), leftwards(heading)
            palm = np.empty((len(seconds), 3))
            palm[:, :2] = hips[:, :2] + 0.62 * arm * ahead + 0.24 * sign * arm * left
            palm[:, 2] = top + _HAND
            reaches.append(Reach(person, side, np.ones(len(seconds)), palm, normal))
        return reaches

    return Script(tuple(roles), clearance=0.45, furniture=(PlacedProp("counter", (0.0, 0.0), yaw),), reaches=rest)


@interaction(persons=(2, 6))
def table(cast: Cast, *, rng: np.random.Generator) -> Script:
    """People sit on stools around a table, hands on it; one after the other gestures, and the others look there."""
    radius, _, top = prop_size("round_table").reach.tolist()
    count, seconds = len(cast.bodies), cast.seconds
    first, turns = rng.uniform(0, 2 * np.pi), max(1, round(seconds[-1] / 2.0))
    speakers = rng.integers(count, size=turns)
    now = np.minimum((seconds / max(seconds[-1], 1e-9) * turns).astype(int), turns - 1)
    roles, stools = [], []
    for person, body in enumerate(cast.bodies):
        angle = first + 2 * np.pi * (person + rng.uniform(-0.04, 0.04)) / count
        out = forwards(angle)
        at = (radius + 0.16 * body.stature * max(1.0, body.girth)) * out
        stools.append(PlacedProp(STOOL, tuple((at + STOOL_BEHIND * out).tolist()), angle))
        gaze = np.where(speakers[now] == person, (person + 1) % count, speakers[now])
        hips = np.full(len(seconds), seated(body))
        roles.append(
            Role(standing(cast, at, angle + np.pi), hips=hips, ahead=0.22 * body.stature * body.leg, gaze=gaze)
        )
    length, hands = seconds[-1] / turns, rng.choice(("l", "r"), turns)
    normal = np.tile((0.0, 0.0, -1.0), (len(seconds), 1))

    def rest(poses: Poses) -> list[Reach]:
        reaches = []
        for person in range(count):
            heading = roles[person].path[0, 2]
            ahead, left = forwards(heading), leftwards(heading)
            edge = -radius * ahead
            for side, sign in (("l", 1.0), ("r", -1.0)):
                palm = np.tile((*(edge + 0.13 * ahead + 0.16 * sign * left), top + _HAND), (len(seconds), 1))
                for turn in np.flatnonzero((speakers == person) & (hands == side)):
                    share = during(seconds, turn * length + 0.5, (turn + 1) * length - 0.5, 0.5)[:, None]
                    beat = np.sin(2 * np.pi * 1.3 * seconds)[:, None]
                    lifted = np.array((*(0.06 * ahead + 0.05 * sign * left), 0.22)) + 0.04 * beat * (0, 0, 1)
                    palm = palm + share * lifted
                shoulder = poses.origins[:, person, SEGMENTS.index(f"{side}_upper_arm"), 2].min()
                elbow: dict = {"elbow": _OUT} if shoulder < top + _SHOULDER else {}
                reaches.append(Reach(person, side, np.ones(len(seconds)), palm, normal, **elbow))
        return reaches

    furniture = (PlacedProp("round_table", (0.0, 0.0), first), *stools)
    return Script(tuple(roles), clearance=0.45, furniture=furniture, reaches=rest)
