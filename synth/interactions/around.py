"""People about furniture: behind a counter, round a table."""

import numpy as np

from synth.interactions.script import (
    Cast,
    Furniture,
    Poses,
    Reach,
    Role,
    Script,
    approach,
    arm_length,
    during,
    seated,
    standing,
)
from synth.motion import SEGMENTS

_COUNTER_TOP, _COUNTER_HALF_DEPTH, _COUNTER_HALF_LENGTH = 1.04, 0.25, 1.2
_TABLE_TOP, _TABLE_RADIUS = 0.755, 0.60
"""Of `scenes/props/counter.xml` and `round_table.xml`, m."""
_HAND = 0.012
"""How far above a board the palm of a hand at rest is, m."""

_LOW, _OUT = 0.15, (-0.1, 1.0, 0.35)
"""How far above a table shoulders are low, m, and where elbows then give way to, so that they do not meet its edge."""


def counter(cast: Cast, *, rng: np.random.Generator) -> Script:
    """Some stand behind a counter, others before it, hands on the board; one behind it goes to and fro."""
    count, seconds = len(cast.bodies), cast.seconds
    yaw = rng.uniform(0, 2 * np.pi)
    turn = np.array([(np.cos(yaw), np.sin(yaw)), (-np.sin(yaw), np.cos(yaw))])
    behind = -(-count // 2)
    reach = _COUNTER_HALF_DEPTH + 0.24
    roles = []
    for person in range(count):
        staff = person < behind
        number, all_here = (person, behind) if staff else (person - behind, count - behind)
        across = (number - (all_here - 1) / 2) * min(0.8, 2 * _COUNTER_HALF_LENGTH / all_here) + rng.uniform(
            -0.06, 0.06
        )
        side = -1 if staff else 1
        facing = yaw if staff else yaw + np.pi
        at = np.array((side * (reach + rng.uniform(0, 0.05)), across))
        start = np.array((*(at @ turn), facing + rng.normal(0, 0.1)))
        if staff and number == 0:
            # Only sideways: the counter is in the way.
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
            if poses.origins[:, person, SEGMENTS.index(f"{side}_upper_arm"), 2].min() < _COUNTER_TOP:
                continue
            hips, heading = poses.origins[:, person, 0], roles[person].path[:, 2]
            ahead = np.stack([np.cos(heading), np.sin(heading)], 1)
            left = np.stack([-ahead[:, 1], ahead[:, 0]], 1)
            palm = np.empty((len(seconds), 3))
            palm[:, :2] = hips[:, :2] + 0.62 * arm * ahead + 0.24 * sign * arm * left
            palm[:, 2] = _COUNTER_TOP + _HAND
            reaches.append(Reach(person, side, np.ones(len(seconds)), palm, normal))
        return reaches

    return Script(tuple(roles), clearance=0.45, furniture=(Furniture("counter", (0.0, 0.0), yaw),), reaches=rest)


def table(cast: Cast, *, rng: np.random.Generator) -> Script:
    """People sit on stools round a table, hands on it; by turns somebody speaks with a hand and is looked at."""
    count, seconds = len(cast.bodies), cast.seconds
    first, turns = rng.uniform(0, 2 * np.pi), max(1, round(seconds[-1] / 2.0))
    speakers = rng.integers(count, size=turns)
    now = np.minimum((seconds / max(seconds[-1], 1e-9) * turns).astype(int), turns - 1)
    roles, stools = [], []
    for person, body in enumerate(cast.bodies):
        angle = first + 2 * np.pi * (person + rng.uniform(-0.04, 0.04)) / count
        out = np.array((np.cos(angle), np.sin(angle)))
        at = (_TABLE_RADIUS + 0.16 * body.stature * max(1.0, body.girth)) * out
        stools.append(Furniture("stool", (float(at[0]), float(at[1])), angle))
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
            ahead, left = np.array((np.cos(heading), np.sin(heading))), np.array((-np.sin(heading), np.cos(heading)))
            edge = -_TABLE_RADIUS * ahead
            for side, sign in (("l", 1.0), ("r", -1.0)):
                palm = np.tile((*(edge + 0.13 * ahead + 0.16 * sign * left), _TABLE_TOP + _HAND), (len(seconds), 1))
                for turn in np.flatnonzero((speakers == person) & (hands == side)):
                    share = during(seconds, turn * length + 0.5, (turn + 1) * length - 0.5, 0.5)[:, None]
                    beat = np.sin(2 * np.pi * 1.3 * seconds)[:, None]
                    lifted = np.array((*(0.06 * ahead + 0.05 * sign * left), 0.22)) + 0.04 * beat * (0, 0, 1)
                    palm = palm + share * lifted
                shoulder = poses.origins[:, person, SEGMENTS.index(f"{side}_upper_arm"), 2].min()
                elbow = {"elbow": _OUT} if shoulder < _TABLE_TOP + _LOW else {}
                reaches.append(Reach(person, side, np.ones(len(seconds)), palm, normal, **elbow))
        return reaches

    furniture = (Furniture("round_table", (0.0, 0.0), first), *stools)
    return Script(tuple(roles), clearance=0.45, furniture=furniture, reaches=rest)
