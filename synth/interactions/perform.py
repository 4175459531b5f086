"""From a script and the motion that there is to how each person moves."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from dmae.rng import Stream, generator
from synth.body import Body
from synth.feet import plant, planted
from synth.interactions import INTERACTIONS, InteractionConfig, InteractionKind
from synth.interactions.script import Cast, Reach, Role, Script, poses_of, seated, wrapped
from synth.motion import SEGMENTS, Motion
from synth.motion.cmu import partner
from synth.motion.limbs import reach_with_arm
from synth.motion.rotations import about
from synth.motion.source import MotionConfig, MotionKind, cut, load_motion, read_take, takes
from synth.motion.steps import step_along
from synth.plan import fit

_DRAWS = 4
"""How many stretches of recordings are drawn for one that fits a role."""
_PACE = (0.75, 1.3)
"""How much slower or faster than their own walk people keep up with others."""
_WALKING, _STEADY = (0.5, 2.2), 0.85
"""Speeds of a walk, m/s, and the share of the time in which somebody who walks has one."""
_WALKED = (0.65, 1.6)
"""Least and greatest speed of walks made for a role, m/s."""
_UPRIGHT = 0.8
"""Least height of the top of the chest's axis for a trunk that can be put on other legs."""
_SWING = 0.5
"""By how much arms swing against the legs, rad a metre of stride."""
_LOOK = np.radians(65)
"""How far heads turn."""
_LOWER = [SEGMENTS.index("pelvis")] + [
    SEGMENTS.index(f"{side}_{part}") for side in "lr" for part in ("thigh", "shin", "foot")
]
_ARMS = {side: [SEGMENTS.index(f"{side}_{part}") for part in ("upper_arm", "forearm", "hand")] for side in "lr"}
_HEAD, _CHEST, _SPINE = (SEGMENTS.index(name) for name in ("head", "chest", "spine"))


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
    """What everybody does in a clip, at the size of the body, and the script by which they do it together, if any.

    Motions of a script are arranged about the origin, others lie wherever the source has them.
    """
    rng = generator(seed, clip, Stream.MOTION)
    if interaction.kind is InteractionKind.none:
        return [_at_size(config, body, seconds=frames / fps, fps=fps, rng=rng) for body in bodies], None
    cast = Cast(tuple(bodies), np.arange(frames) / fps, fps, radius)
    script = INTERACTIONS[interaction.kind].write(cast, rng=generator(seed, clip, Stream.INTERACTION))
    return perform(script, cast, config, rng=rng), script


def _at_size(config: MotionConfig, body: Body, *, seconds: float, fps: float, rng: np.random.Generator) -> Motion:
    """A motion of the body's size; an adult's is played faster for a child, whose steps are shorter."""
    # Seats are of one height for all, so that the short sit higher.
    seat = seated(body) / body.hip_height
    motion = load_motion(config, seconds=seconds * body.tempo, fps=fps / body.tempo, rng=rng, seated=seat)
    return fit(replace(motion, fps=fps), body)


def perform(script: Script, cast: Cast, config: MotionConfig, *, rng: np.random.Generator) -> list[Motion]:
    """Let people play their roles.

    Who walks does it as the source has them walk, bent along the path; where none of a few draws is a walk, and for all
    other roles, legs follow the path step by step below the trunk, arms and head of the source, as long as these are
    upright; else below those of a person of `synth.motion.procedural` who stands.

    What two people were recorded doing together is played as it is, where the script asks for that.

    Args:
        script: The roles, about the origin.
        cast: Who plays them.
        config: Where motion comes from.
        rng: Draws motions and steps.

    Returns:
        One motion a person, in place, of the person's size.
    """
    pair = _recorded_pair(cast, config, rng=rng) if script.paired else None
    if pair:
        return pair
    motions = [_play(role, body, cast, config, rng=rng) for role, body in zip(script.roles, cast.bodies, strict=True)]
    poses = poses_of(cast.bodies, motions)
    for person, role in enumerate(script.roles):
        if role.gaze is not None:
            motions[person] = _look(motions[person], person, role.gaze, poses.origins[:, :, _HEAD])
    for reach in script.reaches(poses):
        motions[reach.person] = _reach(motions[reach.person], cast.bodies[reach.person], reach)
    return motions


def _recorded_pair(cast: Cast, config: MotionConfig, *, rng: np.random.Generator) -> list[Motion] | None:
    """The same stretch of a take and of its partner's, about the origin; None if no take has a partner beside it."""
    if config.kind is MotionKind.procedural:
        return None
    pairs = [(path, other) for path in takes(config) if (other := partner(path))]
    if not pairs:
        return None
    pair, start = pairs[rng.integers(len(pairs))], rng.uniform()
    how = {"unit": config.unit, "up": config.up, "mapping": config.mapping}
    read = [read_take(path, config.fps, **how) for path in pair]
    shortest = min(len(take) for take in read)
    read = [replace(take, root=take.root[:shortest], rotations=take.rotations[:shortest]) for take in read]
    span = {"start": start, "seconds": len(cast.seconds) / cast.fps, "fps": cast.fps}
    motions = [fit(cut(take, **span), body) for take, body in zip(read, cast.bodies, strict=True)]
    # Both grow as much, so that hands still find hands.
    growth = np.mean([body.hip_height / take.hip_height for take, body in zip(read, cast.bodies, strict=True)])
    places = [growth * cut(take, **span).root[:, :2] for take in read]
    middle = np.mean(places, axis=(0, 1))
    for motion, place in zip(motions, places, strict=True):
        motion.root[:, :2] = place - middle
    return motions


def _play(role: Role, body: Body, cast: Cast, config: MotionConfig, *, rng: np.random.Generator) -> Motion:
    base, fitting = _draw(role, body, cast, config, rng=rng)
    if role.walks and fitting:
        return _along(base, role.path, body)
    return _over_steps(base, role, body, rng=rng)


def _draw(role: Role, body: Body, cast: Cast, config: MotionConfig, *, rng: np.random.Generator) -> tuple[Motion, bool]:
    """A motion at the body's size, the first of a few that fits the role, and whether it does."""
    span = {"seconds": len(cast.seconds) / cast.fps, "fps": cast.fps, "rng": rng}
    length = np.linalg.norm(np.diff(role.path[:, :2], axis=0), axis=1).sum()
    speed = float(np.clip(length / max(cast.seconds[-1], 1e-9) * body.tempo, *_WALKED))
    ways = replace(
        config.procedural, standing=0.0 if role.walks else 1.0, straight=1.0, gesture=0.0, speed=[speed, speed]
    )
    made = replace(config, kind=MotionKind.procedural, path=None, actions=[], procedural=ways)
    if config.kind is MotionKind.procedural:
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


def _heading(rotations: np.ndarray, fps: float) -> np.ndarray:
    """(F,) where somebody of these segments (F, 16, 3, 3) faces on the whole, rad, continuous."""
    forward = gaussian_filter1d(rotations[:, 0, :2, 0], 0.4 * fps, axis=0, mode="nearest")
    return np.unwrap(np.arctan2(forward[:, 1], forward[:, 0]))


def _course(base: Motion) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of a walk: its way (F, 2) without sway, m, how far along each frame is (F,), m, and its direction (F,), rad."""
    way = gaussian_filter1d(base.root[:, :2], 0.3 * base.fps, axis=0, mode="nearest")
    # A filter halts at the ends: the way goes on there as it went a little further in.
    edge = min(round(0.9 * base.fps), (len(base) - 1) // 2)
    time = np.arange(len(base))
    if edge > 0:
        for ends, inner, outer in ((time < edge, edge, edge + 1), (time >= len(time) - edge, -edge - 1, -edge - 2)):
            rate = (way[outer] - way[inner]) * (1 if inner > 0 else -1)
            way[ends] = way[inner] + (time[ends] - time[inner])[:, None] * rate
    step = np.gradient(way, axis=0)
    return way, np.cumsum(np.linalg.norm(step, axis=1)), np.unwrap(np.arctan2(step[:, 1], step[:, 0]))


def _is_walk(base: Motion) -> bool:
    """Whether somebody walks forward all the time."""
    if len(base) < 4:
        return False
    _, along, direction = _course(base)
    speed = np.gradient(along) * base.fps
    forward = np.abs(wrapped(direction - _heading(base.rotations, base.fps))) < np.radians(40)
    walking = (speed > _WALKING[0]) & (speed < _WALKING[1]) & forward
    return bool(walking.mean() > _STEADY and speed.min() > 0.2)


def _along(base: Motion, path: np.ndarray, body: Body) -> Motion:
    """A walk bent along a path (F, 3), half of which it has walked at half time, at a pace as near as it can keep."""
    way, along, direction = _course(base)
    half = len(base) // 2
    step = np.linalg.norm(np.diff(path[:, :2], axis=0), axis=1)
    planned = np.concatenate([[0], np.cumsum(step)])
    pace = np.clip(planned[-1] / max(along[-1] - along[0], 1e-6), *_PACE)
    travelled = planned[half] + pace * (along - along[half])
    # The path goes straight on beyond its ends.
    ends = np.clip(travelled, planned[0], planned[-1])
    line = np.stack([np.interp(ends, planned, column) for column in path.T], axis=1)
    line[:, :2] += (travelled - ends)[:, None] * np.stack([np.cos(line[:, 2]), np.sin(line[:, 2])], 1)
    turn = about("z", gaussian_filter1d(line[:, 2] - direction, 0.2 * base.fps, mode="nearest"))
    root = base.root.copy()
    root[:, :2] = line[:, :2] + np.einsum("fij,fj->fi", turn[:, :2, :2], base.root[:, :2] - way)
    standing = planted(body, base.root, base.rotations, base.fps, turn=0.0)
    root, rotations = plant(body, root, turn[:, None] @ base.rotations, standing, base.fps)
    return replace(base, root=root, rotations=rotations)


def _over_steps(base: Motion, role: Role, body: Body, *, rng: np.random.Generator) -> Motion:
    """Trunk, arms and head of a motion over legs that follow the role's path step by step."""
    stepping = step_along(body, role.path, base.fps, rng=rng, hips=role.hips, ahead=role.ahead)
    turn = about("z", role.path[:, 2] - _heading(base.rotations, base.fps))
    rotations = turn[:, None] @ base.rotations
    if role.lean is not None:
        _bend(rotations, role, base.fps)
    across = np.stack([-np.sin(role.path[:, 2]), np.cos(role.path[:, 2]), 0 * role.path[:, 2]], 1)
    swing = _SWING * gaussian_filter1d(stepping.stride, 0.08 * base.fps, mode="nearest")
    for side, sign in (("l", 1.0), ("r", -1.0)):
        turned = Rotation.from_rotvec(across * (sign * swing)[:, None]).as_matrix()
        rotations[:, _ARMS[side]] = turned[:, None] @ rotations[:, _ARMS[side]]
    rotations[:, 0] = stepping.pelvis
    for leg, side in enumerate("lr"):
        for place, name in enumerate(("thigh", "shin", "foot")):
            rotations[:, SEGMENTS.index(f"{side}_{name}")] = stepping.legs[:, leg, place]
    name = f"{base.name}, over steps"
    return Motion(name, base.fps, stepping.root, rotations, body.hip_height)


def _bend(rotations: np.ndarray, role: Role, fps: float) -> None:
    """Bend the trunk forward, the spine half as much as the chest."""
    across = np.stack([-np.sin(role.path[:, 2]), np.cos(role.path[:, 2]), 0 * role.path[:, 2]], 1)
    for share, segments in ((0.5, [_SPINE]), (1.0, [_CHEST, _HEAD, *_ARMS["l"], *_ARMS["r"]])):
        bent = Rotation.from_rotvec(across * (share * role.lean)[:, None]).as_matrix()
        rotations[:, segments] = bent[:, None] @ rotations[:, segments]


def _look(motion: Motion, person: int, gaze: np.ndarray, heads: np.ndarray) -> Motion:
    """The head turned towards whom the person looks at; heads (F, P, 3), m."""
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


def _reach(motion: Motion, body: Body, reach: Reach) -> Motion:
    """The motion with an arm that reaches, blended in its chest's frame over what it does else."""
    poses = poses_of((body,), [motion])
    segments = _ARMS[reach.side]
    chest, shoulder = motion.rotations[:, _CHEST], poses.origins[:, 0, segments[0]]
    arm = reach_with_arm(body, reach.side, chest, shoulder, reach.palm, reach.normal, reach.elbow)
    rotations = motion.rotations.copy()
    away = np.einsum("fsji,fsjk->fsik", rotations[:, segments], arm)
    vectors = Rotation.from_matrix(away.reshape(-1, 3, 3)).as_rotvec().reshape(-1, 3, 3)
    part = Rotation.from_rotvec((vectors * reach.share[:, None, None]).reshape(-1, 3)).as_matrix().reshape(away.shape)
    rotations[:, segments] = rotations[:, segments] @ part
    return replace(motion, rotations=rotations)
