"""A room as a MuJoCo specification, read from `scenes/` or from any MJCF file. Missing parts are filled in."""

from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np

from synth.rooms.catalogue import arena_file, room_choices
from synth.rooms.mjcf import read_mjcf

FLOOR, WALL = "floor", "wall"
"""Materials that scenes cover with a finish."""
_OBJECT_BITS = 2**31 - 1
"""Contact bits of rooms and props: they collide with people, never with each other. See synth/people/mjcf.py."""
_FLOOR_TOLERANCE = 0.02
"""Distance from z = 0 within which a surface is the floor, m."""
_FLOOR_SEARCH_RADIUS = 1.5
"""Distance from the origin within which the floor is searched, m."""
_HALF_SIDE = 10.0
"""Half of the side length of a floor that is added, m."""
# Direction, diffuse colour, and whether the light casts a shadow: a light above, and two that brighten the shadows.
_LIGHTS = (
    ((-0.18, 0.13, -1.0), 0.46, True),
    ((0.6, -0.5, -0.5), 0.20, False),
    ((-0.6, -0.6, -0.35), 0.16, False),
)


class Room(NamedTuple):
    """A room.

    Attributes:
        spec: Its specification; people, props and cameras are added to it.
        filled: Descriptions of all additions and changes, one clause each; empty for the rooms of `scenes/`.
    """

    spec: mujoco.MjSpec
    filled: tuple[str, ...]


def load_room(arena: str) -> Room:
    """Read a room of `scenes/`, or any MJCF file.

    A file that was not written as a room lacks some parts that a scene needs. Contacts with people, a floor at z = 0
    and lights are then added. Joints, keyframes and physics options are removed.

    Args:
        arena: Name of a room, or path of an MJCF file.

    Raises:
        ValueError: there is no such room, or the file is not MJCF; the message names it.
    """
    path = arena_file(arena)
    spec = read_mjcf(path)
    if arena in room_choices():
        return Room(spec, ())
    try:
        return Room(spec, tuple(_filled(spec)))
    except ValueError as error:
        raise ValueError(f"{path}: {' '.join(str(error).split())}") from None


def room_name(arena: str) -> str:
    """Return the name of a room of `scenes/`, or the absolute path of another file. Both are valid in any folder."""
    return arena if arena in room_choices() else str(Path(arena_file(arena)).resolve())


def _filled(spec: mujoco.MjSpec):
    """Add the missing parts of a room, and yield a description of each."""
    if taken := _remove_joints(spec):
        yield f"left out {taken}: rooms are static"
    _reset_options(spec)
    for geom in spec.geoms:
        if geom.contype or geom.conaffinity:
            geom.contype, geom.conaffinity = 0, _OBJECT_BITS
    floor = _floor_geoms(spec)
    if not floor:
        floor = [spec.worldbody.add_geom(
            name=_free_name(spec.geoms, FLOOR), type=mujoco.mjtGeom.mjGEOM_PLANE, size=[_HALF_SIDE, _HALF_SIDE, 0.1],
            conaffinity=_OBJECT_BITS, contype=0,
        )]  # fmt: skip
        yield f"added a floor at z = 0, {2 * _HALF_SIDE:g} m by {2 * _HALF_SIDE:g} m: the file has no surface there"
    for geom in floor:
        if not geom.conaffinity:
            geom.conaffinity = _OBJECT_BITS
            yield f"made {geom.name or 'the floor'!r} solid: people stand on it"
    bare = [geom for geom in floor if not geom.material]
    if bare and spec.material(FLOOR) is None:
        spec.add_material(name=FLOOR, texrepeat=[0.8, 0.8], texuniform=True, specular=0.08, shininess=0.15)
        for geom in bare:
            geom.material = FLOOR
        yield f"gave the floor a material named {FLOOR!r}, which scene.randomize covers"
    if not spec.lights:
        for number, (direction, strength, shadow) in enumerate(_LIGHTS):
            spec.worldbody.add_light(
                name=_free_name(spec.lights, f"light{number}"), type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
                pos=[-4 * x for x in direction], dir=direction, diffuse=[strength] * 3, castshadow=shadow,
            )  # fmt: skip
        spec.visual.headlight.ambient, spec.visual.headlight.diffuse = [0.4] * 3, [0.1] * 3
        yield f"added {len(_LIGHTS)} lights: the file has none"


def _remove_joints(spec: mujoco.MjSpec) -> str:
    """Remove joints and all elements that depend on them, and return a description of the removed elements."""
    counts = {}
    # Elements that refer to joints are removed before the joints.
    for name in ("keys", "sensors", "actuators", "equalities", "tendons", "joints"):
        parts = list(getattr(spec, name))
        for part in parts:
            spec.delete(part)
        if parts:
            counts[name] = len(parts)
    return ", ".join(f"{count} {name}" for name, count in counts.items())


def _reset_options(spec: mujoco.MjSpec) -> None:
    usual = mujoco.MjSpec().option
    for name in dir(usual):
        value = getattr(usual, name)
        if not name.startswith("_") and not callable(value):
            setattr(spec.option, name, value)


def _floor_geoms(spec: mujoco.MjSpec) -> list[mujoco.MjsGeom]:
    """Return the geoms that people around the origin stand on; an empty list if most of the ground is missing."""
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    places = [
        (x, y)
        for x in (-_FLOOR_SEARCH_RADIUS, 0.0, _FLOOR_SEARCH_RADIUS)
        for y in (-_FLOOR_SEARCH_RADIUS, 0.0, _FLOOR_SEARCH_RADIUS)
    ]
    found, geom = [], np.zeros(1, np.int32)
    for place in places:
        # mj_multiRay misses some geoms if a ray is exactly vertical.
        distance = mujoco.mj_ray(model, data, (*place, _FLOOR_TOLERANCE), (0, 0, -1), None, 1, -1, geom)
        if 0 <= distance <= 2 * _FLOOR_TOLERANCE:
            found.append(int(geom[0]))
    return [spec.geoms[each] for each in sorted(set(found))] if len(found) > len(places) / 2 else []


def _free_name(elements, name: str) -> str:
    taken = {element.name for element in elements}
    return name if name not in taken else _free_name(elements, f"{name}_")
