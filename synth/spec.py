"""What happens in a clip, decided from a configuration and a seed: who, in what clothes, where, among what."""

import json
from dataclasses import asdict, dataclass, field

import numpy as np

from synth.body import Body
from synth.decor import Colour, Decor
from synth.interactions import InteractionConfig
from synth.interactions.script import Load
from synth.looks import Looks
from synth.motion.source import MotionConfig
from synth.person import MOST_PERSONS
from synth.props import Up
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
