"""What a scene is drawn from: room, people, props, and the length of a clip."""

from dataclasses import dataclass, field
from enum import Enum

import numpy as np

from dmae.data.typed import Configuration
from dmae.nearest import unknown
from synth.checks import check_pairs, check_range
from synth.people.body import MOST_PERSONS
from synth.people.clothing import WARDROBE
from synth.rooms.config import room_choices

_LONGEST, _FASTEST = 3600.0, 1000.0
"""Longest clip, s, and highest frame rate, 1/s."""

MOST_CLIPS = 1_000_000_000
"""Greatest number of clips of a data set."""


class Hands(Enum):
    """What people's hands do in a clip."""

    moving = "moving"
    """They grip, open, point and close to fists with what people do, and their fingers move in between."""
    still = "still"
    """Each keeps one shape."""


class Solids(Enum):
    """What of people collides."""

    snug = "snug"
    """Capsules that fit the skin of trunk, arms and legs."""
    plain = "plain"
    """Capsules of a person's proportions, as in the data sets of the benchmark. The skin is up to 45 mm outside."""


@dataclass(frozen=True)
class SceneConfig(Configuration):
    """Distributions from which scenes are drawn. Pairs are the least and the greatest value."""

    arena: str = field(default="studio", metadata={"reads": "path", "words": room_choices})
    """Room of `scenes/`, or path of an MJCF file."""
    persons: list[int] = field(default_factory=list)
    """Least and greatest number of people; with an interaction, of its participants. By default 2 to 4, within the
    numbers that the interaction allows."""
    children: float = 0.0
    """Share of children, 4 to 17 years old, among the people."""
    wardrobe: list[str] = field(default_factory=lambda: list(WARDROBE))
    """What people may wear besides shirts, trousers and shoes; nothing if empty."""
    hands: Hands = Hands.moving
    """What hands do. Bodies, motion and forces are the same for both."""
    solids: Solids = Solids.snug
    """What of people collides, with each other and with things."""
    seconds: float = 5.0
    """Length of a clip, s."""
    fps: float = 25.0
    """Frames per second of a clip. The same seed gives the same motion at any rate."""
    middle: list[float] = field(default_factory=lambda: [0.0, 0.0])
    """x, y of the point around which people and props are placed, m."""
    radius: float = 1.9
    """Greatest distance of people's hips from the middle, m; motions that cannot be adapted may reach 0.3 m farther."""
    gathering: float = 0.5
    """Distance from the middle through which people pass at some time, m (standard deviation). With small values people
    meet and hide each other."""
    clearance: list[float] = field(default_factory=lambda: [0.35, 0.65])
    """Distance that people keep between their hips, m; one value per clip. Below 0.5 they touch."""
    props: list[int] = field(default_factory=lambda: [0, 3])
    """Number of props, where there is space."""
    prop_kinds: list[str] = field(default_factory=lambda: ["chair", "table", "screen", "plant", "crate", "drum"])
    """Kinds of props: of `scenes/props/`, or paths of MJCF files."""
    randomize: bool = True
    """Whether floor, walls, light and colours are random in each clip; otherwise as in the room's file."""

    def __post_init__(self):
        super().__post_init__()
        for word in self.wardrobe:
            if word not in WARDROBE:
                raise ValueError(f"scene.wardrobe: {unknown('word', word, WARDROBE)}")
        if self.persons:
            check_pairs("scene", self, 1, MOST_PERSONS, "persons", unit=" people")
        check_pairs("scene", self, 0, np.inf, "clearance", unit=" m")
        check_pairs("scene", self, 0, np.inf, "props")
        check_range("scene", self, 0, _LONGEST, "seconds", above=True, unit=" s")
        check_range("scene", self, 0, _FASTEST, "fps", above=True, unit=" frames per second")
        check_range("scene", self, 0, 1000.0, "radius", "gathering", above=True, unit=" m")
        check_range("scene", self, 0, 1, "children")
        if len(self.middle) != 2 or not np.isfinite(self.middle).all():
            raise ValueError(f"scene.middle: expected x and y, m, found {list(self.middle)}")
        if self.props[1] and not self.prop_kinds:
            raise ValueError(f"scene.prop_kinds is empty, but scene.props asks for up to {self.props[1]}")

    @property
    def frames(self) -> int:
        """The number of frames of a clip."""
        return max(1, round(self.seconds * self.fps))
