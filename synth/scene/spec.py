"""The specification of a clip's scene, as JSON, and the configuration that scenes are drawn from."""

import json
from dataclasses import asdict, dataclass, field

from dmae.data.clip import Clip
from dmae.data.typed import decode
from dmae.files.checks import check_numbers, check_rate
from dmae.files.structured import parse_json
from synth.interactions.registry import InteractionConfig
from synth.interactions.script import Load
from synth.motion.config import MotionConfig
from synth.people.body import MOST_PERSONS, Body
from synth.people.clothing import PersonLooks
from synth.people.hands import HandChange
from synth.rooms.config import MeshUp
from synth.rooms.decor import Colour, Decor
from synth.scene.config import MOST_CLIPS

_MOST_FRAMES, _FARTHEST = 1_000_000, 1000.0
"""Greatest number of frames of a clip, and greatest distance of people and props from the middle, m."""
PLAN_FPS = 25.0
"""Frame rate at which motion is planned and checked, 1/s. It does not depend on the frame rate of the clip."""
USUAL_PERSONS = (2, 4)
"""Least and greatest number of people if the configuration gives none."""


def planned_frames(seconds: float) -> int:
    """Return the number of frames of a planned motion."""
    return max(1, round(seconds * PLAN_FPS))


@dataclass(frozen=True)
class PersonSpec:
    """One person."""

    body: Body  # Proportions
    looks: PersonLooks  # Colours and clothes
    motion: str  # Descriptive name of the motion; no code depends on it
    start: tuple[float, float]  # x and y of the hips in the first frame, m
    yaw: float  # Turn of the motion about the vertical, rad
    turn: float  # Bend of the motion along a curve, rad/s
    # How the hands change; none for hands that keep the shapes of `looks`. Physics has these throughout.
    hands: tuple[HandChange, ...] = ()

    def __post_init__(self):
        check_numbers("person: start, m", self.start, _FARTHEST)
        check_numbers("person: yaw, rad, and turn, rad/s", (self.yaw, self.turn), _FARTHEST)


@dataclass(frozen=True)
class PropSpec:
    """A prop."""

    kind: str  # Name of a prop in `scenes/props/`, or path of an MJCF or mesh file
    at: tuple[float, float]  # x and y, m
    yaw: float  # Heading, rad
    tint: Colour | None = None  # RGB colour 0..1 of its material "tint"; None keeps the colour of the file
    # Unit and up axis of a mesh file, see `synth.rooms.config.PropsConfig`
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
    """

    # seed, clip: Seed of the data set and number of the clip
    seed: int
    clip: int
    # fps, frames: Frame rate and length of the clip
    fps: float
    frames: int
    # arena, decor: The room and its look
    arena: str
    decor: Decor
    clearance: float  # Distance that people keep between their hips, m
    persons: tuple[PersonSpec, ...]  # The people
    props: tuple[PropSpec, ...]  # Props that people keep clear of
    # motion, interaction: Configurations that the motions are drawn from
    motion: MotionConfig
    interaction: InteractionConfig = field(default_factory=InteractionConfig)
    # Props that belong to the interaction, or that people sit on; people do not keep clear of them
    furniture: tuple[PropSpec, ...] = ()
    loads: tuple[Load, ...] = ()  # Objects that hands carry
    radius: float = 1.9  # Greatest distance of hips from the middle, m
    seconds: float = field(kw_only=True)  # Length of the planned motion, s

    @property
    def planned_frames(self) -> int:
        """The number of frames of the planned motion, at `PLAN_FPS` frames/s."""
        return planned_frames(self.seconds)

    def to_json(self) -> str:
        """Return the spec as JSON text."""
        return json.dumps(asdict(self), default=lambda choice: choice.value)

    @classmethod
    def from_json(cls, text: str) -> "SceneSpec":
        """Return the spec from a text that `to_json` wrote; ValueError, which names the field, for others."""
        return decode(cls, parse_json(text))

    @classmethod
    def of(cls, clip: Clip) -> "SceneSpec":
        """Return the spec in the provenance of a simulated clip; ValueError if it has none, or a wrong one."""
        if "spec" not in clip.provenance:
            raise ValueError(f"clip {clip.id!r} has no scene in its provenance")
        return cls.from_json(json.dumps(clip.provenance["spec"]))

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
