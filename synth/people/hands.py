"""Hands: their shapes, how they change in a clip, and the bones by which fingers follow."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from dmae.files.checks import check_numbers
from synth.people.body import SEGMENTS, SIDES
from synth.people.clothing import HANDS

FINGERS = ("thumb", "index", "middle", "ring", "little")
FINGER_BONES = tuple(f"{side}_hand {finger} {bone}" for side in SIDES for finger in FINGERS for bone in (1, 2, 3))
"""Names of the bones of fingers, from the palm outwards."""

# Shapes; a clasp is a grip around another hand. For each finger from the index finger on, degrees of its three joints
# towards the palm; and of the thumb's.
_CURLS = {
    "relaxed": ((18, 22, 14), (24, 26, 16), (28, 28, 18), (30, 30, 20)),
    "open": ((0, 2, 2),) * 4,
    "grip": ((55, 60, 35), (58, 62, 35), (60, 62, 38), (60, 62, 38)),
    "fist": ((82, 98, 60), (84, 100, 60), (86, 100, 60), (86, 98, 60)),
    "point": ((4, 6, 4), (82, 98, 60), (84, 100, 60), (86, 98, 60)),
    "clasp": ((38, 40, 24), (42, 42, 24), (44, 44, 26), (46, 44, 26)),
}
_THUMBS = {
    "relaxed": (8, 10, 10),
    "open": (-10, 0, 0),
    "grip": (20, 25, 25),
    "fist": (10, 20, 45),
    "point": (10, 20, 45),
    "clasp": (10, 14, 16),
}
_SPREADS = {"relaxed": 0.3, "open": 0.4, "grip": 0.2, "fist": 0.2, "point": 0.3, "clasp": 0.2}
"""Angles of the other fingers from the middle one, relative to the assets, whose fingers are spread wide."""


def _shapes(thumbs: dict[str, tuple[int, int, int]]) -> dict[str, np.ndarray]:
    return {
        name: np.column_stack([np.radians([thumbs[name], *_CURLS[name]]), np.full(len(FINGERS), _SPREADS[name])])
        for name in HANDS
    }


SHAPES = _shapes(_THUMBS)
"""(5, 4) for each of `HANDS`: bends of the three joints of each finger, rad, and the spread."""
STILL = _shapes(_THUMBS | {"fist": (30, 38, 40), "point": (30, 35, 40)})
"""The same for hands that keep one shape. Their thumbs are inside fists, as in the clips of benchmarks."""


class Fingers(NamedTuple):
    """The bones of the fingers of both hands in a pose with nearly straight fingers, the bind pose."""

    joints: np.ndarray  # (2, 5, 3, 3) where each bone begins, m
    axes: np.ndarray  # (2, 5, 3) unit axes about which fingers bend towards the palm
    down: np.ndarray  # (2, 3) unit vectors from the back of the hand to the palm
    apart: np.ndarray  # (2, 5) angle of each finger from the middle one about `down`, rad
    # bent: (2, 5, 3, 4) by which each joint is bent: cross and dot product of the bones at it
    bent: np.ndarray

    @classmethod
    def of(cls, joints: np.ndarray) -> "Fingers":
        """Return the bones from the joints (56, 3) of a surface in the pose of the assets, m."""
        fingers = joints[len(SEGMENTS) :].reshape(2, len(FINGERS), 4, 3)
        axes, down, apart = np.empty((2, 5, 3)), np.empty((2, 3)), np.zeros((2, 5))
        bent = np.zeros((2, 5, 3, 4))
        bent[..., 3] = 1
        for number, (side, sign) in enumerate(SIDES.items()):
            own, wrist = fingers[number], joints[SEGMENTS.index(f"{side}_hand")]
            palm = sign * np.cross(own[1:, 0].mean(0) - wrist, own[1, 0] - own[4, 0])
            down[number] = palm = palm / np.linalg.norm(palm)
            middle = own[2, 1] - own[2, 0]
            for finger, (first, second, *_) in enumerate(own):
                way = second - first
                if finger:
                    axis = np.cross(way, palm)
                    apart[number, finger] = np.arctan2(np.cross(way, middle) @ palm, way @ middle)
                    ways = np.diff(own[finger], axis=0)
                    bent[number, finger, 1:] = [[*np.cross(a, b), a @ b] for a, b in pairwise(ways)]
                else:
                    # The thumb closes across the palm.
                    axis = np.cross(way, own[1:3, 0].mean(0) + 0.03 * palm - first)
                axes[number, finger] = axis / np.linalg.norm(axis)
        return cls(fingers[:, :, :3], axes, down, apart, bent)

    def scaled(self, linear: np.ndarray, shift: np.ndarray) -> "Fingers":
        """Return the bones of hands that are scaled, (2, 3, 3), and shifted, (2, 3) m, but not turned."""
        return self._replace(joints=np.einsum("hij,hfbj->hfbi", linear, self.joints) + shift[:, None, None])

    def posed(self, shapes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return how each bone turns from the bind pose (2, 5, 3, 3, 3), and where it begins (2, 5, 3, 3), m.

        Args:
            shapes: (2, 5, 4) bends and spread of the fingers of both hands, as in `SHAPES`.
        """
        spread = _turn(self.down[:, None], (1 - shapes[..., 3]) * self.apart)
        axes = (spread @ self.axes[..., None])[..., 0]
        straight = np.arctan2((self.bent[..., :3] @ axes[..., None])[..., 0], self.bent[..., 3])
        angles = (shapes[..., :3] - straight).cumsum(-1)
        turns = _turn(axes[:, :, None], angles) @ spread[:, :, None]
        begins = self.joints.copy()
        begins[:, :, 1:] -= self.joints[:, :, :2]
        begins[:, :, 1:] = (turns[:, :, :2] @ begins[:, :, 1:, :, None])[..., 0]
        return turns, begins.cumsum(2)


_ACROSS = np.cross(np.eye(3)[:, None], np.eye(3)).swapaxes(1, 2).reshape(3, 9)
"""The product of a vector with it is the matrix of the cross product with the vector, row by row."""


def _turn(axes: np.ndarray, angles: np.ndarray) -> np.ndarray:
    """Return rotations (..., 3, 3) about unit axes (..., 3) by angles (...), rad: Rodrigues' formula."""
    across = (axes @ _ACROSS).reshape(*axes.shape, 3)
    return (
        np.eye(3) + np.sin(angles)[..., None, None] * across + (1 - np.cos(angles))[..., None, None] * (across @ across)
    )


# How hands change in a clip


class HandUse(NamedTuple):
    """What a motion needs a hand for, for a time."""

    side: str  # `l` or `r`
    # begin, end: First frame, and the frame after the last
    begin: int
    end: int
    shapes: tuple[str, ...]  # Of `HANDS`; one of them is drawn


@dataclass(frozen=True)
class HandChange:
    """A hand changes its shape."""

    side: str  # `l` or `r`
    at: float  # Time at which it begins, s; before 0 for the shape at the beginning of the clip
    over: float  # Duration, s
    shape: str  # One of `HANDS`
    share: float = 1.0  # How far fingers go towards it from where they are, 0 to 1

    def __post_init__(self):
        if self.side not in SIDES or self.shape not in HANDS:
            raise ValueError(
                f"change of a hand: expected a side of {', '.join(SIDES)} and a shape of {', '.join(HANDS)}, found "
                f"{self.side!r:.40} and {self.shape!r:.40}"
            )
        check_numbers("change of a hand: time and duration, s", (self.at, self.over), 1e4)
        check_numbers("change of a hand: share", self.share, 1, 0)


GESTURES = {"reach": ("open", "grip", "point"), "wave": ("open",)}
"""Shapes of the hand of an arm that makes a gesture."""
_GRASPED, _OPENED = 0.95, 0.4
"""Shares of an arm's movement to its target at which a hand closes around it, and opens before."""


def uses_of(side: str, share: np.ndarray, shapes: tuple[str, ...]) -> list[HandUse]:
    """Return the uses of a hand whose arm goes to a target with weights `share` (F,), and takes one of some shapes
    there. A hand that will hold something opens on the way."""
    grips = shapes in (("grip",), ("clasp",))
    found = []
    for level, some in ((_OPENED, ("open",) if grips else shapes), (_GRASPED, shapes if grips else ())):
        edges = np.flatnonzero(np.diff(np.concatenate([[False], share > level, [False]]))).reshape(-1, 2)
        found += [HandUse(side, begin, end, some) for begin, end in edges.tolist() if some]
    return found


_OVER = (0.2, 0.4)
"""Duration of a change, s."""
_IDLE, _IDLEST = 2.5, 0.6
"""Mean and least time between changes of a hand that does nothing, s."""
_AT_EASE = (("relaxed", "open", "grip", "fist"), (0.45, 0.22, 0.22, 0.11))
"""Shapes towards which fingers of a hand that does nothing move, and how often; part of the way, but to the first."""
_PART = (0.2, 0.7)


def sample_changes(
    first: tuple[str, str], uses: Sequence[HandUse], frames: int, fps: float, *, rng: np.random.Generator
) -> tuple[HandChange, ...]:
    """Draw how the hands of a person change.

    Args:
        first: Shapes of the left and the right hand at the beginning, if they do nothing then.
        uses: What the motion needs hands for. Of two at a time, the latter counts.
        frames, fps: Length of the motion, and its frames per second.
    """
    changes: list[HandChange] = []
    for side, shape in zip(SIDES, first, strict=True):
        own = [(use.begin, use.end, str(rng.choice(use.shapes))) for use in uses if use.side == side]
        wanted = [""] * frames
        for begin, end, needed in own:
            wanted[begin:end] = [needed] * len(wanted[begin:end])
        resting = shape if shape in _AT_EASE[0] else "relaxed"
        now, idle, held = wanted[0], _pause(rng=rng), wanted[0] or resting
        changes.append(_change(side, -1.0, held, rng=rng))
        for frame, needed in enumerate(wanted):
            seconds = frame / fps
            if needed != now:
                now, idle, held = needed, seconds + _pause(rng=rng), needed or "relaxed"
                changes.append(_change(side, seconds, held, rng=rng))
            elif not needed and seconds >= idle:
                shape, idle = str(rng.choice(_AT_EASE[0], p=_AT_EASE[1])), seconds + _pause(rng=rng)
                if shape != held:
                    share = 1.0 if shape == "relaxed" else rng.uniform(*_PART)
                    changes.append(_change(side, seconds, shape, share, rng=rng))
                    held = shape
    return tuple(changes)


def _pause(*, rng: np.random.Generator) -> float:
    return _IDLEST + rng.exponential(_IDLE - _IDLEST)


def _change(side: str, at: float, shape: str, share: float = 1.0, *, rng: np.random.Generator) -> HandChange:
    return HandChange(side, round(at, 3), round(rng.uniform(*_OVER), 3), shape, round(share, 3))


class MovingHands:
    """The hands of a person, and when they change.

    Args:
        fingers: Their bones.
        changes: (C, 5) hand, time, duration, shape, and share of each change; see `HandChange`.
    """

    _SHAPES = ((2, 5, 3, 3), (2, 5, 3), (2, 3), (2, 5), (2, 5, 3, 4))

    def __init__(self, fingers: Fingers, changes: np.ndarray):
        self.fingers, self._changes = fingers, changes
        self._shapes, self._posed = np.empty(0), (np.empty(0), np.empty(0))

    @classmethod
    def of(cls, fingers: Fingers, changes: Sequence[HandChange]) -> "MovingHands":
        """Return hands that change like this."""
        rows = [
            ("lr".index(each.side), each.at, each.over, HANDS.index(each.shape), each.share)
            for each in sorted(changes, key=lambda each: each.at)
        ]
        return cls(fingers, np.array(rows, float))

    def pack(self) -> np.ndarray:
        """Return all numbers, (n,)."""
        return np.concatenate([each.ravel() for each in (*self.fingers, self._changes)])

    @classmethod
    def unpack(cls, numbers: np.ndarray) -> "MovingHands":
        """Return the hands of the numbers of `pack`."""
        ends = np.cumsum([np.prod(shape) for shape in cls._SHAPES])
        *bones, changes = np.split(numbers, ends)
        fingers = Fingers(*(each.reshape(shape) for each, shape in zip(bones, cls._SHAPES, strict=True)))
        return cls(fingers, changes.reshape(-1, 5))

    def at(self, seconds: float) -> tuple[np.ndarray, np.ndarray]:
        """Return the bones at a time, s: how they turn and where they begin, as `Fingers.posed`."""
        shapes = np.tile(SHAPES["relaxed"], (2, 1, 1))
        for hand, at, over, shape, share in self._changes.tolist():
            if at >= seconds:
                break
            own, x = shapes[int(hand)], min((seconds - at) / over, 1.0) if over > 0 else 1.0
            own += share * x * x * (3 - 2 * x) * (SHAPES[HANDS[int(shape)]] - own)
        if not np.array_equal(shapes, self._shapes):
            self._shapes, self._posed = shapes, self.fingers.posed(shapes)
        return self._posed
