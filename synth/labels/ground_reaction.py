"""The forces that support people: contact forces by inverse dynamics of the recorded motion, and the residual.

In the simulation a force at the pelvis supports people, and their feet hardly press on the floor. Here the motion is
taken as given. Newton's and Euler's laws give the external force and moment that the motion needs. The forces from
other people and from carried objects are known. Contacts with objects that stand still take as much of the rest as
pushing and friction allow. The remainder is the residual at the pelvis: the part of the motion that contacts do not
explain.
"""

from dataclasses import dataclass

import numpy as np

from dmae.data.array_fields import short_repr
from synth.labels.momentum import LEAST_FPS, Movement, movement, needed_forces, smoothed
from synth.labels.people_contacts import (
    ContactSource,
    PeopleContacts,
    held_contacts,
    join,
    make_contacts,
    simulated_contacts,
)
from synth.labels.shapes import check_shapes
from synth.labels.support import Places, SeenStates, look, solve
from synth.motion.feet import FEET
from synth.people.segments import SEGMENTS
from synth.physics.body_state import BodyState
from synth.scene.build import Scene

_LEAST_FORCE = 1.0
"""Force below which a contact is left out, N."""
_PAIRS = ("ground_reaction", "centre_of_pressure", "supported", "residual")


@dataclass(frozen=True)
class BodyForces:
    """The forces that support P people in F frames; world axes.

    Attributes:
        weights: (P,) float32 mass times gravity, N.
        centre_of_mass: (F, P, 3) float32 m.
        ground_reaction: (F, P, 2, 3) float32 N on the left and the right foot, from objects that stand still.
        centre_of_pressure: (F, P, 2, 3) float32 m, the point where it acts; NaN without a force.
        supported: (F, P, 2, 3) float32 force, N, and moment about the mid hip, N m, of all contacts with anything else.
            Forces from the simulation are smoothed with the same filter as the motion.
        residual: (F, P, 2, 3) float32 force at the mid hip, N, and moment, N m, that the motion needs and no contact
            supplies.
        penetration: (F, P, 2) float32 deepest overlap with another person, and with an object, m; 0 for none.
    """

    weights: np.ndarray
    centre_of_mass: np.ndarray
    ground_reaction: np.ndarray
    centre_of_pressure: np.ndarray
    supported: np.ndarray
    residual: np.ndarray
    penetration: np.ndarray

    __repr__ = short_repr

    def __post_init__(self):
        frames, persons = self.centre_of_mass.shape[:2]
        pairs = dict.fromkeys(_PAIRS, (frames, persons, 2, 3))
        of_frames = {"centre_of_mass": (frames, persons, 3), "penetration": (frames, persons, 2)}
        check_shapes("forces", self, {"weights": (persons,)} | of_frames | pairs)


def carry(scene: Scene, state: BodyState, fps: float) -> tuple[PeopleContacts, BodyForces]:
    """Return all contacts of people, and their sums for each person, from the states of a clip.

    Args:
        scene: The scene of the clip.
        state: The states of its bodies, F frames.
        fps: Frames per second.

    Raises:
        ValueError: frames are too far apart for accelerations.
    """
    if fps < LEAST_FPS:
        raise ValueError(
            f"forces: expected {LEAST_FPS:g} frames per second or more, got {fps:g}: accelerations cannot be "
            "computed from positions this far apart; generate the clips with a higher scene.fps"
        )
    seen, persons = look(scene, state.qpos), range(len(state.shapes))
    known = join([simulated_contacts(scene, state), *held_contacts(scene, state, seen, fps)])
    found = [_person_forces(scene, state, seen, known, person, fps) for person in persons]
    values = {name: [each[name] for _, each in found] for name in BodyForces.__dataclass_fields__}
    weights = np.array(values.pop("weights"), np.float32)
    of_frames = {name: np.stack(each, axis=1, dtype=np.float32) for name, each in values.items()}
    contacts = join([known, *(contacts for contacts, _ in found)])
    return contacts, BodyForces(weights, **of_frames)


def _person_forces(
    scene: Scene, state: BodyState, seen: SeenStates, known: PeopleContacts, person: int, fps: float
) -> tuple[PeopleContacts, dict]:
    """Return the contacts of a person with objects that stand still, and the fields of `BodyForces` without axis P."""
    model, frames = scene.model, len(state.qpos)
    bodies = model.body(f"person{person}/{SEGMENTS[0]}").id + np.arange(len(SEGMENTS))
    moves = movement(model, seen.places[:, bodies], seen.turns[:, bodies], bodies, fps)
    centre, force, moment = needed_forces(model, moves, bodies)
    weight = float(-model.opt.gravity[2] * model.body_mass[bodies].sum())
    pushes = smoothed(known.wrench(person, centre), fps)
    missing = np.concatenate([force, moment], axis=1) - pushes

    places = _still_places(scene, seen, moves, person, bodies)
    borne = np.zeros((len(places.frame), 3))
    ends = np.searchsorted(places.frame, np.arange(frames + 1))
    for frame in range(frames):
        chosen = np.arange(ends[frame], ends[frame + 1])
        borne[chosen] = solve(places, chosen, centre[frame], missing[frame], weight)
    pressing = np.flatnonzero(np.linalg.norm(borne, axis=1) > _LEAST_FORCE)
    names = np.array([state.contact_names.index(name) for name in scene.geom_names])
    contacts = make_contacts(
        state.contact_names,
        places.frame[pressing],
        # The pair is reversed, because the force is that of the object on the person.
        names[places.geoms[pressing, ::-1]],
        places.point[pressing],
        borne[pressing],
        -places.gap[pressing],
        ContactSource.SOLVED,
    )
    supported = contacts.wrench(person, centre)
    part = model.geom_bodyid[places.geoms[pressing, 0]] - bodies[0]
    reaction, pressure = _feet(contacts, part, frames)
    hips = state.root[:, person].astype(float)
    return contacts, {
        "weights": weight,
        "centre_of_mass": centre,
        "ground_reaction": reaction,
        "centre_of_pressure": pressure,
        "supported": _about_point(pushes + supported, centre - hips),
        "residual": _about_point(missing - supported, centre - hips),
        "penetration": _penetration(scene, seen, person, frames),
    }


def _about_point(wrench: np.ndarray, lever: np.ndarray) -> np.ndarray:
    """Return (F, 2, 3) forces, N, and moments, N m, about another point.

    `lever` (F, 3), m, is the vector from that point to the present one.
    """
    force, moment = wrench[:, :3], wrench[:, 3:]
    return np.stack([force, moment + np.cross(lever, force)], axis=1)


def _still_places(scene: Scene, seen: SeenStates, moves: Movement, person: int, bodies: np.ndarray) -> Places:
    """Return the places where a person touches, or nearly touches, objects that stand still."""
    persons, on = scene.geom_persons[seen.geoms], scene.model.geom_bodyid[seen.geoms]
    still = scene.model.body_weldid[on] == 0
    swapped = (persons[:, 1] == person) & still[:, 0]
    chosen = np.flatnonzero(swapped | ((persons[:, 0] == person) & still[:, 1]))
    swapped, geoms, normal = swapped[chosen, None], seen.geoms[chosen], seen.normal[chosen]
    geoms = np.where(swapped, geoms[:, ::-1], geoms)
    normal = np.where(swapped, normal, -normal)
    frame, point, part = seen.frame[chosen], seen.point[chosen], scene.model.geom_bodyid[geoms[:, 0]] - bodies[0]
    speed = moves.velocities[frame, part] + np.cross(moves.turning[frame, part], point - moves.places[frame, part])
    along = np.linalg.norm(speed - (speed * normal).sum(1, keepdims=True) * normal, axis=1)
    return Places(frame, geoms, point, normal, seen.friction[chosen], seen.gap[chosen], along)


def _feet(contacts: PeopleContacts, part: np.ndarray, frames: int) -> tuple[np.ndarray, np.ndarray]:
    """Return reactions (F, 2, 3), N, and centres of pressure (F, 2, 3), m, from contacts of segments `part` (C,)."""
    reaction, pressure = np.zeros((frames, 2, 3)), np.full((frames, 2, 3), np.nan)
    for side, foot in enumerate(FEET):
        on = part == foot
        frame, force, point = contacts.frame[on], contacts.force[on].astype(float), contacts.point[on].astype(float)
        np.add.at(reaction[:, side], frame, force)
        strength = np.linalg.norm(force, axis=1)
        total, moment = np.zeros(frames), np.zeros((frames, 3))
        np.add.at(total, frame, strength)
        np.add.at(moment, frame, strength[:, None] * point)
        some = total > 0
        pressure[some, side] = moment[some] / total[some, None]
    return reaction, pressure


def _penetration(scene: Scene, seen: SeenStates, person: int, frames: int) -> np.ndarray:
    """Return the deepest overlaps (F, 2) of a person with another person, and with an object, m."""
    deepest, persons = np.zeros((frames, 2)), scene.geom_persons[seen.geoms]
    for side in (0, 1):
        other = persons[:, 1 - side]
        of = np.flatnonzero((persons[:, side] == person) & (other != person) & (seen.gap < 0))
        np.maximum.at(deepest, (seen.frame[of], (other[of] < 0).astype(int)), -seen.gap[of])
    return deepest
