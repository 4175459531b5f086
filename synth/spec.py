"""What happens in a clip, decided from a configuration and a seed: who, in what clothes, where, among what."""

import json
from dataclasses import asdict, dataclass, field
from functools import lru_cache

import numpy as np

from dmae.rng import Stream, generator
from synth.anthropometry import sample_body
from synth.arena import arena_file
from synth.body import GROWN, Body
from synth.decor import Colour, Decor, sample_decor, sample_tint
from synth.interactions import INTERACTIONS, InteractionConfig, InteractionKind
from synth.interactions.perform import draw_motions
from synth.interactions.script import Load, Script
from synth.looks import Looks, sample_looks
from synth.motion import Motion
from synth.motion.source import MotionConfig
from synth.person import MOST_PERSONS
from synth.placement import place_persons, place_props, place_script, placed_discs, stools
from synth.plan import lead, led_path
from synth.props import PropsConfig, Up, find_meshes, prop_space
from synth.revive import revive


@dataclass(frozen=True)
class SceneConfig:
    """What scenes are drawn from. Pairs are the least and the greatest.

    Attributes:
        arena: Room in `scenes/`, or the path of an MJCF file.
        persons: How many people.
        children: Share of children, 4 to 17 years old, among them.
        seconds: Length of a clip.
        fps: Frames per second of a clip.
        middle: x, y of where people gather and things stand about, m.
        radius: How far from the vertical through the middle people's hips stray, m; a motion that cannot be bent to
            fit may lead 0.3 m farther.
        gathering: How near the middle everybody comes at some time, m (standard deviation). Small values make
            people meet and hide each other.
        clearance: Distance that people keep between their hips, m; one value a clip. Below 0.5 they touch.
        props: How many things stand about, room permitting.
        prop_kinds: Which things: of `scenes/props/`, or paths of MJCF files.
        randomize: Whether floor, walls, light and the colours of things are drawn, or the room's own.
    """

    arena: str = "studio"
    persons: list[int] = field(default_factory=lambda: [2, 4])
    children: float = 0.0
    seconds: float = 5.0
    fps: float = 25.0
    middle: list[float] = field(default_factory=lambda: [0.0, 0.0])
    radius: float = 1.9
    gathering: float = 0.5
    clearance: list[float] = field(default_factory=lambda: [0.35, 0.65])
    props: list[int] = field(default_factory=lambda: [0, 3])
    prop_kinds: list[str] = field(default_factory=lambda: ["chair", "table", "screen", "plant", "crate", "drum"])
    randomize: bool = True

    def __post_init__(self):
        for name in ("persons", "clearance", "props"):
            pair = getattr(self, name)
            if len(pair) != 2 or not 0 <= pair[0] <= pair[1]:
                raise ValueError(f"scene.{name}: expected [least, greatest], not below 0, got {list(pair)}")
        if not 1 <= self.persons[0] <= self.persons[1] <= MOST_PERSONS:
            raise ValueError(f"scene.persons: expected 1 to {MOST_PERSONS} people, got {list(self.persons)}")
        for name in ("seconds", "fps", "radius", "gathering"):
            if not getattr(self, name) > 0:
                raise ValueError(f"scene.{name}: expected more than 0, got {getattr(self, name)}")
        if not 0 <= self.children <= 1:
            raise ValueError(f"scene.children: expected a share from 0 to 1, got {self.children}")
        if len(self.middle) != 2 or not np.isfinite(self.middle).all():
            raise ValueError(f"scene.middle: expected x and y, m, got {list(self.middle)}")
        if self.props[1] and not self.prop_kinds:
            raise ValueError(f"scene.prop_kinds is empty, but scene.props asks for up to {self.props[1]}")


@dataclass(frozen=True)
class PersonSpec:
    """One person.

    Attributes:
        body: Proportions.
        looks: Colours and clothes.
        motion: Name of the motion, for people to read.
        start: Hips in the first frame, m.
        yaw: Turns the motion about the vertical, rad.
        turn: Bends it along a curve, rad/s.
    """

    body: Body
    looks: Looks
    motion: str
    start: tuple[float, float]
    yaw: float
    turn: float


@dataclass(frozen=True)
class PropSpec:
    """A thing that stands about.

    Attributes:
        kind: One of `scenes/props/`, or the path of an MJCF or mesh file.
        at: Place, m.
        yaw: Heading, rad.
        tint: RGB colour 0..1 of what of it takes any; None for its own.
        scale, up: How a mesh file is read, see `synth.props.PropsConfig`.
    """

    kind: str
    at: tuple[float, float]
    yaw: float
    tint: Colour | None = None
    scale: float = 1.0
    up: Up = Up.auto


@dataclass(frozen=True)
class SceneSpec:
    """A clip's scene, whole: JSON out of `to_json`, and the same scene back out of `from_json`.

    Motions are not held, but drawn again from `motion`, `interaction`, `seed` and `clip`: see `load_motions`.

    Attributes:
        furniture: Things that belong to the interaction; nobody keeps away from them as from `props`.
        loads: Things that hands carry.
        radius: Within which the interaction takes place, m.
    """

    seed: int
    clip: int
    fps: float
    frames: int
    arena: str
    decor: Decor
    clearance: float
    persons: tuple[PersonSpec, ...]
    props: tuple[PropSpec, ...]
    motion: MotionConfig
    interaction: InteractionConfig = field(default_factory=InteractionConfig)
    furniture: tuple[PropSpec, ...] = ()
    loads: tuple[Load, ...] = ()
    radius: float = 1.9

    def to_json(self) -> str:
        """The spec as JSON text."""
        return json.dumps(asdict(self), default=lambda kind: kind.value)

    @classmethod
    def from_json(cls, text: str) -> "SceneSpec":
        """The spec that `to_json` wrote.

        Raises:
            ValueError: the text is no spec; the message names the field.
        """
        return revive(cls, json.loads(text))


@dataclass(frozen=True)
class Layout:
    """How a scene is laid out, in place of what `SceneConfig` says of the same.

    Attributes:
        draw: Number of the draw; each has another outcome.
        gathering, clearance: As in `SceneConfig`; one clearance.
        props: How many things.
        before: (x, y) of cameras that things are put before, m.
    """

    draw: int
    gathering: float
    clearance: float
    props: int
    before: tuple[tuple[float, float], ...]


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
    gathering, furniture, loads = (layout or config).gathering, [], []
    if script:
        clearance = min(clearance, script.clearance or clearance)
        where = {"middle": config.middle, "radius": config.radius, "gathering": gathering}
        placements, furniture, loads = place_script(script, motions, arena, **where, rng=rng)
    else:
        placements = place_persons(
            motions,
            arena,
            middle=config.middle,
            radius=config.radius,
            gathering=gathering,
            clearance=clearance,
            rng=rng,
        )
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
