"""Where motion comes from: recordings, or procedural people and their actions."""

from dataclasses import dataclass, field
from enum import Enum

import numpy as np

from dmae.data.typed import Configuration
from synth.checks import check_pairs, check_range
from synth.motion.readers import reader

PROCEDURAL = "procedural"
"""The kind of motion that is generated, not read from files."""
RECORDED = "recorded"
"""The kind of recorded motion of any format."""
ACTIONS = ("walk", "turn", "stand", "reach", "wave", "bend", "crouch", "lift", "sit", "kick", "punch", "dance")
"""Names of all actions."""
WEIGHTS = dict.fromkeys(ACTIONS, 1.0) | {
    "walk": 28.0, "turn": 0.5, "crouch": 0.5, "kick": 4.0, "punch": 2.5, "dance": 6.0
}  # fmt: skip
"""Default relative frequency of each action. With it, people move about as much as in the CMU database."""


@dataclass(frozen=True)
class ProceduralConfig(Configuration):
    """Motion of procedural people who walk or stand throughout. With `motion.actions`, only `speed` applies."""

    standing: float = 0.25
    """Share, 0 to 1, of the people who stand; the others walk."""
    speed: list[float] = field(default_factory=lambda: [1.0, 1.7])
    """m/s, least and greatest walking speed."""
    straight: float = 0.25
    """Share, 0 to 1, of the walks that go straight ahead; half of the others are circles, half are winding."""
    radius: list[float] = field(default_factory=lambda: [1.5, 6.0])
    """m, least and greatest radius of turns."""
    gesture: float = 0.5
    """Share, 0 to 1, of the people who reach out or wave once."""

    def __post_init__(self):
        super().__post_init__()
        check_range("motion.procedural", self, 0, 1, "standing", "straight", "gesture")
        # Beyond these bounds the published kinematics no longer hold, or feet cross on the inside of the turn.
        check_pairs("motion.procedural", self, 0.6, 1.7, "speed", unit=" m/s")
        check_pairs("motion.procedural", self, 1, np.inf, "radius", unit=" m")


class UpAxis(Enum):
    """Which axis of a recording's world points up."""

    auto = "auto"
    """As the format has it: y in BVH and AMC, z in AMASS's npz; in C3D as the file says."""
    x = "x"
    y = "y"
    z = "z"


@dataclass(frozen=True)
class MotionConfig(Configuration):
    """Motion of one person."""

    kind: str = PROCEDURAL
    """`procedural`; or the format of recordings, `recorded` for all formats, or `<module>:<function>`, a reader of your
    own."""
    path: str | None = field(default=None, metadata={"reads": "path"})
    """For recorded motion: a file; a folder with files of the format at any depth; or a list of takes, `<name>.tsv`, as
    `synth split` writes it. Takes of folders and lists that cannot be read are left out with a warning."""
    sets: list[str] = field(default_factory=list)
    """Sets of a list of takes that are used, such as [train]; all if empty."""
    fps: float | None = None
    """Frames per second of the recordings, if files state a wrong rate. Known wrong rates of takes of the CMU database
    are corrected automatically."""
    unit: float | None = None
    """Metres per unit of length in the recordings, if the length of the legs does not determine it."""
    up: UpAxis = UpAxis.auto
    """Axis of the recordings' world that points up."""
    mapping: str | None = field(default=None, metadata={"reads": "path"})
    """YAML file of lines `their name: our name` for joints or markers with other names. Our names are those of any
    known skeleton, or `pelvis spine chest head`, and `l_` and `r_` before `upper_arm forearm hand knuckle thigh shin
    foot`."""
    actions: list[str] = field(default_factory=lambda: list(ACTIONS))
    """Actions of procedural people, performed one after another. If empty, people only walk or stand, as set by
    `motion.procedural`; otherwise only its speed applies."""
    weights: dict[str, float] = field(default_factory=lambda: dict(WEIGHTS))
    """Relative frequency of each action, 1 if it is not named."""
    procedural: ProceduralConfig = field(default_factory=ProceduralConfig)
    """Procedural people who only walk or stand."""

    def __post_init__(self):
        super().__post_init__()
        reader.check(self.kind, PROCEDURAL, RECORDED)
        for what in ("actions", "weights"):
            unknown = ", ".join(repr(name) for name in getattr(self, what) if name not in ACTIONS)
            if unknown:
                raise ValueError(f"motion.{what}: expected some of {', '.join(ACTIONS)}; found {unknown}")
        for name, weight in self.weights.items():
            if not 0 <= weight < np.inf:
                raise ValueError(f"motion.weights.{name}: expected 0 or more, found {weight}")
        if self.actions and not any(self.weights.get(name, 1) for name in self.actions):
            raise ValueError(f"motion.weights: expected one above 0 among motion.actions, {self.actions}; all are 0")
        check_range("motion", self, 0, np.inf, "fps", "unit", above=True)


@dataclass(frozen=True)
class ReadingConfig(Configuration):
    """Overrides for takes with missing or wrong values in their files; as in `synth.motion.source.MotionConfig`."""

    fps: float | None = None
    """Frames per second, where the files state a wrong one."""
    unit: float | None = None
    """Metres per unit of length in the files, if the length of the legs does not determine it."""
    up: UpAxis = UpAxis.auto
    """Axis of the files' world that points up."""
    mapping: str | None = field(default=None, metadata={"reads": "path"})
    """YAML file of lines `their name: our name` for joints or markers with other names."""
