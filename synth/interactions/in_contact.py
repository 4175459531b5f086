"""People hand in hand: handshake, dance."""

from dataclasses import replace

import numpy as np

from synth.interactions.body_measures import arm_length, nearest_reached, thickness
from synth.interactions.paths import during, face_to_face, meeting
from synth.interactions.registry import interaction
from synth.interactions.script import Cast, Poses, Reach, Role, Script
from synth.people.segments import SEGMENTS


@interaction(persons=(2, 2))
def handshake(cast: Cast, *, rng: np.random.Generator) -> Script:
    """Two people walk up to each other and shake their right hands; some lay the left hand on the other's arm."""
    come, when, parting = meeting(cast, 0.8, rng=rng)
    apart = rng.uniform(1.1, 1.25) * np.mean([arm_length(body) for body in cast.bodies])
    roles, ahead = face_to_face(cast, apart, 0.0, come=come, when=when, rng=rng)
    height = rng.uniform(0.61, 0.66) * np.mean([body.stature for body in cast.bodies])
    rate, move = rng.uniform(1.6, 2.6), min(0.6, 0.3 * cast.seconds[-1])
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
            Reach(person, "r", share, middle, np.tile(normal, (len(share), 1))) for person, normal in enumerate(normals)
        ]
        for person in np.flatnonzero(warm):
            # The left hand goes to the outside of the arm that the other person holds out.
            size, body = cast.bodies[1 - person].stature, cast.bodies[1 - person]
            arm = 0.5 * (middle + poses.origins[:, 1 - person, SEGMENTS.index("r_upper_arm")])
            side = normals[1 - person] * -1.0
            palm = arm + 0.024 * size * body.girth * side - (0, 0, 0.02 * size)
            reaches.append(Reach(int(person), "l", late, palm, np.tile(-side, (len(share), 1)), (0.2, 0.6, -1.0)))
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
    ahead = np.stack([np.cos(yaw), np.sin(yaw)], 1)
    left = np.stack([-ahead[:, 1], ahead[:, 0]], 1)
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
            Reach(0, "l", always, hands, forward, (0.0, 0.6, -1.0), straight=True),
            Reach(1, "r", always, hands, -forward, (0.0, 0.6, -1.0), straight=True),
            Reach(0, "r", always, back, poses.axis(1, "chest", (1, 0, 0)), (0.0, 1.0, -0.4)),
            Reach(1, "l", always, shoulder, np.tile((0.0, 0.0, -1.0), (len(yaw), 1)), (0.0, 1.0, -0.2)),
        ]

    return Script(tuple(roles), clearance=0.3, paired=True, reaches=hold)
