"""What people do together: they meet on purpose, and touch where people touch."""

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple

from synth.interactions.around import counter, table
from synth.interactions.carrying import pass_box
from synth.interactions.meeting import circle_talk, crossing, queue, walking_together
from synth.interactions.script import Script
from synth.interactions.shelving import shelving
from synth.interactions.touching import dance, fight, handshake, huddle, hug


class InteractionKind(Enum):
    """What people do together."""

    none = "none"
    """Nothing in particular: everybody goes where the scene has them go."""
    crossing = "crossing"
    walking_together = "walking_together"
    queue = "queue"
    circle_talk = "circle_talk"
    handshake = "handshake"
    huddle = "huddle"
    counter = "counter"
    hug = "hug"
    fight = "fight"
    table = "table"
    pass_box = "pass_box"
    dance = "dance"
    shelving = "shelving"


@dataclass(frozen=True)
class InteractionConfig:
    """Whether people do something together.

    Attributes:
        kind: What. Its number of people is as near as can be to what the scene draws.
    """

    kind: InteractionKind = InteractionKind.none


class Interaction(NamedTuple):
    """The least and the greatest number of people, and what makes the script."""

    least: int
    most: int
    write: Callable[..., Script]


INTERACTIONS = {
    InteractionKind.crossing: Interaction(2, 6, crossing),
    InteractionKind.walking_together: Interaction(2, 6, walking_together),
    InteractionKind.queue: Interaction(3, 6, queue),
    InteractionKind.circle_talk: Interaction(3, 6, circle_talk),
    InteractionKind.handshake: Interaction(2, 2, handshake),
    InteractionKind.huddle: Interaction(6, 6, huddle),
    InteractionKind.counter: Interaction(3, 6, counter),
    InteractionKind.hug: Interaction(2, 2, hug),
    InteractionKind.fight: Interaction(2, 2, fight),
    InteractionKind.table: Interaction(2, 6, table),
    InteractionKind.pass_box: Interaction(2, 2, pass_box),
    InteractionKind.dance: Interaction(2, 2, dance),
    InteractionKind.shelving: Interaction(2, 6, shelving),
}
