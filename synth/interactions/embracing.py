"""People in each other's arms: hug, huddle."""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from synth.interactions.body_measures import on_trunk, thickness
from synth.interactions.paths import approach, during, face_to_face, meeting, step_back
from synth.interactions.registry import interaction
from synth.interactions.script import Cast, Poses, Reach, Role, Script
from synth.motion.easing import minimum_jerk
from synth.people.segments import SEGMENTS


class _Way(NamedTuple):
    """The path of an arm in a hug.

    Attributes:
        via: Position of the palm before the arms close, in the frame of the other's chest as fractions of stature, y
            towards the side of the arm.
        elbow: Direction of the elbow.
        heights: Least and greatest height of the palm on the back, as `on_trunk` takes it.
        angles: Least and greatest angle of the palm from the spine, rad.
    """

    via: tuple[float, float, float]
    elbow: tuple[float, float, float]
    heights: tuple[float, float]
    angles: tuple[float, float]


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
    """An arm in a hug.

    Attributes:
        person, side: The person and the arm.
        way: The path of the arm.
        height, angle: Of the palm on the other's back, as `on_trunk` takes them.
        press: How far the palm presses into the back, m.
        begin: Time at which the arm comes up, s.
        pats: Rate at which the hand pats the back, 1/s; 0 if it rests.
    """

    person: int
    side: str
    way: _Way
    height: float
    angle: float
    press: float
    begin: float
    pats: float


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
        out = np.array((np.cos(angle), np.sin(angle)))
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
