"""People at furniture: at a counter, at a table."""

import numpy as np

from synth.interactions.body_measures import arm_length, seated
from synth.interactions.paths import approach, during, standing
from synth.interactions.registry import interaction
from synth.interactions.script import STOOL, Cast, Poses, Reach, Role, Script
from synth.people.segments import SEGMENTS
from synth.rooms.props import PlacedProp, prop_size

_HAND = 0.012
"""Height of a resting palm above a board, m."""
_LOW, _OUT = 0.15, (-0.1, 1.0, 0.35)
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
            ahead = np.stack([np.cos(heading), np.sin(heading)], 1)
            left = np.stack([-ahead[:, 1], ahead[:, 0]], 1)
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
        out = np.array((np.cos(angle), np.sin(angle)))
        at = (radius + 0.16 * body.stature * max(1.0, body.girth)) * out
        stools.append(PlacedProp(STOOL, (float(at[0]), float(at[1])), angle))
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
            edge = -radius * ahead
            for side, sign in (("l", 1.0), ("r", -1.0)):
                palm = np.tile((*(edge + 0.13 * ahead + 0.16 * sign * left), top + _HAND), (len(seconds), 1))
                for turn in np.flatnonzero((speakers == person) & (hands == side)):
                    share = during(seconds, turn * length + 0.5, (turn + 1) * length - 0.5, 0.5)[:, None]
                    beat = np.sin(2 * np.pi * 1.3 * seconds)[:, None]
                    lifted = np.array((*(0.06 * ahead + 0.05 * sign * left), 0.22)) + 0.04 * beat * (0, 0, 1)
                    palm = palm + share * lifted
                shoulder = poses.origins[:, person, SEGMENTS.index(f"{side}_upper_arm"), 2].min()
                elbow = {"elbow": _OUT} if shoulder < top + _LOW else {}
                reaches.append(Reach(person, side, np.ones(len(seconds)), palm, normal, **elbow))
        return reaches

    furniture = (PlacedProp("round_table", (0.0, 0.0), first), *stools)
    return Script(tuple(roles), clearance=0.45, furniture=furniture, reaches=rest)
