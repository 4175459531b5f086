"""What happens in a clip, decided from a configuration and a seed: who, in what clothes, where, among what."""

import json
from dataclasses import asdict, dataclass, field

import numpy as np

from dmae.rng import Stream, generator
from synth.arena import arena_file, prop_file
from synth.body import Body
from synth.looks import Looks, sample_looks
from synth.motion import Motion
from synth.motion.source import MotionConfig, load_motion
from synth.person import MOST_PERSONS
from synth.placement import place_persons, place_props
from synth.plan import fit, lead
from synth.revive import revive


@dataclass(frozen=True)
class SceneConfig:
    """What scenes are drawn from. Pairs are the least and the greatest.

    Attributes:
        arena: Room in `scenes/`, or the path of an MJCF file.
        persons: How many people.
        seconds: Length of a clip.
        fps: Frames per second of a clip.
        radius: How far from the vertical through the origin people's hips stray, m; a motion that cannot be bent to
            fit may lead 0.3 m farther.
        gathering: How near the middle everybody comes at some time, m (standard deviation). Small values make
            people meet and hide each other.
        clearance: Distance that people keep between their hips, m; one value a clip. Below 0.5 they touch.
        props: How many things stand about, room permitting.
        prop_kinds: Which things: of `scenes/props/`, or paths of MJCF files.
    """

    arena: str = "studio"
    persons: list[int] = field(default_factory=lambda: [2, 4])
    seconds: float = 5.0
    fps: float = 25.0
    radius: float = 1.9
    gathering: float = 0.5
    clearance: list[float] = field(default_factory=lambda: [0.35, 0.65])
    props: list[int] = field(default_factory=lambda: [0, 3])
    prop_kinds: list[str] = field(default_factory=lambda: ["chair", "table", "screen", "plant", "crate", "drum"])

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
    """A thing that stands about: its MJCF file, place (m), heading (rad) and RGB colour."""

    kind: str
    at: tuple[float, float]
    yaw: float
    tint: tuple[float, float, float]


@dataclass(frozen=True)
class Finish:
    """What a floor or wall is covered with: a pattern of `synth.textures` and its two RGB colours."""

    pattern: str
    colours: tuple[tuple[float, float, float], tuple[float, float, float]]


@dataclass(frozen=True)
class SceneSpec:
    """A clip's scene, whole: JSON out of `to_json`, and the same scene back out of `from_json`.

    Motions are not held, but drawn again from `motion`, `seed` and `clip`: see `load_motions`.
    """

    seed: int
    clip: int
    fps: float
    frames: int
    arena: str
    floor: Finish
    wall: Finish
    clearance: float
    persons: tuple[PersonSpec, ...]
    props: tuple[PropSpec, ...]
    motion: MotionConfig

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


_FLOORS = (
    ("planks", ((0.58, 0.42, 0.28), (0.42, 0.28, 0.17))),
    ("planks", ((0.66, 0.58, 0.47), (0.52, 0.44, 0.34))),
    ("tiles", ((0.66, 0.66, 0.64), (0.50, 0.50, 0.49))),
    ("carpet", ((0.36, 0.39, 0.44), (0.26, 0.28, 0.33))),
    ("carpet", ((0.50, 0.45, 0.40), (0.38, 0.34, 0.30))),
)
_WALLS = ((0.82, 0.81, 0.77), (0.72, 0.77, 0.80), (0.80, 0.76, 0.68), (0.70, 0.74, 0.68), (0.62, 0.62, 0.64))
_TINTS = ((0.55, 0.42, 0.29), (0.24, 0.36, 0.52), (0.58, 0.20, 0.18), (0.30, 0.44, 0.34), (0.78, 0.74, 0.66),
          (0.35, 0.35, 0.38), (0.80, 0.60, 0.24))  # fmt: skip


def sample_spec(config: SceneConfig, motion: MotionConfig, *, seed: int, clip: int) -> SceneSpec:
    """Draw the scene of one clip. The same arguments give the same scene, whatever other clips are drawn.

    Raises:
        ValueError: the configuration asks for what is not there, or for people whose motions leave no room for
            each other; the message says what to change.
    """
    rng = generator(seed, clip, Stream.SCENE)
    arena, kinds = arena_file(config.arena), {kind: prop_file(kind) for kind in config.prop_kinds}
    count = int(rng.integers(config.persons[0], config.persons[1], endpoint=True))
    clearance = float(rng.uniform(*config.clearance))
    bodies = [sample_body(rng=rng) for _ in range(count)]
    looks = [sample_looks(body.feminine, rng=rng) for body in bodies]
    frames = max(1, round(config.seconds * config.fps))
    motions = _draw(motion, bodies, frames, config.fps, seed, clip)
    placements = place_persons(
        motions,
        arena,
        radius=config.radius,
        gathering=config.gathering,
        clearance=clearance,
        rng=rng,
    )
    paths = np.stack([lead(m, *placed).root[:, :2] for m, placed in zip(motions, placements, strict=True)], axis=1)
    props = place_props(
        int(rng.integers(config.props[0], config.props[1], endpoint=True)),
        kinds,
        paths,
        arena,
        fps=config.fps,
        radius=config.radius,
        clearance=clearance,
        rng=rng,
    )
    floor, wall = _FLOORS[rng.integers(len(_FLOORS))], _WALLS[rng.integers(len(_WALLS))]
    return SceneSpec(
        seed=seed,
        clip=clip,
        fps=float(config.fps),
        frames=frames,
        arena=config.arena,
        floor=Finish(*floor),
        wall=Finish("plaster", (wall, tuple(round(0.9 * c, 3) for c in wall))),
        clearance=clearance,
        persons=tuple(
            PersonSpec(body, look, m.name, *placed)
            for body, look, m, placed in zip(bodies, looks, motions, placements, strict=True)
        ),
        props=tuple(PropSpec(kind, at, yaw, _TINTS[rng.integers(len(_TINTS))]) for kind, at, yaw in props),
        motion=motion,
    )


def sample_body(*, rng: np.random.Generator) -> Body:
    """Somebody: statures and body mass indices of adults (NCD-RisC 2016, roughly, over the world)."""
    feminine = float(rng.random() < 0.5)
    stature = rng.normal(1.75 - 0.12 * feminine, 0.065)
    index = rng.normal(24 - feminine, 3.0)
    stature, index = np.clip(stature, 1.48, 2.02), np.clip(index, 18, 33)
    legs, arms = np.clip(rng.normal(1, 0.02, 2), 0.95, 1.05)
    mass = index * stature**2
    return Body(*(round(float(value), 4) for value in (stature, mass, feminine, legs, arms)))


def load_motions(spec: SceneSpec) -> list[Motion]:
    """Each person's motion where the spec puts it, at the size of the person's body, on the floor."""
    bodies = [person.body for person in spec.persons]
    motions = _draw(spec.motion, bodies, spec.frames, spec.fps, spec.seed, spec.clip)
    return [lead(m, p.start, p.yaw, p.turn) for m, p in zip(motions, spec.persons, strict=True)]


def _draw(config: MotionConfig, bodies: list[Body], frames: int, fps: float, seed: int, clip: int) -> list[Motion]:
    rng = generator(seed, clip, Stream.MOTION)
    return [fit(load_motion(config, seconds=frames / fps, fps=fps, rng=rng), body) for body in bodies]
