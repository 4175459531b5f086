"""What people do with each other: meet, hold hands, embrace, and spar."""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.ndimage import gaussian_filter1d

from synth.interactions.registry import interaction
from synth.interactions.script import (
    Cast,
    Poses,
    Reach,
    Role,
    Script,
    approach,
    arm_length,
    during,
    face_to_face,
    meeting,
    nearest_reached,
    on_trunk,
    standing,
    step_back,
    thickness,
)
from synth.motion.geometry import forwards, leftwards, minimum_jerk
from synth.people.body import SEGMENTS

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
        path[:, :2] += aside * leftwards(heading)
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
    ahead, left = forwards(way[:, 2]), leftwards(way[:, 2])
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
        at = radius * forwards(angle)
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
            normal = poses.axis(person, "chest", (0, -sign, 0.7))
            reaches.append(Reach(int(person), hands[turn], share, hand, normal, hand=("open", "relaxed", "point")))
        return reaches

    return Script(tuple(roles), clearance=0.45, reaches=speak)


def _through(cast: Cast, heading: float, speed: float, side: float, late: float = 0.0) -> np.ndarray:
    """Return a (F, 3) path past the origin at half time, or `late` s after it, slower and bent to a `side` to stay in
    the radius."""
    farthest = cast.seconds[-1] / 2 + abs(late)
    speed = max(min(speed, cast.radius / max(farthest, 1e-9)), _SLOWEST)
    along = speed * (cast.seconds - cast.seconds[-1] / 2 - late)
    if np.abs(along).max() <= cast.radius:
        xy = along[:, None] * forwards(heading)
        return np.column_stack([xy, np.full(len(along), heading)])
    bend = side * max(_TIGHTEST, cast.radius / 2)
    angle = along / bend
    ahead, left = bend * np.sin(angle), bend * (1 - np.cos(angle))
    x, y = np.cos(heading) * ahead - np.sin(heading) * left, np.sin(heading) * ahead + np.cos(heading) * left
    return np.column_stack([x, y, heading + angle])


# Hand in hand: handshake, dance


@interaction(persons=(2, 2))
def handshake(cast: Cast, *, rng: np.random.Generator) -> Script:
    """Two people walk up to each other and shake their right hands; some lay the left hand on the other's arm."""
    come, when, parting = meeting(cast, 0.8, rng=rng)
    apart = float(rng.uniform(1.1, 1.25) * np.mean([arm_length(body) for body in cast.bodies]))
    roles, ahead = face_to_face(cast, apart, 0.0, come=come, when=when, rng=rng)
    height = rng.uniform(0.61, 0.66) * np.mean([body.stature for body in cast.bodies])
    rate, move = rng.uniform(1.6, 2.6), min(0.6, 0.3 * max(cast.seconds[-1], 1e-9))
    begin = when + 0.5 * move
    parting = min(parting, begin + rng.uniform(1.0, 3.5))
    share = during(cast.seconds, begin, parting, move)
    shaking = during(cast.seconds, begin + 0.3, min(begin + rng.uniform(0.8, 2.0), parting - 0.2), 0.3)
    hands = np.zeros((len(share), 3))
    hands[:, 2] = height + rng.uniform(0.015, 0.04) * shaking * np.sin(2 * np.pi * rate * cast.seconds)
    right = np.array((ahead[1], -ahead[0], 0))
    warm = [bool(rng.random() < 0.35) for _ in range(2)]
    late = during(cast.seconds, begin + 0.25, parting - 0.15, move)

    def shake(poses: Poses) -> list[Reach]:
        # The palm of a right hand that points ahead faces left.
        middle = hands + (poses.origins[:, 0, 0] + poses.origins[:, 1, 0]) / 2 * (1, 1, 0)
        normals = (-right, right)
        reaches = [
            Reach(person, "r", share, middle, np.tile(normal, (len(share), 1)), hand=("clasp",))
            for person, normal in enumerate(normals)
        ]
        for person in np.flatnonzero(warm):
            # The left hand goes to the outside of the arm that the other person holds out.
            size, body = cast.bodies[1 - person].stature, cast.bodies[1 - person]
            arm = 0.5 * (middle + poses.origins[:, 1 - person, SEGMENTS.index("r_upper_arm")])
            side = normals[1 - person] * -1.0
            palm = arm + 0.024 * size * body.girth * side - (0, 0, 0.02 * size)
            inward = np.tile(-side, (len(share), 1))
            reaches.append(Reach(int(person), "l", late, palm, inward, (0.2, 0.6, -1.0), hand=("relaxed",)))
        return reaches

    roles = tuple(replace(role, hands=("relaxed", "grip")) for role in roles)
    return Script(roles, clearance=min(0.6, apart - 0.1), reaches=shake)


@interaction(persons=(2, 2))
def dance(cast: Cast, *, rng: np.random.Generator) -> Script:
    """A couple dances: unchanged recordings of couples if there are any, else steps and turns in closed hold."""
    seconds, beat = cast.seconds, rng.uniform(0.42, 0.52)
    apart = max(0.46, sum(thickness(body) for body in cast.bodies) + rng.uniform(0.12, 0.2))
    turning = rng.choice((-1, 1)) * rng.uniform(0.5, 0.9)
    yaw = rng.uniform(0, 2 * np.pi) + turning * seconds + 0.15 * np.sin(np.pi * seconds / (2 * beat))
    ahead, left = forwards(yaw), leftwards(yaw)
    # Forward and back in four beats, to either side in eight.
    to_and_fro = 0.12 * np.sin(np.pi * seconds / (2 * beat))[:, None] * ahead
    middle = to_and_fro + 0.15 * np.sin(np.pi * seconds / (4 * beat))[:, None] * left
    roles = []
    for sign in (-1, 1):
        # Half a foot to the side, so that feet do not meet.
        path = np.column_stack(
            [middle + sign * apart / 2 * ahead + sign * 0.07 * left, yaw + (np.pi if sign > 0 else 0)]
        )
        # The first person's left hand holds the other's right; their other hands lie on back and shoulder.
        roles.append(Role(path, hands=("grip", "open") if sign < 0 else ("open", "grip")))
    always = np.ones(len(seconds))

    def hold(poses: Poses) -> list[Reach]:
        sizes = [body.stature for body in cast.bodies]
        hands = poses.origins[:, :, 0].mean(1) + 0.27 * min(sizes) * np.column_stack([left, 0 * yaw])
        hands[:, 2] = 0.76 * np.mean(sizes)
        shoulders = [poses.origins[:, p, SEGMENTS.index(f"{side}_upper_arm")] for p, side in enumerate("lr")]
        hands = nearest_reached(hands, cast.bodies, shoulders)
        first, second = sizes
        back = poses.point(1, "chest", (-0.07 * second * max(1.0, cast.bodies[1].girth), 0.05 * second, 0.03 * second))
        shoulder = poses.point(0, "chest", (0.01 * first, -0.10 * first, 0.185 * first))
        forward = np.column_stack([ahead, 0 * yaw])
        return [
            Reach(0, "l", always, hands, forward, (0.0, 0.6, -1.0), straight=True, hand=("clasp",)),
            Reach(1, "r", always, hands, -forward, (0.0, 0.6, -1.0), straight=True, hand=("clasp",)),
            Reach(0, "r", always, back, poses.axis(1, "chest", (1, 0, 0)), (0.0, 1.0, -0.4)),
            Reach(1, "l", always, shoulder, np.tile((0.0, 0.0, -1.0), (len(yaw), 1)), (0.0, 1.0, -0.2)),
        ]

    return Script(tuple(roles), clearance=0.3, paired=True, reaches=hold)


# In each other's arms: hug, huddle


class _Way(NamedTuple):
    """The path of an arm in a hug."""

    # Position of the palm before the arms close, in the frame of the other's chest as fractions of stature, y towards
    # the side of the arm
    via: tuple[float, float, float]
    elbow: tuple[float, float, float]  # Direction of the elbow
    heights: tuple[float, float]  # Least and greatest height of the palm on the back, as `on_trunk` takes it
    angles: tuple[float, float]  # Least and greatest angle of the palm from the spine, rad


# Nearer to the spine, a hand over the shoulder would be on the neck.
_OVER = _Way((0.03, 0.16, 0.20), (0.0, 1.0, -0.1), (0.215, 0.245), (0.65, 1.0))
"""Over the other's shoulder."""
_ROUND = _Way((0.04, 0.19, 0.16), (0.0, 1.0, -0.1), (0.195, 0.230), (0.3, 0.7))
"""Round the arms of a smaller person."""
_BELOW = _Way((0.04, 0.20, -0.01), (-0.2, 1.0, -0.8), (0.13, 0.18), (0.1, 0.6))
"""Below the other's arm."""
_HIGH = 0.18
"""Greatest height of a palm above the person's own shoulder, m; if exceeded, palms stay at or below the shoulder."""
_SIDES = {"r": 1, "l": -1}
"""Side of the other person on which an arm is: a person's right arm is on the other's left, +1."""


@dataclass(frozen=True)
class _Arm:
    """An arm in a hug."""

    # person, side: The person and the arm
    person: int
    side: str
    way: _Way  # The path of the arm
    # height, angle: Of the palm on the other's back, as `on_trunk` takes them
    height: float
    angle: float
    press: float  # How far the palm presses into the back, m
    begin: float  # Time at which the arm comes up, s
    pats: float  # Rate at which the hand pats the back, 1/s; 0 if it rests


@interaction(persons=(2, 2))
def hug(cast: Cast, *, rng: np.random.Generator) -> Script:
    """Two people walk up to each other and put their arms around each other, until the end or for a moment."""
    seconds, last = cast.seconds, cast.seconds[-1]
    come, when, _ = meeting(cast, 0.7, rng=rng)
    apart = sum(thickness(body) for body in cast.bodies) + rng.uniform(0.02, 0.05)
    mirror = int(rng.choice((-1, 1)))
    roles, _ = face_to_face(cast, apart, mirror * rng.uniform(0.09, 0.13), come=come, when=when, rng=rng)
    closing = max(0.6, 0.3 * when)
    parting = when + closing + rng.uniform(0.5, 5.0)
    if parting > last - 1.2:
        parting = last + 9.0
    arms = [_arm(cast, person, side, mirror, when, rng=rng) for person in range(2) for side in _SIDES]
    back = rng.uniform(0.25, 0.55, 2)

    def hold(poses: Poses) -> list[Reach]:
        reaches = []
        for arm in arms:
            person, other, sign = arm.person, 1 - arm.person, _SIDES[arm.side]
            body = cast.bodies[other]
            size = body.stature * np.array((max(1.0, body.girth), sign, 1))
            # Arms are open at first, and close once the other person is between them.
            closed = (minimum_jerk((seconds - 0.95 * when) / closing) - minimum_jerk((seconds - parting) / 0.5))[
                :, None
            ]
            segment, point, out = on_trunk(body, arm.height, sign * (np.pi - arm.angle), arm.press)
            beside, there = (
                poses.point(other, part, tuple(at)) for part, at in (("chest", arm.way.via * size), (segment, point))
            )
            inward = poses.axis(other, segment, tuple(-out))
            if arm.pats:
                patting = during(seconds, when + closing + 0.3, parting - 0.3, 0.2)
                lifted = 0.05 * patting * np.maximum(0, np.sin(2 * np.pi * arm.pats * (seconds - when)))
                there = there - lifted[:, None] * inward
            normal = poses.axis(other, "chest", (0.4, -sign, 0)) * (1 - closed) + closed * inward
            palm = beside + closed * (there - beside)
            shoulder = poses.origins[:, person, SEGMENTS.index(f"{arm.side}_upper_arm"), 2]
            if (palm[:, 2] - shoulder).max() > _HIGH:
                palm[:, 2] = np.minimum(palm[:, 2], shoulder)
            share = minimum_jerk((seconds - arm.begin) / (0.45 * when)) - minimum_jerk((seconds - parting) / 0.8)
            reaches.append(Reach(person, arm.side, share, palm, normal, arm.way.elbow))
        return reaches

    parted = [step_back(role.path, cast, parting + 0.3, far) for role, far in zip(roles, back, strict=True)]
    gaze = np.where(seconds > parting, 1, 0)
    looking = [np.where(gaze, 1 - person, -1) for person in range(2)]
    return Script(
        tuple(
            replace(role, path=path, gaze=at, hands=("open", "open"))
            for role, path, at in zip(roles, parted, looking, strict=True)
        ),
        clearance=0.9 * apart,
        reaches=hold,
    )


def _arm(cast: Cast, person: int, side: str, mirror: int, when: float, *, rng: np.random.Generator) -> _Arm:
    taller = cast.bodies[person].stature - cast.bodies[1 - person].stature
    # The taller person reaches round the other's arms, the smaller person below them. Two people of about the same
    # stature each have one arm over and one below.
    way = (_OVER if _SIDES[side] == mirror else _BELOW) if abs(taller) < 0.07 else _ROUND if taller > 0 else _BELOW
    return _Arm(
        person,
        side,
        way,
        height=rng.uniform(*way.heights),
        angle=rng.uniform(*way.angles),
        press=rng.uniform(0.0, 0.012),
        begin=rng.uniform(0.3, 0.5) * when,
        pats=rng.uniform(1.8, 3.0) if rng.random() < 0.25 else 0.0,
    )


@interaction(persons=(6, 6))
def huddle(cast: Cast, *, rng: np.random.Generator) -> Script:
    """Six people step into a ring, bend, and lay their arms on their neighbours' backs."""
    count, seconds = len(cast.bodies), cast.seconds
    widest = max(0.29 * body.stature * max(1.0, body.girth) for body in cast.bodies)
    radius, first = widest / (2 * np.sin(np.pi / count)) + 0.05, rng.uniform(0, 2 * np.pi)
    when = min(rng.uniform(1.2, 2.2), 0.36 * seconds[-1])
    lasting = seconds[-1] if seconds[-1] < when + 2.5 or rng.random() < 0.5 else rng.uniform(when + 2, seconds[-1])
    bent = minimum_jerk((seconds - 0.5 * when) / max(when, 0.4)) - minimum_jerk((seconds - lasting) / 0.9)
    roles = []
    for person in range(count):
        angle = first + 2 * np.pi * person / count
        out = forwards(angle)
        far, facing = radius + 0.5 * min(1.0, when), angle + np.pi
        start, end = np.array((*(far * out), facing)), np.array((*(radius * out), facing))
        path = approach(cast, start, end, begin=0.0, speed=(far - radius) / max(when, 0.6))
        roles.append(Role(path, lean=bent * rng.uniform(0.30, 0.42), hands=("open", "open")))
    share = minimum_jerk((seconds - 0.7 * when) / max(0.6 * when, 0.3)) - minimum_jerk((seconds - lasting) / 0.7)
    heights = rng.uniform((0.255, 0.215), (0.285, 0.235), (count, 2))
    angles, press = rng.uniform(0.15, 0.8, (count, 2)), rng.uniform(0.002, 0.012, (count, 2))

    def embrace(poses: Poses) -> list[Reach]:
        reaches = []
        for person in range(count):
            # The next person of the ring is on the right. Of two arms on a back, the left arm is lower.
            for hand, (side, other, sign) in enumerate((("r", person + 1, 1), ("l", person - 1, -1))):
                other %= count
                at = heights[person, hand], sign * (np.pi - angles[person, hand]), press[person, hand]
                segment, point, out = on_trunk(cast.bodies[other], *at)
                palm, normal = poses.point(other, segment, tuple(point)), poses.axis(other, segment, tuple(-out))
                reaches.append(Reach(person, side, share, palm, normal))
        return reaches

    return Script(tuple(roles), clearance=0.4, reaches=embrace)


# Sparring

_SIGN = {"l": 1.0, "r": -1.0}
_APART, _NEAR = (1.6, 1.8), (1.06, 1.14)
"""Distances between the hips in circling, and when a blow of the left hand lands, as shares of an arm's length."""
_BEHIND, _TO_FACE = 0.14, 0.10
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
        near = (close - max(_BEHIND * (blow.side == "r"), _TO_FACE * (blow.aim == "face"))) * arms[blow.person]
        near = max(near, _LEAST)
        at_blow = np.minimum(1.1 * np.exp(-(((seconds - blow.at) / 0.3) ** 2)), 1)
        apart = np.minimum(apart, far - (far - near) * at_blow)
    apart = gaussian_filter1d(apart, 0.1 * cast.fps, mode="nearest")
    roles = []
    for person, sign in enumerate((-1, 1)):
        xy = sign * apart[:, None] / 2 * forwards(yaw)
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
    return Reach(person, side, np.ones(len(cast.seconds)), palm, normal, straight=True, hand=("fist",))


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
