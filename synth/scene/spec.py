"""The specification of a clip's scene, as JSON, and the configuration that scenes are drawn from."""

import json
from dataclasses import asdict, dataclass, field

import numpy as np

from dmae.data.json_values import decode
from dmae.files.checks import check_numbers, check_rate
from dmae.files.structured import parse_json
from synth.interactions.registry import InteractionConfig
from synth.interactions.script import Load
from synth.motion.source import MotionConfig
from synth.people.body import Body
from synth.people.clothing import PersonLooks
from synth.people.mjcf import MOST_PERSONS
from synth.rooms.decor import Colour, Decor
from synth.rooms.props import MeshUp

_MOST_FRAMES, _FARTHEST = 1_000_000, 1000.0
"""Greatest number of frames of a clip, and greatest distance of people and props from the middle, m."""
MOST_CLIPS = 1_000_000_000
"""Greatest number of clips of a data set."""
PLAN_FPS = 25.0
"""Frame rate at which motion is planned and checked, 1/s. It does not depend on the frame rate of the clip."""
USUAL_PERSONS = (2, 4)
"""Least and greatest number of people if the configuration gives none."""
_LONGEST, _FASTEST = 3600.0, 1000.0
"""Longest clip, s, and highest frame rate, 1/s."""


@dataclass(frozen=True)
class SceneConfig:
    """Distributions from which scenes are drawn. Pairs are the least and the greatest value.

    Attributes:
        arena: Room of `scenes/`, or path of an MJCF file.
        persons: Number of people; with an interaction, of its participants. By default 2 to 4, within the numbers that
            the interaction allows.
        children: Share of children, 4 to 17 years old, among the people.
        seconds: Length of a clip, s.
        fps: Frames per second of a clip. The same seed gives the same motion at any rate.
        middle: x, y of the point around which people and props are placed, m.
        radius: Greatest distance of people's hips from the middle, m; motions that cannot be adapted may reach 0.3 m
            farther.
        gathering: Distance from the middle through which people pass at some time, m (standard deviation). With small
            values people meet and hide each other.
        clearance: Distance that people keep between their hips, m; one value per clip. Below 0.5 they touch.
        props: Number of props, where there is space.
        prop_kinds: Kinds of props: of `scenes/props/`, or paths of MJCF files.
        randomize: Whether floor, walls, light and colours are random in each clip; otherwise those of the room.
    """

    arena: str = "studio"
    persons: list[int] = field(default_factory=list)
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
        for name, unit in (("persons", "people"), ("clearance", "m"), ("props", "props")):
            pair = getattr(self, name)
            if name == "persons" and not pair:
                continue
            if len(pair) != 2 or not 0 <= pair[0] <= pair[1] < np.inf:
                raise ValueError(f"scene.{name}: expected [least, greatest] {unit}, not below 0, got {list(pair)}")
        if self.persons and not 1 <= self.persons[0] <= self.persons[1] <= MOST_PERSONS:
            raise ValueError(f"scene.persons: expected 1 to {MOST_PERSONS} people, got {list(self.persons)}")
        for name, unit, most in (
            ("seconds", "s", _LONGEST),
            ("fps", "frames per second", _FASTEST),
            ("radius", "m", 1000.0),
            ("gathering", "m", 1000.0),
        ):
            if not 0 < getattr(self, name) <= most:
                raise ValueError(
                    f"scene.{name}: expected more than 0 and at most {most:g} {unit}, got {getattr(self, name)}"
                )
        if not 0 <= self.children <= 1:
            raise ValueError(f"scene.children: expected a share from 0 to 1, got {self.children}")
        if len(self.middle) != 2 or not np.isfinite(self.middle).all():
            raise ValueError(f"scene.middle: expected x and y, m, got {list(self.middle)}")
        if self.props[1] and not self.prop_kinds:
            raise ValueError(f"scene.prop_kinds is empty, but scene.props asks for up to {self.props[1]}")

    @property
    def frames(self) -> int:
        """The number of frames of a clip."""
        return max(1, round(self.seconds * self.fps))


def planned_frames(seconds: float) -> int:
    """Return the number of frames of a planned motion."""
    return max(1, round(seconds * PLAN_FPS))


@dataclass(frozen=True)
class PersonSpec:
    """One person.

    Attributes:
        body: Proportions.
        looks: Colours and clothes.
        motion: Descriptive name of the motion; no code depends on it.
        start: x and y of the hips in the first frame, m.
        yaw: Turn of the motion about the vertical, rad.
        turn: Bend of the motion along a curve, rad/s.
    """

    body: Body
    looks: PersonLooks
    motion: str
    start: tuple[float, float]
    yaw: float
    turn: float

    def __post_init__(self):
        check_numbers("person: start, m", self.start, _FARTHEST)
        check_numbers("person: yaw, rad, and turn, rad/s", (self.yaw, self.turn), _FARTHEST)


@dataclass(frozen=True)
class PropSpec:
    """A prop.

    Attributes:
        kind: Name of a prop in `scenes/props/`, or path of an MJCF or mesh file.
        at: x and y, m.
        yaw: Heading, rad.
        tint: RGB colour 0..1 of its material "tint"; None keeps the colour of the file.
        scale, up: Unit and up axis of a mesh file, see `synth.rooms.props.PropsConfig`.
    """

    kind: str
    at: tuple[float, float]
    yaw: float
    tint: Colour | None = None
    scale: float = 1.0
    up: MeshUp = MeshUp.auto

    def __post_init__(self):
        check_numbers(f"prop {self.kind!r:.40}: at, m, and yaw, rad", (*self.at, self.yaw), _FARTHEST)
        check_numbers(f"prop {self.kind!r:.40}: scale", self.scale, 1e6, 1e-9)
        if self.tint is not None:
            check_numbers(f"prop {self.kind!r:.40}: tint", self.tint, 1, 0)


@dataclass(frozen=True)
class SceneSpec:
    """The specification of the scene of a clip. `to_json` writes it, and `from_json` reads the same scene.

    The motions themselves are not stored: `synth.scene.sampling.load_motions` draws them again from `motion`,
    `interaction`, `seed` and `clip`.

    Attributes:
        seed, clip: Seed of the data set and number of the clip.
        fps, frames: Frame rate and length of the clip.
        arena, decor: The room and its look.
        clearance: Distance that people keep between their hips, m.
        persons: The people.
        props: Props that people keep clear of.
        motion, interaction: Configurations that the motions are drawn from.
        furniture: Props that belong to the interaction, or that people sit on; people do not keep clear of them.
        loads: Objects that hands carry.
        radius: Greatest distance of hips from the middle, m.
        seconds: Length of the planned motion, s; None for `frames / fps`, as in clips of older versions.
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
    seconds: float | None = None

    @property
    def planned_frames(self) -> int:
        """The number of frames of the planned motion, at `PLAN_FPS` frames/s."""
        return planned_frames(self.frames / self.fps if self.seconds is None else self.seconds)

    def to_json(self) -> str:
        """Return the spec as JSON text."""
        return json.dumps(asdict(self), default=lambda choice: choice.value)

    @classmethod
    def from_json(cls, text: str) -> "SceneSpec":
        """Return the spec from a text that `to_json` wrote.

        Raises:
            ValueError: the text is no spec; the message names the field.
        """
        return decode(cls, parse_json(text))

    def __post_init__(self):
        check_rate("SceneSpec.fps", self.fps)
        if not 1 <= self.frames <= _MOST_FRAMES or self.seed < 0 or not 0 <= self.clip < MOST_CLIPS:
            raise ValueError(
                f"SceneSpec: expected 1 to {_MOST_FRAMES} frames, a seed from 0 on, and a clip from 0 to "
                f"{MOST_CLIPS - 1}, found {self.frames:.4g}, {self.seed:.4g} and {self.clip:.4g}"
            )
        if not len(self.persons) <= MOST_PERSONS:
            raise ValueError(f"SceneSpec.persons: expected at most {MOST_PERSONS}, found {len(self.persons)}")
        check_numbers("SceneSpec.radius, m", self.radius, _FARTHEST, 0)
        check_numbers("SceneSpec.clearance, m", self.clearance, _FARTHEST, 0)


@dataclass(frozen=True)
class Layout:
    """Values for the placement of people and props, which replace the same values of `SceneConfig`.

    Attributes:
        draw: Number of the draw; each draw has a separate random stream.
        gathering, clearance: The same as in `SceneConfig`, with one value each, m.
        props: Number of props.
        cameras: (x, y) of cameras, m. Props stand between these cameras and people.
    """

    draw: int
    gathering: float
    clearance: float
    props: int
    cameras: tuple[tuple[float, float], ...]
