"""Contacts and forces of people: what a motion needs, what touches, and what supports them."""

import copy
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from enum import IntEnum
from typing import NamedTuple

import mujoco
import numpy as np
from scipy.interpolate import CubicSpline
from scipy.optimize import nnls
from scipy.signal import butter, sosfiltfilt

from dmae.data.array_fields import set_array, short_repr
from synth.motion.feet import FEET
from synth.people.body import SEGMENTS
from synth.physics.body_state import BodyState
from synth.scene.build import Scene

_CUTOFF = 6.0
"""Cut-off frequency of the motion, Hz. Gait laboratories use it to smooth marker paths before differentiation."""
LEAST_FPS = 12.0
"""Lowest frame rate at which accelerations can be computed from positions, 1/s."""


class Movement(NamedTuple):
    """The motion of B bodies in F frames."""

    places: np.ndarray  # (F, B, 3) centres of mass, m, world
    velocities: np.ndarray  # (F, B, 3) m / s
    accelerations: np.ndarray  # (F, B, 3) m / s^2
    turning: np.ndarray  # (F, B, 3) angular velocities, rad / s, world
    spin_rates: np.ndarray  # (F, B, 3) rate of change of the angular momentum about the body's centre of mass, N m


def smoothed(values: np.ndarray, fps: float, derivative: int = 0) -> np.ndarray:
    """Return values (F, ...) at F frames, or their time derivative, without frequencies above 6 Hz.

    A Butterworth filter of second order is run forwards and backwards, as for gait (Winter, Biomechanics and Motor
    Control, 4th ed., ch. 3). Derivatives come from a cubic spline through the filtered values.
    """
    if len(values) > 1:
        sections = butter(2, min(_CUTOFF, 0.4 * fps), fs=fps, output="sos")
        padding = min(round(fps), len(values) - 1)
        values = sosfiltfilt(sections, values, axis=0, padlen=padding)
    if derivative == 0:
        return values
    if len(values) < 2:
        return np.zeros_like(values)
    times = np.arange(len(values)) / fps
    return CubicSpline(times, values)(times, derivative)


def movement(model: mujoco.MjModel, places: np.ndarray, turns: np.ndarray, bodies: np.ndarray, fps: float) -> Movement:
    """Return the motion of bodies.

    Args:
        places: (F, B, 3) centres of mass of the bodies, m, world: `xipos`.
        turns: (F, B, 3, 3) orientations of their principal axes: `ximat`.
        bodies: (B,) indices in the model.
    """
    rates = smoothed(turns, fps, 1) @ turns.swapaxes(-1, -2)
    # In the rate of a rotation matrix times its inverse, only the skew part is a rotation. The rest is fitting error.
    rates = (rates - rates.swapaxes(-1, -2)) / 2
    omega = np.stack([rates[..., 2, 1], rates[..., 0, 2], rates[..., 1, 0]], -1)
    own = (turns.swapaxes(-1, -2) @ omega[..., None])[..., 0] * model.body_inertia[bodies]
    spins = (turns @ own[..., None])[..., 0]
    return Movement(places, smoothed(places, fps, 1), smoothed(places, fps, 2), omega, smoothed(spins, fps, 1))


def needed_forces(model: mujoco.MjModel, moves: Movement, bodies: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return the external forces on a group of bodies, without gravity, by Newton's and Euler's laws.

    Args:
        moves: The smoothed motion of B bodies.
        bodies: (B,) indices of the bodies in the model.

    Returns:
        centre: (F, 3) centre of mass, m, world.
        force: (F, 3) N, world.
        moment: (F, 3) about the centre of mass, N m, world.
    """
    masses = model.body_mass[bodies][:, None]
    centre = (masses * moves.places).sum(1) / masses.sum()
    forces = masses * (moves.accelerations - model.opt.gravity)
    moments = np.cross(moves.places - centre[:, None], forces) + moves.spin_rates
    return centre, forces.sum(1), moments.sum(1)


# Places where objects that stand still may support people, and the forces there

_NEAR = 0.02
"""Greatest gap between a part of a body and an object that supports it, m."""
_GAP, _SPEED = 0.005, 0.3
"""Gap, m, and speed along the surface, m/s, each of which doubles the penalty on a force compared with firm contact."""
_EDGES = 8
"""Number of edges of the pyramid that approximates the friction cone from inside."""
_EVENNESS_WEIGHT = 1e-6
"""Weight of evenly distributed forces, relative to their balance."""
_MOMENT_LENGTH = 3.0
"""Length by which moments are divided to compare them with forces, m. It gives the forces more weight."""


class Places(NamedTuple):
    """K places where geoms touch, or nearly touch; of a person and objects that stand still, the person's is first."""

    frame: np.ndarray  # (K,) int32 frame, sorted
    geoms: np.ndarray  # (K, 2) indices of the geoms
    point: np.ndarray  # (K, 3) m, world
    normal: np.ndarray  # (K, 3) unit vector from the first geom to the second, world; from an object to a person
    friction: np.ndarray  # (K,) coefficient
    gap: np.ndarray  # (K,) m, below 0 for an overlap
    speed: np.ndarray | float = 0.0  # (K,) speed of a person's part along the surface, m/s


class SeenStates(NamedTuple):
    """Positions and contacts in the states of a scene."""

    places: np.ndarray  # (F, nbody, 3) centres of mass of bodies, m, world
    turns: np.ndarray  # (F, nbody, 3, 3) orientations of their principal axes
    sites: np.ndarray  # (F, nsite, 3) positions of sites, m, world
    contacts: Places  # Of all geoms


def look(scene: Scene, qpos: np.ndarray) -> SeenStates:
    """Put a scene into states (F, nq), and record its contacts. Pairs with people count up to a gap of 20 mm."""
    model = copy.copy(scene.model)
    people = scene.geom_persons >= 0
    model.geom_margin[people] = np.maximum(model.geom_margin[people], _NEAR)
    # MuJoCo tests bodies before geoms, with the greatest margin of their geoms.
    np.maximum.at(model.body_margin, model.geom_bodyid[people], _NEAR)
    data, frames = mujoco.MjData(model), len(qpos)
    places, turns = np.empty((frames, model.nbody, 3)), np.empty((frames, model.nbody, 9))
    sites, found = np.empty((frames, model.nsite, 3)), []
    for number, state in enumerate(qpos):
        data.qpos[:] = state
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_collision(model, data)
        places[number], turns[number], sites[number] = data.xipos, data.ximat, data.site_xpos
        contact = data.contact
        seen = (contact.geom, contact.pos, contact.frame[:, :3], contact.friction[:, 0], contact.dist)
        found.append((np.full(data.ncon, number, np.int32), *(part.copy() for part in seen)))
    contacts = Places(*(np.concatenate(part) for part in zip(*found, strict=True)))
    return SeenStates(places, turns.reshape(frames, -1, 3, 3), sites, contacts)


def solve(places: Places, chosen: np.ndarray, centre: np.ndarray, needed: np.ndarray, weight: float) -> np.ndarray:
    """Return the forces (K', 3), N, on a person at some places of a frame that come closest to the needed force.

    The missing force and moment are minimised by least squares. The forces push and stay inside the friction cone. Of
    several equally good distributions the most even one is returned. Firm contacts get more force than places with a
    gap.

    Args:
        places: Places of all frames.
        chosen: (K',) indices of the places.
        centre: (3,) point about which moments are taken, m.
        needed: (6,) needed force, N, and moment, N m.
        weight: Weight of the person, N.
    """
    if not len(chosen):
        return np.zeros((0, 3))
    normal = places.normal[chosen]
    across = np.cross(normal, np.where(np.abs(normal[:, :1]) < 0.8, (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)))
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    angle = 2 * np.pi * np.arange(_EDGES) / _EDGES
    around = np.cos(angle)[:, None] * across[:, None] + np.sin(angle)[:, None] * np.cross(normal, across)[:, None]
    edges = normal[:, None] + places.friction[chosen, None, None] * around
    moments = np.cross((places.point[chosen] - centre)[:, None], edges)
    doubt = 1 + (places.gap[chosen].clip(0) / _GAP) ** 2 + (np.asarray(places.speed)[chosen] / _SPEED) ** 2
    balance = np.concatenate([edges, moments / _MOMENT_LENGTH], axis=-1).reshape(-1, 6).T
    even = np.diag(np.repeat(np.sqrt(_EVENNESS_WEIGHT * doubt), _EDGES))
    wanted = np.concatenate([needed[:3], needed[3:] / _MOMENT_LENGTH, np.zeros(len(even))]) / weight
    shares, _ = nnls(np.concatenate([balance, even]), wanted)
    return weight * (shares.reshape(-1, _EDGES, 1) * edges).sum(1)


# Contacts of people in a clip: from the simulation, with carried objects, and with objects that stand still

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
    """C contacts of people in a clip."""

    frame: np.ndarray  # (C,) int32, sorted
    between: np.ndarray  # (C, 2) int16 index into `names`
    names: tuple[str, ...]  # `person<p>/<segment>`, or names of objects
    point: np.ndarray  # (C, 3) float32 m, world
    force: np.ndarray  # (C, 3) float32 N, world, force of the first on the second
    depth: np.ndarray  # (C,) float32 m, overlap of solid parts; below 0 for a gap
    source: np.ndarray  # (C,) uint8 `ContactSource`

    __repr__ = short_repr

    def __post_init__(self):
        set_array(self, "frame", np.int32, ("C",))
        count = len(self.frame)
        set_array(self, "between", np.int16, (count, 2))
        for name, dtype, shape in (
            ("point", np.float32, (count, 3)),
            ("force", np.float32, (count, 3)),
            ("depth", np.float32, (count,)),
            ("source", np.uint8, (count,)),
        ):
            set_array(self, name, dtype, shape)
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

    Raises ValueError if the name of a person has no number.
    """
    found = np.full(len(names), -1)
    for number, name in enumerate(names):
        person, slash, _ = name.partition("/")
        if slash and person.startswith("person"):
            if not (match := _PERSON.fullmatch(person)):
                raise ValueError(
                    f"contacts: name {name[:40]!r}: expected person<number>/<segment>, or the name of an object"
                )
            found[number] = int(match[1])
    return found


def join(parts: Sequence[PeopleContacts]) -> PeopleContacts:
    """Join contacts with the same names, and sort them by frame."""
    columns: dict = {
        name: np.concatenate([getattr(part, name) for part in parts])
        for name in ("frame", "between", "point", "force", "depth", "source")
    }
    order = np.argsort(columns["frame"], kind="stable")
    return replace(parts[0], **{name: values[order] for name, values in columns.items()})


def simulated_contacts(scene: Scene, state: BodyState) -> PeopleContacts:
    """Return the contacts of people with moving objects, with each other, and with themselves."""
    moving = {
        name for name, body in zip(scene.geom_names, scene.model.geom_bodyid, strict=True)
        if scene.model.body_weldid[body]
    }  # fmt: skip
    moves = np.array([name in moving for name in state.contact_names], bool)
    kept = np.flatnonzero(moves[state.contact_between].all(1))
    return PeopleContacts(
        state.contact_frame[kept],
        state.contact_between[kept],
        state.contact_names,
        state.contact_point[kept],
        state.contact_force[kept],
        state.contact_depth[kept],
        np.full(len(kept), ContactSource.SIMULATED),
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
    bodies = model.geom_bodyid[seen.contacts.geoms]
    still = (model.body_weldid[bodies] == 0).any(1) & (seen.contacts.gap < _CONTACT_GAP)
    for load in np.unique(loads):
        alone = np.ones(frames, bool)
        alone[seen.contacts.frame[still & (bodies == load).any(1)]] = False
        used = (begin <= times) & (times < end) & (loads == load) & alone[:, None]
        moves = movement(model, seen.places[:, [load]], seen.turns[:, [load]], np.array([load]), fps)
        _, needed, _ = needed_forces(model, moves, np.array([load]))
        own, pushes = names.index(model.body(load).name), np.zeros((frames, 3))
        for side, sign in ((1, 1.0), (0, -1.0)):
            on = (state.contact_between[:, side] == own) & (persons[state.contact_between[:, 1 - side]] >= 0)
            np.add.at(pushes, state.contact_frame[on], sign * state.contact_force[on])
        share = (needed - smoothed(pushes, fps)) / np.maximum(used.sum(1), 1)[:, None]
        frame, hold = np.nonzero(used)
        between = np.stack([hands[hold], np.full(len(hold), own)], axis=1)
        point, depth = seen.sites[frame, palms[hold]], np.zeros(len(frame))
        source = np.full(len(frame), ContactSource.HELD)
        yield PeopleContacts(frame, between, state.contact_names, point, share[frame], depth, source)


# Support by inverse dynamics. In the simulation a force at the pelvis supports people, and their feet hardly press on
# the floor. Here the motion is taken as given. Newton's and Euler's laws give the external force and moment that the
# motion needs. The forces from other people and from carried objects are known. Contacts with objects that stand still
# take as much of the rest as pushing and friction allow. The remainder is the residual at the pelvis: the part of the
# motion that contacts do not explain.

_LEAST_FORCE = 1.0
"""Force below which a contact is left out, N."""


@dataclass(frozen=True)
class BodyForces:
    """The forces that support P people in F frames; world axes."""

    weights: np.ndarray  # (P,) float32 mass times gravity, N
    centre_of_mass: np.ndarray  # (F, P, 3) float32 m
    ground_reaction: np.ndarray  # (F, P, 2, 3) float32 N on the left and the right foot, from objects that stand still
    centre_of_pressure: np.ndarray  # (F, P, 2, 3) float32 m, the point where it acts; NaN without a force
    # (F, P, 2, 3) float32 force, N, and moment about the mid hip, N m, of all contacts with anything else. Forces from
    # the simulation are smoothed with the same filter as the motion.
    supported: np.ndarray
    # (F, P, 2, 3) float32 force at the mid hip, N, and moment, N m, that the motion needs and no contact supplies
    residual: np.ndarray
    penetration: np.ndarray  # (F, P, 2) float32 deepest overlap with another person, and with an object, m; 0 for none

    __repr__ = short_repr

    def __post_init__(self):
        set_array(self, "centre_of_mass", np.float32, ("F", "P", 3))
        people = self.centre_of_mass.shape[:2]
        set_array(self, "weights", np.float32, people[1:])
        set_array(self, "penetration", np.float32, (*people, 2))
        for name in ("ground_reaction", "centre_of_pressure", "supported", "residual"):
            set_array(self, name, np.float32, (*people, 2, 3))


def carry(scene: Scene, state: BodyState, fps: float) -> tuple[PeopleContacts, BodyForces]:
    """Return all contacts of people, and their sums for each person, from the states of a clip.

    Raises ValueError if frames are too far apart for accelerations.

    Args:
        scene: The scene of the clip.
        state: The states of its bodies, F frames.
    """
    if fps < LEAST_FPS:
        raise ValueError(
            f"forces: expected {LEAST_FPS:g} frames per second or more, found {fps:g}: accelerations cannot be "
            "computed from positions this far apart; generate the clips with a higher scene.fps"
        )
    seen, persons = look(scene, state.qpos), range(len(state.shapes))
    known = join([simulated_contacts(scene, state), *held_contacts(scene, state, seen, fps)])
    found = [_person_forces(scene, state, seen, known, person, fps) for person in persons]
    values = {name: [each[name] for _, each in found] for name in BodyForces.__dataclass_fields__}
    weights = np.array(values.pop("weights"))
    contacts = join([known, *(contacts for contacts, _ in found)])
    return contacts, BodyForces(weights, **{name: np.stack(each, axis=1) for name, each in values.items()})


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

    places = _still_places(scene, seen.contacts, moves, person, bodies)
    borne = np.zeros((len(places.frame), 3))
    ends = np.searchsorted(places.frame, np.arange(frames + 1))
    for frame in range(frames):
        chosen = np.arange(ends[frame], ends[frame + 1])
        borne[chosen] = solve(places, chosen, centre[frame], missing[frame], weight)
    pressing = np.flatnonzero(np.linalg.norm(borne, axis=1) > _LEAST_FORCE)
    names = np.array([state.contact_names.index(name) for name in scene.geom_names])
    contacts = PeopleContacts(
        places.frame[pressing],
        # The pair is reversed, because the object pushes the person.
        names[places.geoms[pressing, ::-1]],
        state.contact_names,
        places.point[pressing],
        borne[pressing],
        -places.gap[pressing],
        np.full(len(pressing), ContactSource.SOLVED),
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
        "penetration": _penetration(scene, seen.contacts, person, frames),
    }


def _about_point(wrench: np.ndarray, lever: np.ndarray) -> np.ndarray:
    """Return (F, 2, 3) forces, N, and moments, N m, about the point at `lever` (F, 3), m, before the present one."""
    force, moment = wrench[:, :3], wrench[:, 3:]
    return np.stack([force, moment + np.cross(lever, force)], axis=1)


def _still_places(scene: Scene, contacts: Places, moves: Movement, person: int, bodies: np.ndarray) -> Places:
    """Return the places where a person touches, or nearly touches, objects that stand still."""
    persons, on = scene.geom_persons[contacts.geoms], scene.model.geom_bodyid[contacts.geoms]
    still = scene.model.body_weldid[on] == 0
    swapped = (persons[:, 1] == person) & still[:, 0]
    chosen = np.flatnonzero(swapped | ((persons[:, 0] == person) & still[:, 1]))
    frame, geoms, point, normal, friction, gap, _ = contacts
    swapped, geoms, normal = swapped[chosen, None], geoms[chosen], normal[chosen]
    geoms = np.where(swapped, geoms[:, ::-1], geoms)
    normal = np.where(swapped, normal, -normal)
    frame, point, part = frame[chosen], point[chosen], scene.model.geom_bodyid[geoms[:, 0]] - bodies[0]
    speed = moves.velocities[frame, part] + np.cross(moves.turning[frame, part], point - moves.places[frame, part])
    along = np.linalg.norm(speed - (speed * normal).sum(1, keepdims=True) * normal, axis=1)
    return Places(frame, geoms, point, normal, friction[chosen], gap[chosen], along)


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


def _penetration(scene: Scene, contacts: Places, person: int, frames: int) -> np.ndarray:
    """Return the deepest overlaps (F, 2) of a person with another person, and with an object, m."""
    deepest, persons = np.zeros((frames, 2)), scene.geom_persons[contacts.geoms]
    for side in (0, 1):
        other = persons[:, 1 - side]
        of = np.flatnonzero((persons[:, side] == person) & (other != person) & (contacts.gap < 0))
        np.maximum.at(deepest, (contacts.frame[of], (other[of] < 0).astype(int)), -contacts.gap[of])
    return deepest
