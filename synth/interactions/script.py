"""The parts of an interaction: each person's path and gaze, furniture, carried objects, and reaches of the hands."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from synth.motion.motion import Motion
from synth.people.body import Body, segment_origins
from synth.people.segments import SEGMENTS
from synth.rooms.props import PlacedProp

STOOL = "stool"
"""The prop that people sit on."""


@dataclass(frozen=True)
class Cast:
    """The people who take part, and the frames of the clip.

    Attributes:
        bodies: One for each of P people.
        seconds: (F,) time of each frame, s.
        fps: Frames per second.
        radius: Greatest distance of hips from the origin, m.
    """

    bodies: tuple[Body, ...]
    seconds: np.ndarray
    fps: float
    radius: float


@dataclass(frozen=True)
class Role:
    """The part of one person.

    Attributes:
        path: (F, 3) x, y of the hips, m, and heading, rad, around the origin.
        walks: Whether a walk from the motion source is bent along the path at its own pace; otherwise the legs follow
            the path step by step.
        hips: (F,) greatest height of the hips above the floor in sitting or crouching, m.
        ahead: Distance of the feet ahead of the hips in sitting, m.
        gaze: (F,) index of the person looked at; -1 leaves the head to the motion.
        lean: (F,) angle by which the trunk is bent forward, rad.
        hands: Shapes of the left and the right hand, of `synth.people.clothing.HANDS`; None draws them.
    """

    path: np.ndarray
    walks: bool = False
    hips: np.ndarray | None = None
    ahead: float = 0.0
    gaze: np.ndarray | None = None
    lean: np.ndarray | None = None
    hands: tuple[str, str] | None = None


@dataclass(frozen=True)
class Reach:
    """A hand that goes to a point.

    Attributes:
        person: Index of the person.
        side: `l` or `r`.
        share: (F,) weight of the reach, 0 to 1; the rest is the arm's own motion.
        palm: (F, 3) target of the skin of the palm, m.
        normal: (F, 3) direction that the palm faces at the target.
        elbow: Direction of the elbow in the chest's frame, y outward.
        straight: Whether the wrist stays straight; otherwise it bends so that the palm lies on the touched surface.
    """

    person: int
    side: str
    share: np.ndarray
    palm: np.ndarray
    normal: np.ndarray
    elbow: tuple[float, float, float] = (-0.35, 0.45, -1.0)
    straight: bool = False


@dataclass(frozen=True)
class Poses:
    """The people's segments before the hands reach.

    Attributes:
        origins: (F, P, 16, 3) joints of `SEGMENTS`, m.
        rotations: (F, P, 16, 3, 3) their orientations.
    """

    origins: np.ndarray
    rotations: np.ndarray

    def point(self, person: int, segment: str, at: tuple[float, float, float]) -> np.ndarray:
        """Return the (F, 3) world position of a point `at` of a segment's frame, m."""
        index = SEGMENTS.index(segment)
        return self.origins[:, person, index] + self.rotations[:, person, index] @ np.array(at)

    def axis(self, person: int, segment: str, along: tuple[float, float, float]) -> np.ndarray:
        """Return the (F, 3) world direction of the direction `along` of a segment's frame."""
        return self.rotations[:, person, SEGMENTS.index(segment)] @ np.array(along)


def poses_of(bodies: tuple[Body, ...], motions: list[Motion]) -> Poses:
    """Return the poses of P bodies in their motions."""
    origins = [
        segment_origins(body, motion.root, motion.rotations) for body, motion in zip(bodies, motions, strict=True)
    ]
    return Poses(np.stack(origins, axis=1), np.stack([motion.rotations for motion in motions], axis=1))


@dataclass(frozen=True)
class Grip:
    """A grip: both hands of a person hold an object from `begin` to `end`, s, at `height` above its middle, m."""

    person: int
    begin: float
    end: float
    height: float


@dataclass(frozen=True)
class Load:
    """An object that hands carry: kind as in `scenes/props/`.

    Attributes:
        at, yaw: Its middle in the first frame, m, and heading, rad.
        half_width: Distance from its middle to the palms that hold it left and right, m.
        grips: When each person holds it.
    """

    kind: str
    at: tuple[float, float, float]
    yaw: float
    half_width: float
    grips: tuple[Grip, ...]


@dataclass(frozen=True)
class Script:
    """An interaction around the origin.

    Attributes:
        roles: One for each person.
        clearance: Greatest distance that people keep between their hips, m; None for the clearance of the scene.
        furniture: The props that it needs.
        loads: The objects that are carried.
        paired: Whether recordings of two people together, if there are any, are played unchanged.
        reaches: Function from the people's poses to the reaches of their hands.
    """

    roles: tuple[Role, ...]
    clearance: float | None = None
    furniture: tuple[PlacedProp, ...] = ()
    loads: tuple[Load, ...] = ()
    paired: bool = False
    reaches: Callable[[Poses], list[Reach]] = field(default=lambda poses: [])
