"""Draw one motion for each person from a script and a motion source."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dmae.data.rng import Stream, generator
from synth.interactions.body_measures import seated
from synth.interactions.paths import wrapped
from synth.interactions.playback import course, follow, heading, look_at, reach_for
from synth.interactions.registry import InteractionConfig, find_interaction
from synth.interactions.script import Cast, Role, Script, poses_of
from synth.motion.body_fit import fit_to_body
from synth.motion.motion import Motion
from synth.motion.readers.takes import partner
from synth.motion.source import PROCEDURAL, MotionConfig, cut, draw_takes, load_motion, takes
from synth.people.body import Body
from synth.people.segments import SEGMENTS

_DRAWS = 4
"""Greatest number of stretches of recordings that are drawn to find one that fits a role."""
_WALKING, _STEADY = (0.5, 2.2), 0.85
"""Least and greatest speed of a walk, m/s, and the least share of the time at such a speed."""
_PROCEDURAL_WALK = (0.65, 1.6)
"""Least and greatest speed of procedural walks for a role, m/s."""
_UPRIGHT = 0.8
"""Least vertical component of the chest's axis for a trunk that can be combined with other legs."""
_HEAD, _CHEST = (SEGMENTS.index(name) for name in ("head", "chest"))


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
    """Draw the motions of all people of a clip, at the size of their bodies.

    Args:
        config: The motion source.
        interaction: What people do together.
        bodies: Bodies of P people, bystanders last.
        frames, fps: Length and frame rate of the clip.
        radius: Greatest distance of hips from the middle, m.
        seed, clip: Seed of the data set and number of the clip.

    Returns:
        P motions, and the script of the interaction, if any. Motions of a script are placed around the origin, others
        anywhere.
    """
    rng = generator(seed, clip, Stream.MOTION)
    if not interaction.together:
        return [_at_size(config, body, seconds=frames / fps, fps=fps, rng=rng) for body in bodies], None
    taking_part = len(bodies) - interaction.bystanders
    cast = Cast(tuple(bodies[:taking_part]), np.arange(frames) / fps, fps, radius)
    script = find_interaction(interaction.kind).function(cast, rng=generator(seed, clip, Stream.INTERACTION))
    # Bystanders have a stream of their own, so that they do not change the people who take part.
    apart = generator(seed, clip, Stream.MOTION).spawn(1)[0]
    bystanders = [_at_size(config, body, seconds=frames / fps, fps=fps, rng=apart) for body in bodies[taking_part:]]
    return cast_roles(script, cast, config, rng=rng) + bystanders, script


def cast_roles(script: Script, cast: Cast, config: MotionConfig, *, rng: np.random.Generator) -> list[Motion]:
    """Draw a motion for each role of a script and let it follow the role.

    A role that walks takes a walk of the motion source, bent along the path. If none of a few draws is a walk, and for
    all other roles, the legs follow the path step by step. The trunk, arms and head then come from a motion of the
    source that is upright throughout, or else from a procedural person who stands.

    Recordings of two people together are played unchanged where the script asks for that.

    Args:
        script: The roles, around the origin.
        cast: The people.
        config: The motion source.
        rng: Draws motions and steps.

    Returns:
        One motion for each person, in place, of the person's size.
    """
    pair = _recorded_pair(cast, config, rng=rng) if script.paired else None
    if pair:
        return pair
    motions = []
    for role, body in zip(script.roles, cast.bodies, strict=True):
        base, fits = _draw(role, body, cast, config, rng=rng)
        motions.append(follow(base, role, body, bend=role.walks and fits, rng=rng))
    poses = poses_of(cast.bodies, motions)
    for person, role in enumerate(script.roles):
        if role.gaze is not None:
            motions[person] = look_at(motions[person], person, role.gaze, poses.origins[:, :, _HEAD])
    for reach in script.reaches(poses):
        motions[reach.person] = reach_for(motions[reach.person], cast.bodies[reach.person], reach)
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
    """Return the frames that both takes of a pair have."""
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
    span = {"seconds": len(cast.seconds) / cast.fps, "fps": cast.fps, "rng": rng}
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
    """Return whether a motion is a forward walk throughout."""
    if len(base) < 4:
        return False
    _, along, direction = course(base)
    speed = np.gradient(along) * base.fps
    forward = np.abs(wrapped(direction - heading(base.rotations, base.fps))) < np.radians(40)
    walking = (speed > _WALKING[0]) & (speed < _WALKING[1]) & forward
    return bool(walking.mean() > _STEADY and speed.min() > 0.2)
