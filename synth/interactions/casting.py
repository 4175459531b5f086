"""Draw a motion for each person of a scene, and play an interaction: paths, gazes, and hands that reach."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from dmae.data.rng import Stream, generator
from dmae.registry import telling_errors
from synth.interactions.registry import InteractionConfig, find_interaction
from synth.interactions.script import Cast, Reach, Role, Script, check_script, poses_of, seated, wrapped
from synth.motion.config import PROCEDURAL, MotionConfig
from synth.motion.feet import fit_to_body, foot_contacts, lock_feet, step_along
from synth.motion.geometry import about, forwards, reach_with_arm
from synth.motion.motion import Motion
from synth.motion.readers.takes import partner
from synth.motion.source import cut, draw_takes, load_motion, takes
from synth.people.body import SEGMENTS, Body
from synth.people.hands import uses_of

_PACE = (0.75, 1.3)
"""Least and greatest factor on the speed of a walk to keep up with others."""
_SWING = 0.5
"""Arm swing against the legs, rad per metre of stride."""
_LOOK = np.radians(65)
"""Greatest turn of the head, rad."""
_ARMS = {side: [SEGMENTS.index(f"{side}_{part}") for part in ("upper_arm", "forearm", "hand")] for side in "lr"}
_HEAD, _CHEST, _SPINE = (SEGMENTS.index(name) for name in ("head", "chest", "spine"))


def heading(rotations: np.ndarray, fps: float) -> np.ndarray:
    """Return the (F,) smoothed and continuous heading of a pelvis, from segments (F, 16, 3, 3), rad."""
    forward = gaussian_filter1d(rotations[:, 0, :2, 0], 0.4 * fps, axis=0, mode="nearest")
    return np.unwrap(np.arctan2(forward[:, 1], forward[:, 0]))


def course(base: Motion) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the path of a walk without sway (F, 2), m, the distance walked (F,), m, and the direction (F,), rad."""
    way = gaussian_filter1d(base.root[:, :2], 0.3 * base.fps, axis=0, mode="nearest")
    # The filter slows down at the ends: continue there at the rate from further in.
    edge = min(round(0.9 * base.fps), (len(base) - 1) // 2)
    time = np.arange(len(base))
    if edge > 0:
        for ends, inner, outer in ((time < edge, edge, edge + 1), (time >= len(time) - edge, -edge - 1, -edge - 2)):
            rate = (way[outer] - way[inner]) * (1 if inner > 0 else -1)
            way[ends] = way[inner] + (time[ends] - time[inner])[:, None] * rate
    # In one frame, only the hips show a direction.
    step = np.gradient(way, axis=0) if len(base) > 1 else 0 * way + base.rotations[:, 0, :2, 0]
    return way, np.cumsum(np.linalg.norm(step, axis=1)), np.unwrap(np.arctan2(step[:, 1], step[:, 0]))


def _along(base: Motion, path: np.ndarray, body: Body) -> Motion:
    """Return a walk bent along a path (F, 3), with the path's middle at half time, at the nearest pace possible."""
    way, along, direction = course(base)
    half = len(base) // 2
    step = np.linalg.norm(np.diff(path[:, :2], axis=0), axis=1)
    planned = np.concatenate([[0], np.cumsum(step)])
    pace = np.clip(planned[-1] / max(along[-1] - along[0], 1e-6), *_PACE)
    travelled = planned[half] + pace * (along - along[half])
    # The path continues straight beyond its ends.
    ends = np.clip(travelled, planned[0], planned[-1])
    line = np.stack([np.interp(ends, planned, column) for column in path.T], axis=1)
    line[:, :2] += (travelled - ends)[:, None] * forwards(line[:, 2])
    turn = about("z", gaussian_filter1d(line[:, 2] - direction, 0.2 * base.fps, mode="nearest"))
    root = base.root.copy()
    root[:, :2] = line[:, :2] + np.einsum("fij,fj->fi", turn[:, :2, :2], base.root[:, :2] - way)
    standing = foot_contacts(body, base.root, base.rotations, base.fps, turn=0.0)
    root, rotations = lock_feet(body, root, turn[:, None] @ base.rotations, standing, base.fps)
    return replace(base, root=root, rotations=rotations)


def _over_steps(base: Motion, role: Role, body: Body, *, rng: np.random.Generator) -> Motion:
    """Return the trunk, arms and head of a motion over legs that step along the role's path."""
    footsteps = step_along(body, role.path, base.fps, rng=rng, hips=role.hips, ahead=role.ahead)
    turn = about("z", role.path[:, 2] - heading(base.rotations, base.fps))
    rotations = turn[:, None] @ base.rotations
    across = np.stack([-np.sin(role.path[:, 2]), np.cos(role.path[:, 2]), 0 * role.path[:, 2]], 1)
    if role.lean is not None:
        # The spine bends half as much as the chest.
        for share, segments in ((0.5, [_SPINE]), (1.0, [_CHEST, _HEAD, *_ARMS["l"], *_ARMS["r"]])):
            bent = Rotation.from_rotvec(across * (share * role.lean)[:, None]).as_matrix()
            rotations[:, segments] = bent[:, None] @ rotations[:, segments]
    swing = _SWING * gaussian_filter1d(footsteps.stride, 0.08 * base.fps, mode="nearest")
    for side, sign in (("l", 1.0), ("r", -1.0)):
        turned = Rotation.from_rotvec(across * (sign * swing)[:, None]).as_matrix()
        rotations[:, _ARMS[side]] = turned[:, None] @ rotations[:, _ARMS[side]]
    rotations[:, 0] = footsteps.pelvis
    for leg, side in enumerate("lr"):
        for place, name in enumerate(("thigh", "shin", "foot")):
            rotations[:, SEGMENTS.index(f"{side}_{name}")] = footsteps.legs[:, leg, place]
    name = f"{base.name}, over steps"
    return Motion(name, base.fps, footsteps.root, rotations, body.hip_height)


def look_at(motion: Motion, person: int, gaze: np.ndarray, heads: np.ndarray) -> Motion:
    """Return a motion with the head turned to the people that the gaze (F,) names; heads (F, P, 3), m."""
    frames = np.arange(len(motion))
    sight = heads[frames, np.maximum(gaze, 0)] - heads[:, person]
    chest = motion.rotations[:, _CHEST]
    facing = np.arctan2(chest[:, 1, 0], chest[:, 0, 0])
    looking = (gaze >= 0) & (gaze != person)
    yaw = np.clip(wrapped(np.arctan2(sight[:, 1], sight[:, 0]) - facing), -_LOOK, _LOOK)
    pitch = -np.arctan2(sight[:, 2], np.linalg.norm(sight[:, :2], axis=1).clip(0.3))
    head = motion.rotations[:, _HEAD]
    own = np.arctan2(head[:, 1, 0], head[:, 0, 0])
    yaw, pitch = np.where(looking, yaw, wrapped(own - facing)), np.where(looking, np.clip(pitch, -0.4, 0.6), 0)
    yaw, pitch = (gaussian_filter1d(angle, 0.15 * motion.fps, mode="nearest") for angle in (yaw, pitch))
    rotations = motion.rotations.copy()
    rotations[:, _HEAD] = about("z", facing + yaw) @ about("y", pitch)
    return replace(motion, rotations=rotations)


def reach_for(motion: Motion, body: Body, reach: Reach) -> Motion:
    """Return the motion with a reach of an arm, blended over the arm's own motion."""
    poses = poses_of((body,), [motion])
    segments = _ARMS[reach.side]
    chest, shoulder = motion.rotations[:, _CHEST], poses.origins[:, 0, segments[0]]
    target = (reach.palm, reach.normal, reach.elbow)
    arm = reach_with_arm(body, reach.side, chest, shoulder, *target, straight=reach.straight)
    rotations, share = motion.rotations.copy(), reach.share
    parents = [_CHEST, *segments[:2]]
    own = rotations[:, parents].swapaxes(-1, -2) @ rotations[:, segments]
    wanted = np.stack([chest, arm[:, 0], arm[:, 1]], axis=1).swapaxes(-1, -2) @ arm
    # The elbow is a hinge about z: its bend is blended, and the turn of the forearm about its length.
    first, last = (np.arctan2(-each[:, 1, 0, 1], each[:, 1, 1, 1]) for each in (own, wanted))
    own[:, 1], wanted[:, 1] = about("z", -first) @ own[:, 1], about("z", -last) @ wanted[:, 1]
    joints = np.stack([_blended(own[:, number], wanted[:, number], share) for number in range(3)], axis=1)
    joints[:, 1] = about("z", first + share * (last - first)) @ joints[:, 1]
    for number, (segment, parent) in enumerate(zip(segments, parents, strict=True)):
        rotations[:, segment] = rotations[:, parent] @ joints[:, number]
    return replace(motion, rotations=rotations)


def _blended(own: np.ndarray, wanted: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Return rotations (F, 3, 3) at shares (F,) of the way from `own` to `wanted`, without jumps between frames."""
    turn = Rotation.from_matrix(own.swapaxes(-1, -2) @ wanted).as_rotvec()
    angle = np.linalg.norm(turn, axis=1)
    axis = turn / np.maximum(angle, 1e-12)[:, None]
    sign = np.cumprod(np.where((axis[1:] * axis[:-1]).sum(1) < 0, -1.0, 1.0))
    angle[1:], axis[1:] = sign * angle[1:], sign[:, None] * axis[1:]
    angle = np.unwrap(angle)
    angle -= 2 * np.pi * np.round(angle[share.argmax()] / (2 * np.pi))
    return own @ Rotation.from_rotvec(axis * (angle * share)[:, None]).as_matrix()


# One motion for each person, from a script and a motion source

_DRAWS = 4
"""Greatest number of stretches of recordings that are drawn to find one that fits a role."""
_WALKING, _STEADY = (0.5, 2.2), 0.85
"""Least and greatest speed of a walk, m/s, and the least share of the time at such a speed."""
_PROCEDURAL_WALK = (0.65, 1.6)
"""Least and greatest speed of procedural walks for a role, m/s."""
_UPRIGHT = 0.8
"""Least vertical component of the chest's axis for a trunk that can be combined with other legs."""


def draw_motions(
    config: MotionConfig,
    interaction: InteractionConfig,
    bodies: Sequence[Body],
    frames: int,
    fps: float,
    radius: float,
    seed: int,
    clip: int,
) -> tuple[list[Motion], Script | None]:
    """Draw the motions of P people of a clip, bystanders last, at the size of their bodies.

    Returns the motions, and the script of the interaction, if any. Motions of a script are placed around the origin,
    with hips within `radius`, m; others are anywhere.
    """
    rng = generator(seed, clip, Stream.MOTION)
    if not interaction.together:
        return [_at_size(config, body, seconds=frames / fps, fps=fps, rng=rng) for body in bodies], None
    taking_part = len(bodies) - interaction.bystanders
    cast = Cast(tuple(bodies[:taking_part]), np.arange(frames) / fps, fps, radius)
    script = find_interaction(interaction.kind).function(cast, rng=generator(seed, clip, Stream.INTERACTION))
    check_script(script, cast, interaction.kind)
    # Bystanders have a stream of their own, so that they do not change the people who take part.
    apart = generator(seed, clip, Stream.MOTION).spawn(1)[0]
    bystanders = [_at_size(config, body, seconds=frames / fps, fps=fps, rng=apart) for body in bodies[taking_part:]]
    return cast_roles(script, cast, config, rng=rng) + bystanders, script


def cast_roles(script: Script, cast: Cast, config: MotionConfig, *, rng: np.random.Generator) -> list[Motion]:
    """Draw a motion for each role of a script, at the size of the person, and let it follow the role.

    A role that walks takes a walk of the motion source, bent along the path. If none of a few draws is a walk, and for
    all other roles, the legs follow the path step by step. The trunk, arms and head then come from a motion of the
    source that is upright throughout, or else from a procedural person who stands.

    Recordings of two people together are played unchanged where the script asks for that.
    """
    pair = _recorded_pair(cast, config, rng=rng) if script.paired else None
    if pair:
        return pair
    motions = []
    for role, body in zip(script.roles, cast.bodies, strict=True):
        base, fits = _draw(role, body, cast, config, rng=rng)
        follows = role.walks and fits
        motions.append(_along(base, role.path, body) if follows else _over_steps(base, role, body, rng=rng))
    poses = poses_of(cast.bodies, motions)
    for person, role in enumerate(script.roles):
        if role.gaze is not None:
            motions[person] = look_at(motions[person], person, role.gaze, poses.origins[:, :, _HEAD])
    for reach in telling_errors(script.reaches, ("list", "tuple"))(poses):
        motion = reach_for(motions[reach.person], cast.bodies[reach.person], reach)
        hands = (*motion.hands, *uses_of(reach.side, reach.share, reach.hand))
        motions[reach.person] = replace(motion, hands=hands)
    return motions


def _at_size(config: MotionConfig, body: Body, *, seconds: float, fps: float, rng: np.random.Generator) -> Motion:
    """Return a motion of the body's size. It is played faster for a child, because children make shorter steps."""
    # All stools have one height, so that short people sit higher relative to their legs.
    seat = seated(body) / body.hip_height
    motion = load_motion(config, seconds=seconds * body.tempo, fps=fps / body.tempo, rng=rng, seated=seat)
    return fit_to_body(replace(motion, fps=fps), body)


def _recorded_pair(cast: Cast, config: MotionConfig, *, rng: np.random.Generator) -> list[Motion] | None:
    """Return the same stretch of a take and of its partner, around the origin; None if no take has a partner."""
    if config.kind == PROCEDURAL:
        return None
    pairs = [(path, other) for path in takes(config) if (other := partner(path))]
    if not pairs:
        return None
    read = _together(draw_takes(config, pairs, rng=rng))
    start = rng.uniform()
    span = {"start": start, "seconds": len(cast.seconds) / cast.fps, "fps": cast.fps}
    motions = [fit_to_body(cut(take, **span), body) for take, body in zip(read, cast.bodies, strict=True)]
    # One factor for both, so that hands still meet.
    growth = np.mean([body.hip_height / take.hip_height for take, body in zip(read, cast.bodies, strict=True)])
    places = [growth * cut(take, **span).root[:, :2] for take in read]
    middle = np.mean(places, axis=(0, 1))
    for motion, place in zip(motions, places, strict=True):
        motion.root[:, :2] = place - middle
    return motions


def _together(pair: tuple[Motion, ...]) -> list[Motion]:
    first = max(take.first for take in pair)
    end = min(take.first + len(take) for take in pair)
    if end <= first:
        raise ValueError(f"{' and '.join(take.name for take in pair)}: no frame is valid in both takes")
    frames = [slice(first - take.first, end - take.first) for take in pair]
    return [
        replace(take, root=take.root[part], rotations=take.rotations[part], first=first)
        for take, part in zip(pair, frames, strict=True)
    ]


def _draw(role: Role, body: Body, cast: Cast, config: MotionConfig, *, rng: np.random.Generator) -> tuple[Motion, bool]:
    """Return the first of a few motions at the body's size that fits the role, or the last, and whether it fits."""
    span: dict = {"seconds": len(cast.seconds) / cast.fps, "fps": cast.fps, "rng": rng}
    length = np.linalg.norm(np.diff(role.path[:, :2], axis=0), axis=1).sum()
    speed = float(np.clip(length / max(cast.seconds[-1], 1e-9) * body.tempo, *_PROCEDURAL_WALK))
    ways = replace(
        config.procedural, standing=0.0 if role.walks else 1.0, straight=1.0, gesture=0.0, speed=[speed, speed]
    )
    made = replace(config, kind=PROCEDURAL, path=None, actions=[], procedural=ways)
    if config.kind == PROCEDURAL:
        return _at_size(made, body, **span), True
    found = None
    for _ in range(_DRAWS):
        base = _at_size(config, body, **span)
        if (base.rotations[:, _CHEST, 2, 2] > _UPRIGHT).all():
            found = base
            if not role.walks or _is_walk(base):
                return base, True
    if found is None:
        found = _at_size(replace(made, procedural=replace(made.procedural, standing=1.0)), body, **span)
    return found, False


def _is_walk(base: Motion) -> bool:
    if len(base) < 4:
        return False
    _, along, direction = course(base)
    speed = np.gradient(along) * base.fps
    forward = np.abs(wrapped(direction - heading(base.rotations, base.fps))) < np.radians(40)
    walking = (speed > _WALKING[0]) & (speed < _WALKING[1]) & forward
    return bool(walking.mean() > _STEADY and speed.min() > 0.2)
