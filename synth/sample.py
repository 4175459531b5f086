"""A clip's scene, drawn from a configuration and a seed: who, in what clothes, where, doing what, among what."""

import json
from dataclasses import asdict
from functools import lru_cache

import numpy as np

from dmae.rng import Stream, generator
from synth.anthropometry import sample_body
from synth.arena import arena_file
from synth.body import GROWN, Body
from synth.decor import sample_decor, sample_tint
from synth.interactions import INTERACTIONS, InteractionConfig, InteractionKind
from synth.interactions.perform import draw_motions
from synth.interactions.script import Script
from synth.looks import sample_looks
from synth.motion import Motion
from synth.motion.source import MotionConfig
from synth.placement import place_persons, place_props, place_script, placed_discs, stools
from synth.plan import lead, led_path
from synth.props import PropsConfig, find_meshes, prop_space
from synth.revive import revive
from synth.spec import Layout, PersonSpec, PropSpec, SceneConfig, SceneSpec


def sample_spec(
    config: SceneConfig,
    motion: MotionConfig,
    props: PropsConfig | None = None,
    layout: Layout | None = None,
    interaction: InteractionConfig | None = None,
    *,
    seed: int,
    clip: int,
) -> SceneSpec:
    """Draw the scene of one clip. The same arguments give the same scene, whatever other clips are drawn.

    Args:
        config: What it is drawn from.
        motion: What people do.
        props: Things of the user's own, in place of `config.prop_kinds`.
        layout: Where things and people go, if that is asked for; who the people are and what they do is the same
            with any.
        interaction: What people do together.
        seed: Of the data set.
        clip: Number of the clip.

    Raises:
        ValueError: the configuration asks for what is not there, or for people whose motions leave no room for
            each other; the message says what to change.
    """
    props, interaction = props or PropsConfig(), interaction or InteractionConfig()
    rng = generator(seed, clip, Stream.SCENE)
    # The first child paints textures: see synth/scene.py.
    colours = rng.spawn(2)[1]
    arena, kinds = arena_file(config.arena), find_meshes(props.path) if props.path else config.prop_kinds
    spaces = {kind: prop_space(kind, props.scale, props.up) for kind in kinds}
    count = int(rng.integers(config.persons[0], config.persons[1], endpoint=True))
    if interaction.kind is not InteractionKind.none:
        count = int(np.clip(count, INTERACTIONS[interaction.kind].least, INTERACTIONS[interaction.kind].most))
    clearance = float(rng.uniform(*config.clearance))
    bodies = [sample_body(config.children, rng=rng) for _ in range(count)]
    looks = [sample_looks(body.feminine, child=body.age < GROWN, rng=rng) for body in bodies]
    frames = max(1, round(config.seconds * config.fps))
    motions, script = _draw(motion, interaction, bodies, frames, config.fps, config.radius, seed, clip)
    if layout:
        clearance, rng = layout.clearance, generator(seed, clip, Stream.LAYOUT).spawn(layout.draw + 1)[-1]
    where = {"middle": config.middle, "radius": config.radius, "gathering": (layout or config).gathering}
    furniture, loads = [], []
    if script:
        clearance = min(clearance, script.clearance or clearance)
        placements, furniture, loads = place_script(script, motions, arena, **where, rng=rng)
    else:
        placements = place_persons(motions, arena, **where, clearance=clearance, rng=rng)
    paths = np.stack([led_path(m, *placed) for m, placed in zip(motions, placements, strict=True)], axis=1)
    for person, made in enumerate(motions):
        furniture += [("stool", (x, y), 0.0) for x, y, _ in stools(made, paths[:, person]).tolist()]
    things = place_props(
        layout.props if layout else int(rng.integers(config.props[0], config.props[1], endpoint=True)),
        spaces,
        paths,
        arena,
        fps=config.fps,
        middle=config.middle,
        radius=config.radius,
        clearance=clearance,
        before=layout.before if layout else (),
        taken=np.concatenate(
            [np.empty((0, 3)), *(placed_discs(prop_space(kind).discs, *at) for kind, *at in furniture)]
        ),
        rng=rng,
    )
    return SceneSpec(
        seed=seed,
        clip=clip,
        fps=float(config.fps),
        frames=frames,
        arena=config.arena,
        decor=sample_decor(arena, randomize=config.randomize, rng=colours),
        clearance=clearance,
        persons=tuple(
            PersonSpec(body, look, m.name, *placed)
            for body, look, m, placed in zip(bodies, looks, motions, placements, strict=True)
        ),
        props=tuple(
            PropSpec(kind, at, yaw, sample_tint(rng=colours) if config.randomize else None, props.scale, props.up)
            for kind, at, yaw in things
        ),
        motion=motion,
        interaction=interaction,
        furniture=tuple(
            PropSpec(kind, at, yaw, sample_tint(rng=colours) if config.randomize else None)
            for kind, at, yaw in furniture
        ),
        loads=tuple(loads),
        radius=float(config.radius),
    )


def load_motions(spec: SceneSpec) -> list[Motion]:
    """Each person's motion where the spec puts it, at the size of the person's body, on the floor."""
    bodies = [person.body for person in spec.persons]
    where = spec.frames, spec.fps, spec.radius, spec.seed, spec.clip
    motions, _ = _draw(spec.motion, spec.interaction, bodies, *where)
    return [lead(m, p.start, p.yaw, p.turn) for m, p in zip(motions, spec.persons, strict=True)]


def _draw(
    config: MotionConfig, interaction: InteractionConfig, bodies: list[Body], *rest
) -> tuple[list[Motion], Script | None]:
    if config.path is None:
        text = json.dumps(asdict(config), default=lambda kind: kind.value)
        motions, script = _draw_made(text, interaction, tuple(bodies), *rest)
        return list(motions), script
    return draw_motions(config, interaction, bodies, *rest)


@lru_cache(maxsize=1)
def _draw_made(config: str, *rest) -> tuple[list[Motion], Script | None]:
    """Motions that depend on no file are kept while a clip's scene is drawn, maybe in several layouts, and built."""
    motions, script = draw_motions(revive(MotionConfig, json.loads(config)), *rest)
    for motion in motions:
        motion.root.setflags(write=False)
        motion.rotations.setflags(write=False)
    return motions, script
