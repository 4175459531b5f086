"""People in contact: handshake, hug, huddle, sparring, dance."""

import numpy as np
from scipy.ndimage import gaussian_filter1d

from synth.interactions.body_measures import arm_length, thickness, within_reach
from synth.interactions.paths import approach, during
from synth.interactions.registry import interaction
from synth.interactions.script import Cast, Poses, Reach, Role, Script
from synth.motion.easing import minimum_jerk
from synth.people.segments import SEGMENTS

_EMBRACES = {
    True: ((0.08, 0.09, 0.22), (-0.07, 0.04, 0.135), (0.0, 1.0, 0.1)),
    False: ((0.04, 0.20, 0.02), (-0.075, 0.02, 0.02), (-0.2, 1.0, -0.8)),
}
"""Arms over the other person's shoulder (True) and below it: palm targets on the way and at the end, in the frame of
the other's chest as fractions of stature, y towards the side of the arm; and the direction of the elbow."""
_HIGH = 0.18
"""Greatest height of an embrace above one's own shoulder, m; smaller people embrace at the height of their shoulder."""
_SIGN = {"l": 1.0, "r": -1.0}


def _face_to_face(
    cast: Cast, apart: float, aside: float, *, come: float, when: float, rng: np.random.Generator
) -> tuple[tuple[Role, ...], np.ndarray]:
    """Two people who walk up to each other.

    Args:
        cast: The two people.
        apart, aside: Distance between them at the end, along and across their way, m.
        come: Distance that each of them walks, m.
        when: Time at which they arrive, s.
        rng: Draws the direction.

    Returns:
        Their roles, in which they look at each other, and the direction (2,) from the first to the second.
    """
    yaw = rng.uniform(0, 2 * np.pi)
    ahead, left = np.array((np.cos(yaw), np.sin(yaw))), np.array((-np.sin(yaw), np.cos(yaw)))
    roles = []
    for person, sign in enumerate((-1, 1)):
        place = sign * (ahead * apart / 2 + left * aside / 2)
        facing = yaw if sign < 0 else yaw + np.pi
        start = np.array((*(place + sign * come * ahead), facing))
        path = approach(cast, start, np.array((*place, facing)), begin=0.0, speed=come / max(when, 0.6))
        roles.append(Role(path, gaze=np.full(len(path), 1 - person)))
    return tuple(roles), ahead


def _meeting(cast: Cast, longest: float) -> tuple[float, float, float]:
    """Distance that each person walks, m, and the times at which they meet and part, s, for clips of any length."""
    last = cast.seconds[-1]
    when = min(1.8, 0.36 * last)
    return min(longest, 0.55 * when), when, max(last - 1.0, 0.75 * last)


@interaction(persons=(2, 2))
def handshake(cast: Cast, *, rng: np.random.Generator) -> Script:
    """Two people walk up to each other and shake their right hands."""
    come, when, parting = _meeting(cast, 0.8)
    apart = 1.2 * np.mean([arm_length(body) for body in cast.bodies])
    roles, ahead = _face_to_face(cast, apart, 0.0, come=come, when=when, rng=rng)
    height = 0.64 * np.mean([body.stature for body in cast.bodies])
    rate, move = rng.uniform(1.6, 2.3), min(0.6, 0.3 * cast.seconds[-1])
    share = during(cast.seconds, when + 0.5 * move, parting, move)
    shaking = during(cast.seconds, when + 0.5 * move + 0.3, min(when + 0.5 * move + 1.6, parting - 0.2), 0.3)
    hands = np.zeros((len(share), 3))
    hands[:, 2] = height + 0.03 * shaking * np.sin(2 * np.pi * rate * cast.seconds)
    right = np.array((ahead[1], -ahead[0], 0))

    def shake(poses: Poses) -> list[Reach]:
        # The palm of a right hand that points ahead faces left.
        middle = hands + (poses.origins[:, 0, 0] + poses.origins[:, 1, 0]) / 2 * (1, 1, 0)
        normals = (-right, right)
        return [
            Reach(person, "r", share, middle, np.tile(normal, (len(share), 1))) for person, normal in enumerate(normals)
        ]

    return Script(roles, clearance=min(0.6, apart - 0.1), reaches=shake)


@interaction(persons=(2, 2))
def hug(cast: Cast, *, rng: np.random.Generator) -> Script:
    """Two people walk up to each other and put their arms around each other."""
    come, when, _ = _meeting(cast, 0.7)
    apart = sum(thickness(body) for body in cast.bodies) + 0.04
    roles, _ = _face_to_face(cast, apart, 0.11, come=come, when=when, rng=rng)
    # Arms open on the way, and close once the other is between them.
    share = minimum_jerk((cast.seconds - 0.4 * when) / (0.45 * when))
    closed = minimum_jerk((cast.seconds - 0.95 * when) / max(0.6, 0.3 * when))[:, None]

    level = abs(cast.bodies[0].stature - cast.bodies[1].stature) < 0.07

    def hold(poses: Poses) -> list[Reach]:
        reaches = []
        for person, other in ((0, 1), (1, 0)):
            stature, girth = cast.bodies[other].stature, max(1.0, cast.bodies[other].girth)
            # The other's left is on one's right. The taller person reaches over both shoulders, the smaller below.
            for side, sign in (("r", 1), ("l", -1)):
                start, end, elbow = _EMBRACES[sign > 0 if level else stature < cast.bodies[person].stature]
                size = stature * np.array((girth, sign, 1))
                beside, back = (poses.point(other, "chest", tuple(at * size)) for at in (start, end))
                normal = poses.axis(other, "chest", (0.4, -sign, 0)) * (1 - closed)
                normal = normal + closed * poses.axis(other, "chest", (1, 0, 0))
                palm = beside + closed * (back - beside)
                shoulder = poses.origins[:, person, SEGMENTS.index(f"{side}_upper_arm"), 2]
                if (palm[:, 2] - shoulder).max() > _HIGH:
                    palm[:, 2] = np.minimum(palm[:, 2], shoulder)
                reaches.append(Reach(person, side, share, palm, normal, elbow))
        return reaches

    return Script(tuple(Role(role.path) for role in roles), clearance=0.9 * apart, reaches=hold)


@interaction(persons=(6, 6))
def huddle(cast: Cast, *, rng: np.random.Generator) -> Script:
    """Six people step into a ring, bend, and lay their arms on their neighbours' backs."""
    count, seconds = len(cast.bodies), cast.seconds
    widest = max(0.29 * body.stature * max(1.0, body.girth) for body in cast.bodies)
    radius, first = widest / (2 * np.sin(np.pi / count)) + 0.05, rng.uniform(0, 2 * np.pi)
    when = min(1.6, 0.36 * seconds[-1])
    bent = minimum_jerk((seconds - 0.5 * when) / max(when, 0.4))
    roles = []
    for person in range(count):
        angle = first + 2 * np.pi * person / count
        out = np.array((np.cos(angle), np.sin(angle)))
        far, facing = radius + 0.5 * min(1.0, when), angle + np.pi
        start, end = np.array((*(far * out), facing)), np.array((*(radius * out), facing))
        path = approach(cast, start, end, begin=0.0, speed=(far - radius) / max(when, 0.6))
        roles.append(Role(path, lean=bent * rng.uniform(0.30, 0.42)))
    share = minimum_jerk((seconds - 0.7 * when) / max(0.6 * when, 0.3))

    def embrace(poses: Poses) -> list[Reach]:
        reaches = []
        for person in range(count):
            # The next person of the ring is on one's right; of two arms on a back the left arm lies lower.
            for side, other, up in (("r", person + 1, 0.135), ("l", person - 1, 0.085)):
                other %= count
                body = cast.bodies[other]
                near = 0.045 * body.stature * (1 if side == "r" else -1)
                at = (-0.066 * body.stature * body.girth - 0.01, near, up * body.stature)
                normal = poses.axis(other, "chest", (1, 0, 0))
                reaches.append(Reach(person, side, share, poses.point(other, "chest", at), normal))
        return reaches

    return Script(tuple(roles), clearance=0.4, reaches=embrace)


@interaction(persons=(2, 2))
def fight(cast: Cast, *, rng: np.random.Generator) -> Script:
    """Two people spar at arm's length: guards up, they circle, step in and out, and punch short of the face."""
    seconds = cast.seconds
    arm = np.mean([arm_length(body) for body in cast.bodies])
    yaw = rng.uniform(0, 2 * np.pi) + rng.choice((-1, 1)) * rng.uniform(0.1, 0.3) * seconds
    # Nearest at each punch.
    every = rng.uniform(0.8, 1.1)
    times = np.arange(0.7, max(seconds[-1] - 0.2, 0.71), every)
    punches = [(float(at), int(rng.integers(2)), str(rng.choice(("l", "r")))) for at in times]
    near = sum(np.exp(-(((seconds - at) / 0.3) ** 2)) for at, _, _ in punches)
    apart = gaussian_filter1d(1.75 * arm - 0.18 * np.minimum(near, 1), 0.1 * cast.fps, mode="nearest")
    roles = []
    for person, sign in enumerate((-1, 1)):
        xy = sign * apart[:, None] / 2 * np.stack([np.cos(yaw), np.sin(yaw)], 1)
        path = np.column_stack([xy, yaw + (np.pi if sign > 0 else 0) - 0.35])
        body = cast.bodies[person]
        roles.append(
            Role(path, gaze=np.full(len(seconds), 1 - person), hips=np.full(len(seconds), 0.96 * body.hip_height))
        )

    def strike(poses: Poses) -> list[Reach]:
        reaches = []
        for person in range(2):
            size, other = cast.bodies[person].stature, 1 - person
            for side, sign in _SIGN.items():
                fists = poses.point(person, "chest", (0.155 * size, 0.055 * sign * size, 0.15 * size))
                face = poses.point(other, "head", (0.05, 0, 0.06 * cast.bodies[other].stature))
                shoulder = poses.point(person, "chest", (0, 0.1 * sign * size, 0.137 * size))
                way = face - shoulder
                far = np.linalg.norm(way, axis=1, keepdims=True)
                # A fist extends past the palm: arms nearly straight, but never through the face.
                end = shoulder + way / far * np.minimum(0.93 * arm_length(cast.bodies[person]), far - 0.2)
                hit = np.zeros(len(seconds))
                for at, striker, hand in punches:
                    if (striker, hand) == (person, side):
                        hit = np.maximum(hit, during(seconds, at - 0.03, at + 0.03, 0.22))
                normal = poses.axis(person, "chest", (0, -sign, -0.6))
                palm = fists + hit[:, None] * (end - fists)
                reaches.append(Reach(person, side, np.ones(len(seconds)), palm, normal))
        return reaches

    return Script(tuple(roles), clearance=0.6, reaches=strike)


@interaction(persons=(2, 2))
def dance(cast: Cast, *, rng: np.random.Generator) -> Script:
    """A couple dances: unchanged recordings of couples if there are any, else steps and turns in closed hold."""
    seconds, beat = cast.seconds, rng.uniform(0.42, 0.52)
    apart = max(0.46, sum(thickness(body) for body in cast.bodies) + 0.15)
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
        roles.append(Role(path))
    always = np.ones(len(seconds))

    def hold(poses: Poses) -> list[Reach]:
        # The first person's left hand holds the other's right; their other hands lie on back and shoulder.
        sizes = [body.stature for body in cast.bodies]
        hands = poses.origins[:, :, 0].mean(1) + 0.27 * min(sizes) * np.column_stack([left, 0 * yaw])
        aside = [0.27 * min(sizes) - 0.1 * size for size in sizes]
        hands[:, 2] = np.clip(0.76 * np.mean(sizes), *within_reach(cast.bodies, np.hypot(aside, apart / 2)))
        first, second = sizes
        back = poses.point(1, "chest", (-0.07 * second * max(1.0, cast.bodies[1].girth), 0.05 * second, 0.03 * second))
        shoulder = poses.point(0, "chest", (0.01 * first, -0.10 * first, 0.185 * first))
        forward = np.column_stack([ahead, 0 * yaw])
        return [
            Reach(0, "l", always, hands, forward, (0.0, 0.6, -1.0)),
            Reach(1, "r", always, hands, -forward, (0.0, 0.6, -1.0)),
            Reach(0, "r", always, back, poses.axis(1, "chest", (1, 0, 0)), (0.0, 1.0, -0.4)),
            Reach(1, "l", always, shoulder, np.tile((0.0, 0.0, -1.0), (len(yaw), 1)), (0.0, 1.0, -0.2)),
        ]

    return Script(tuple(roles), clearance=0.3, paired=True, reaches=hold)
