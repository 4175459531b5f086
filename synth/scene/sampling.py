"""Draw a clip's scene from a configuration and a seed: people, clothes, motions, placement, props."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from dmae.data.rng import Stream, generator
from synth.interactions.casting import draw_motions
from synth.interactions.registry import InteractionConfig
from synth.interactions.script import STOOL, Load, Script, poses_of
from synth.motion.config import MotionConfig
from synth.motion.motion import Motion, redirect, redirected_path
from synth.people.body import ADULT_AGE, MOST_PERSONS, Body, sample_body
from synth.people.clothing import BAGS, PersonLooks, dressed, sample_hands, sample_looks
from synth.people.hands import HandChange, sample_changes
from synth.rooms.config import PropsConfig
from synth.rooms.decor import sample_decor, sample_tint
from synth.rooms.props import PlacedProp, find_meshes, prop_size
from synth.rooms.room import arena_file, room_name
from synth.scene.config import Hands, SceneConfig, Solids
from synth.scene.placement import Placement, place_persons, place_props, place_script, placed_discs, stool_discs
from synth.scene.spec import PLAN_FPS, USUAL_PERSONS, PersonSpec, PropSpec, SceneSpec, planned_frames

_BYSTANDERS, _PLACES, _HANDS, _WARDROBE = 2, 3, 4, 5
"""Numbers of the child streams for bystanders, their places, hands, and what people wear besides shirts, trousers and
shoes; 0 and 1 draw textures and colours."""
_ON_BACK, _OFF_FLOOR, _ROOM, _STANDING = (-0.10, 0.0, 0.015), 0.3, 0.3, 0.75
"""The middle of a backpack in the frame of the chest, fractions of stature; its least height above the floor and its
least distance from other people's joints, m; the least height of hips, relative to that in standing straight, of people
with a bag at the hip."""
_BYSTANDER_GAP = 0.65
"""Least distance from a bystander's hips to other people's hips, m."""


class SampledScene(NamedTuple):
    """A drawn scene."""

    spec: SceneSpec  # The scene of P people, as stored
    motions: list[Motion]  # P motions, placed in the scene. `load_motions` draws them again from a stored spec.


@dataclass(frozen=True)
class People:
    """The people of a clip before they are placed."""

    # bodies, looks: Bodies and looks of P people
    bodies: list[Body]
    looks: list[PersonLooks]
    hands: list[tuple[HandChange, ...]]  # How the hands of each person change
    motions: list[Motion]  # P motions, scaled to the bodies, anywhere on the floor
    script: Script | None  # The interaction, if any
    clearance: float  # Distance that people keep between their hips, m
    # motion, interaction: Configurations that the motions were drawn from
    motion: MotionConfig
    interaction: InteractionConfig
    # seed, clip: Seed of the data set and number of the clip
    seed: int
    clip: int


def sample_scene(
    config: SceneConfig,
    motion: MotionConfig,
    props: PropsConfig | None = None,
    interaction: InteractionConfig | None = None,
    *,
    seed: int,
    clip: int,
) -> SampledScene:
    """Draw the scene of one clip. The same arguments always give the same scene, independent of other clips.

    The user's meshes, `props`, replace `config.prop_kinds`. Raises ValueError if the configuration names something that
    does not exist, and FailedSimulation if the motions leave no space for each other.
    """
    rng = generator(seed, clip, Stream.SCENE)
    people = sample_people(config, motion, interaction, seed=seed, clip=clip, rng=rng)
    return lay_out(people, config, props, rng=rng)


def sample_people(
    config: SceneConfig,
    motion: MotionConfig,
    interaction: InteractionConfig | None = None,
    *,
    seed: int,
    clip: int,
    rng: np.random.Generator | None = None,
) -> People:
    """Draw the people of one clip and their motions, as in `sample_scene`.

    `rng` is the clip's random stream `Stream.SCENE`, which also draws the layout later; by default a new one.
    """
    interaction, rng = interaction or InteractionConfig(), rng or generator(seed, clip, Stream.SCENE)
    count = _count_participants(config, interaction, rng=rng)
    clearance = float(rng.uniform(*config.clearance))
    bodies, looks = _draw_people(count, config.children, rng=rng)
    if interaction.bystanders:
        # Bystanders have a separate stream, so the participants do not depend on their number.
        apart = generator(seed, clip, Stream.SCENE).spawn(_BYSTANDERS + 1)[_BYSTANDERS]
        others = _draw_people(interaction.bystanders, config.children, rng=apart)
        bodies, looks = bodies + others[0], looks + others[1]
    bodies = [replace(body, snug=config.solids is Solids.snug) for body in bodies]
    frames = planned_frames(config.seconds)
    motions, script = draw_motions(motion, interaction, bodies, frames, PLAN_FPS, config.radius, seed, clip)
    # Roles say how hands are shaped in physics; the hands of other people are random.
    of_hands = generator(seed, clip, Stream.SCENE).spawn(_HANDS + 1)[_HANDS]
    drawn = [sample_hands(rng=of_hands) for _ in looks]
    asked = [role.hands for role in script.roles] if script else []
    asked += [None] * (len(looks) - len(asked))
    looks = [replace(each, hands=a or d) for each, a, d in zip(looks, asked, drawn, strict=True)]
    of_wardrobe = generator(seed, clip, Stream.SCENE).spawn(_WARDROBE + 1)[_WARDROBE].spawn(len(looks))
    bags: list[tuple[str, ...]] = [()] * len(looks)
    if "bags" in config.wardrobe:
        together = len(script.roles) if script else 0
        alone = zip(bodies[together:], motions[together:], strict=True)
        bags = _bags(bodies[:together], motions[:together]) if together else []
        bags += [_bags([body], [motion])[0] for body, motion in alone]
    looks = [
        dressed(each, body, config.wardrobe, some, rng=apart)
        for each, body, some, apart in zip(looks, bodies, bags, of_wardrobe, strict=True)
    ]
    hands: list[tuple[HandChange, ...]] = [()] * len(looks)
    if config.hands is Hands.moving:
        hands = [
            sample_changes(first, motion.hands, frames, PLAN_FPS, rng=apart)
            for first, motion, apart in zip(drawn, motions, of_hands.spawn(len(looks)), strict=True)
        ]
    return People(bodies, looks, hands, motions, script, clearance, motion, interaction, seed, clip)


def _bags(bodies: list[Body], motions: list[Motion]) -> list[tuple[str, ...]]:
    """Return the kinds of bags, of `BAGS`, that P people have room for in motions around each other.

    Nobody lies on a bag, or comes near it to embrace; who sits or crouches has none at the hip.
    """
    poses = poses_of(tuple(bodies), motions)
    found: list[tuple[str, ...]] = []
    for person, body in enumerate(bodies):
        ahead, aside, up = (body.stature * each for each in _ON_BACK)
        at = poses.point(person, "chest", (ahead, aside, up))
        others = np.delete(poses.origins, person, 1).reshape(len(at), -1, 3)
        apart = np.linalg.norm(others - at[:, None], axis=-1).min(initial=np.inf)
        free = at[:, 2].min() > _OFF_FLOOR and apart > _ROOM
        tall = poses.origins[:, person, 0, 2].min() > _STANDING * body.hip_height
        found.append(BAGS if free and tall else BAGS[:1] if free else ())
    return found


def count_people(config: SceneConfig, interaction: InteractionConfig, *, seed: int, clip: int) -> int:
    """Return the number of people of a clip, including bystanders. The stream draws the participants' number first."""
    rng = generator(seed, clip, Stream.SCENE)
    return _count_participants(config, interaction, rng=rng) + interaction.bystanders


def people_range(config: SceneConfig, interaction: InteractionConfig) -> tuple[int, int]:
    """Return the least and greatest number of people of any clip, including bystanders."""
    least, greatest = interaction.participants(config.persons or None, USUAL_PERSONS)
    return least + interaction.bystanders, greatest + interaction.bystanders


def _count_participants(config: SceneConfig, interaction: InteractionConfig, *, rng: np.random.Generator) -> int:
    least, greatest = interaction.participants(config.persons or None, USUAL_PERSONS)
    count = int(rng.integers(*(config.persons or USUAL_PERSONS), endpoint=True))
    count = int(np.clip(count, least, greatest))
    if count + interaction.bystanders > MOST_PERSONS:
        raise ValueError(
            f"interaction.bystanders={interaction.bystanders}: a scene takes {MOST_PERSONS} people in all, and {count} "
            "take part"
        )
    return count


def _draw_people(count: int, children: float, *, rng: np.random.Generator) -> tuple[list[Body], list[PersonLooks]]:
    bodies = [sample_body(children, rng=rng) for _ in range(count)]
    return bodies, [sample_looks(body.feminine, child=body.age < ADULT_AGE, rng=rng) for body in bodies]


def lay_out(
    people: People,
    config: SceneConfig,
    props: PropsConfig | None = None,
    *,
    rng: np.random.Generator,
    clearance: float | None = None,
    cameras: Sequence[tuple[float, float]] = (),
) -> SampledScene:
    """Place people and props in a room, as in `sample_scene`.

    `rng` is the clip's random stream, after the people were drawn. `clearance` is by default that of the people. With
    `cameras` (x, y), m, props stand between them and people.
    """
    props = props or PropsConfig()
    seed, clip, clearance = people.seed, people.clip, people.clearance if clearance is None else clearance
    kinds = find_meshes(props.path) if props.path else config.prop_kinds
    sizes = {kind: prop_size(kind, props.scale, props.up) for kind in kinds}
    if people.script:
        placements, furniture, loads = _place_cast(people, people.script, config, clearance, rng=rng)
        clearance = min(clearance, people.script.clearance or clearance)
    else:
        placements, furniture, loads = place_persons(people.motions, config, clearance=clearance, rng=rng), [], []
    paths = [redirected_path(motion, *placed) for motion, placed in zip(people.motions, placements, strict=True)]
    for motion, placed in zip(people.motions, placements, strict=True):
        furniture += [PlacedProp(STOOL, (x, y), 0.0) for x, y, _ in stool_discs(motion, placed).tolist()]
    count = int(rng.integers(*config.props, endpoint=True))
    placed_props = place_props(
        count, sizes, np.stack(paths, axis=1), config, fps=PLAN_FPS, clearance=clearance,
        occupied=_occupied(furniture), rng=rng, cameras=cameras,
    )  # fmt: skip
    # The first child of the scene's stream paints textures (synth/scene/build.py); the second one draws colours.
    colours = generator(seed, clip, Stream.SCENE).spawn(2)[1]
    decor = sample_decor(arena_file(config.arena), randomize=config.randomize, rng=colours)

    def prop_spec(prop: PlacedProp, *how) -> PropSpec:
        return PropSpec(*prop, sample_tint(rng=colours) if config.randomize else None, *how)

    spec = SceneSpec(
        seed=seed,
        clip=clip,
        fps=float(config.fps),
        frames=config.frames,
        arena=room_name(config.arena),
        decor=decor,
        clearance=clearance,
        persons=tuple(
            PersonSpec(body, looks, motion.name, *placed, hands)
            for body, looks, motion, placed, hands in zip(
                people.bodies, people.looks, people.motions, placements, people.hands, strict=True
            )
        ),
        props=tuple(prop_spec(prop, props.scale, props.up) for prop in placed_props),
        motion=people.motion,
        interaction=people.interaction,
        furniture=tuple(prop_spec(prop) for prop in furniture),
        loads=tuple(loads),
        radius=float(config.radius),
        seconds=float(config.seconds),
    )
    return SampledScene(spec, _in_place(people.motions, placements))


def _place_cast(
    people: People, script: Script, config: SceneConfig, clearance: float, *, rng: np.random.Generator
) -> tuple[list[Placement], list[PlacedProp], list[Load]]:
    """Place the people of an interaction with its furniture and loads, and bystanders around them."""
    taking_part = people.motions[: len(script.roles)]
    placements, furniture, loads = place_script(script, taking_part, config, rng=rng)
    if bystanders := people.motions[len(taking_part) :]:
        paths = [redirected_path(motion, *at) for motion, at in zip(taking_part, placements, strict=True)]
        placements += place_persons(
            bystanders, config, clearance=max(clearance, _BYSTANDER_GAP), rng=rng.spawn(_PLACES + 1)[_PLACES],
            others=np.stack(paths, axis=1), occupied=_occupied(furniture),
        )  # fmt: skip
    return placements, furniture, loads


def load_motions(spec: SceneSpec) -> list[Motion]:
    """Draw the motions of a stored spec again: placed in the scene, scaled to the people's bodies, on the floor."""
    bodies = [person.body for person in spec.persons]
    where = spec.planned_frames, PLAN_FPS, spec.radius, spec.seed, spec.clip
    motions, _ = draw_motions(spec.motion, spec.interaction, bodies, *where)
    return _in_place(motions, [Placement(person.start, person.yaw, person.turn) for person in spec.persons])


def _in_place(motions: list[Motion], placements: Sequence[Placement]) -> list[Motion]:
    return [redirect(motion, *placed) for motion, placed in zip(motions, placements, strict=True)]


def _occupied(furniture: list[PlacedProp]) -> np.ndarray:
    """Return the (K, 3) discs that furniture covers on the floor, m."""
    discs = [placed_discs(prop_size(prop.kind).discs, prop.at, prop.yaw) for prop in furniture]
    return np.concatenate([np.empty((0, 3)), *discs])
