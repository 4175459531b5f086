"""Contacts of people in a clip: from the simulation, with carried objects, and with objects that stand still."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from dmae.data.array_fields import short_repr
from synth.labels.momentum import movement, needed_forces, smoothed
from synth.labels.shapes import check_shapes
from synth.labels.support import SeenStates
from synth.physics.body_state import BodyState
from synth.scene.build import Scene

_CONTACT_GAP = 0.002
"""Gap below which an object counts as lying on something that stands still, m."""
_PERSON = re.compile("person([0-9]{1,6})")


class ContactSource(IntEnum):
    """Source of the force of a contact."""

    SIMULATED = 0
    """The simulation: contacts with other people, with a moving object, or of a person with itself."""
    SOLVED = 1
    """Inverse dynamics: contacts with objects that stand still."""
    HELD = 2
    """The force that a held object needs, shared equally by the palms that hold it."""


@dataclass(frozen=True)
class PeopleContacts:
    """C contacts of people in a clip.

    Attributes:
        frame: (C,) int32, sorted.
        between: (C, 2) int16 index into `names`.
        names: `person<p>/<segment>`, or names of objects.
        point: (C, 3) float32 m, world.
        force: (C, 3) float32 N, world, force of the first on the second.
        depth: (C,) float32 m, overlap of solid parts; below 0 for a gap.
        source: (C,) uint8 `ContactSource`.
    """

    frame: np.ndarray
    between: np.ndarray
    names: tuple[str, ...]
    point: np.ndarray
    force: np.ndarray
    depth: np.ndarray
    source: np.ndarray

    __repr__ = short_repr

    def __post_init__(self):
        count = len(self.frame)
        shapes = {"frame": (count,), "between": (count, 2), "depth": (count,), "source": (count,)}
        check_shapes("contacts", self, shapes | {"point": (count, 3), "force": (count, 3)})
        if count and not 0 <= self.between.min() <= self.between.max() < len(self.names):
            raise ValueError(f"contacts: expected between to count {len(self.names)} names")
        owners(self.names)

    @property
    def persons(self) -> np.ndarray:
        """(C, 2) person on each side, -1 for objects."""
        return owners(self.names)[self.between]

    def wrench(self, person: int, centre: np.ndarray) -> np.ndarray:
        """Return (F, 6) the force on a person, N, and its moment about `centre` (F, 3) m, N m, in each frame."""
        total, persons = np.zeros((len(centre), 6)), self.persons
        for side, sign in ((1, 1.0), (0, -1.0)):
            on = np.flatnonzero((persons[:, side] == person) & (persons[:, 1 - side] != person))
            force, frame = sign * self.force[on].astype(float), self.frame[on]
            np.add.at(total[:, :3], frame, force)
            np.add.at(total[:, 3:], frame, np.cross(self.point[on] - centre[frame], force))
        return total


def owners(names: Sequence[str]) -> np.ndarray:
    """Return the person that each name of `PeopleContacts` belongs to, -1 for objects.

    Raises:
        ValueError: the name of a person has no number.
    """
    return np.array([_owner(name) for name in names], int)


def _owner(name: str) -> int:
    person, slash, _ = name.partition("/")
    if not (slash and person.startswith("person")):
        return -1
    if not (found := _PERSON.fullmatch(person)):
        raise ValueError(f"contacts: name {name[:40]!r}: expected person<number>/<segment>, or the name of an object")
    return int(found[1])


def join(parts: Sequence[PeopleContacts]) -> PeopleContacts:
    """Join contacts with the same names, and sort them by frame."""
    columns = {
        name: np.concatenate([getattr(part, name) for part in parts])
        for name in ("frame", "between", "point", "force", "depth", "source")
    }
    order = np.argsort(columns["frame"], kind="stable")
    return make_contacts(parts[0].names, **{name: values[order] for name, values in columns.items()})


def make_contacts(names: tuple[str, ...], frame, between, point, force, depth, source) -> PeopleContacts:
    """Return contacts with the array types of `PeopleContacts`. A single `source` applies to all contacts."""
    single = (np.asarray(values, np.float32) for values in (point, force, depth))
    point, force, depth = single
    source = np.full(len(frame), source, np.uint8) if np.ndim(source) == 0 else np.asarray(source, np.uint8)
    between = np.asarray(between, np.int16).reshape(-1, 2)
    return PeopleContacts(np.asarray(frame, np.int32), between, names, point, force, depth, source)


def simulated_contacts(scene: Scene, state: BodyState) -> PeopleContacts:
    """Return the contacts of people with moving objects, with each other, and with themselves."""
    moving = {
        name for name, body in zip(scene.geom_names, scene.model.geom_bodyid, strict=True)
        if scene.model.body_weldid[body]
    }  # fmt: skip
    moves = np.array([name in moving for name in state.contact_names], bool)
    kept = np.flatnonzero(moves[state.contact_between].all(1))
    return make_contacts(
        state.contact_names,
        state.contact_frame[kept],
        state.contact_between[kept],
        state.contact_point[kept],
        state.contact_force[kept],
        state.contact_depth[kept],
        ContactSource.SIMULATED,
    )


def held_contacts(scene: Scene, state: BodyState, seen: SeenStates, fps: float) -> Iterator[PeopleContacts]:
    """Yield the contacts of each carried object with the palms that hold it.

    While the object does not lie on anything that stands still, the palms share its load equally. The load is the force
    that the motion of the object needs, minus the forces of bodies that press on it.
    """
    model, frames, names = scene.model, len(state.qpos), list(state.contact_names)
    holds, begin, end = scene.holds[:, 0].astype(int), *scene.holds[:, 1:].T
    loads, palms = model.site_bodyid[model.eq_obj1id[holds]], model.eq_obj2id[holds]
    hands = np.array([names.index(model.body(body).name) for body in model.site_bodyid[palms]], int)
    times, persons = np.arange(frames)[:, None] / fps, owners(names)
    bodies = model.geom_bodyid[seen.geoms]
    still = (model.body_weldid[bodies] == 0).any(1) & (seen.gap < _CONTACT_GAP)
    for load in np.unique(loads):
        alone = np.ones(frames, bool)
        alone[seen.frame[still & (bodies == load).any(1)]] = False
        used = (begin <= times) & (times < end) & (loads == load) & alone[:, None]
        moves = movement(model, seen.places[:, [load]], seen.turns[:, [load]], np.array([load]), fps)
        needed = needed_forces(model, moves, np.array([load])).force
        own, pushes = names.index(model.body(load).name), np.zeros((frames, 3))
        for side, sign in ((1, 1.0), (0, -1.0)):
            on = (state.contact_between[:, side] == own) & (persons[state.contact_between[:, 1 - side]] >= 0)
            np.add.at(pushes, state.contact_frame[on], sign * state.contact_force[on])
        share = (needed - smoothed(pushes, fps)) / np.maximum(used.sum(1), 1)[:, None]
        frame, hold = np.nonzero(used)
        between = np.stack([hands[hold], np.full(len(hold), own)], axis=1)
        point, depth = seen.sites[frame, palms[hold]], np.zeros(len(frame))
        yield make_contacts(state.contact_names, frame, between, point, share[frame], depth, ContactSource.HELD)
