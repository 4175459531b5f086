"""The available rooms and props: each is one MJCF file in `scenes/` or `scenes/props/`.

A room has its floor at z = 0 and people around the origin. It has a material "floor", a material "wall", and lights.
All custom elements are optional: a text "help" of one line; texts "floor" and "wall" that list the possible finishes
(`synth.rooms.decor`), with the default finish first; a numeric "props" with the least and greatest number of props for
`scene=<room>`. Materials with names that start with "tint" take any colour. The geoms of a room collide with people
(contype 0, all bits of conaffinity), except for decoration, which takes no space. Walls are planes, so that cameras can
look through them from outside.
"""

from dataclasses import dataclass, field
from itertools import product
from math import prod
from pathlib import Path
from typing import NamedTuple
from xml.etree.ElementTree import Element

import mujoco
import numpy as np

from dmae.files.checks import check_numbers
from dmae.files.contents import check_file, read_text
from dmae.files.images import check_image
from dmae.files.structured import parse_xml
from dmae.nearest import unknown
from synth.rooms.config import mjcf_names, room_folder
from synth.rooms.rays import at_rest


def arena_file(name: str) -> Path:
    """Return the MJCF file of a room of `scenes/`, or of a path; ValueError, with all rooms, if there is none."""
    return _find(name, room_folder(), "arena")


def prop_file(name: str) -> Path:
    """Return the MJCF file of a prop of `scenes/props/`, or of a path. Raises the same errors as `arena_file`."""
    return _find(name, room_folder() / "props", "prop")


def _find(name: str, folder: Path, what: str) -> Path:
    for path in (folder / f"{name}.xml", Path(name)):
        if path.is_file():
            return path
    if Path(name).suffix:
        raise FileNotFoundError(
            f"{name}: no such file; expected an MJCF file, or one of {', '.join(mjcf_names(folder))}"
        )
    raise ValueError(f"{unknown(what, name, mjcf_names(folder))}, and the path of an MJCF file names another")


# MJCF files may be untrusted: they can read no file outside their folder. A file is checked before MuJoCo reads it: its
# included files, meshes and textures, its numbers, and how many elements a short text expands to. Paths follow MuJoCo's
# documentation: `meshdir`, `texturedir` and `assetdir` apply to meshes and textures, and includes are relative to the
# file itself.

_MOST_TEXT, _MOST_ASSET = 4 << 20, 200 << 20
"""Greatest size of an MJCF file, and of a mesh or texture file, bytes."""
_MOST_DEPTH, _MOST_ELEMENTS, _MOST_INCLUDES = 64, 10_000, 32
"""Greatest depth of nested elements, number of elements (repeated elements count each time), and depth of includes."""
_MOST_NUMBER, _FARTHEST = 1e9, 1e5
"""Greatest number in any attribute, and greatest size or position, m."""
_BITS = {"contype", "conaffinity", "collision", "group"}
"""Attributes with bits or numbers of groups, which are not quantities."""
_PRODUCTS = {
    "hfield": (("nrow", "ncol"), 1 << 22),
    "numeric": (("size",), 1 << 16),
    "global": (("offwidth", "offheight"), 1 << 26),
    "camera": (("resolution",), 1 << 26),
    "composite": (("count",), 1000),
    "flexcomp": (("count",), 1000),
}
"""By element: attributes, and the greatest value of their product. MuJoCo allocates memory in proportion to it."""
_GREATEST = {
    ("texture", "width"): 4096,
    ("texture", "height"): 6 * 4096,
    ("quality", "shadowsize"): 16384,
    ("quality", None): 1000,
    ("mesh", "params"): 128,
    ("size", "njmax"): 1e6,
    ("size", "nconmax"): 1e6,
    ("size", "nuserdata"): 1e6,
    ("size", "nstack"): 1e8,
    ("size", "memory"): 256e6,
    ("size", None): 1000,
    (None, "dim"): 1e4,
    (None, "actdim"): 1e4,
    (None, "nsample"): 1e4,
}
"""Greatest number by element and attribute, for the same reason; None means any other element or attribute."""
_UNITS = {"k": 1e3, "m": 1e6, "g": 1e9, "t": 1e12, "p": 1e15, "e": 1e18}
_FOLDERS = {"mesh": "meshdir", "hfield": "meshdir", "flexcomp": "meshdir", "skin": "meshdir", "texture": "texturedir"}
_UNSUPPORTED = ("plugin", "extension", "model", "attach")


@dataclass
class _Found:
    """The elements and file names that have been read so far."""

    folder: Path
    dirs: list[tuple[str, str]] = field(default_factory=list)
    """Attributes of `compiler` that name folders."""
    assets: list[tuple[Path, str, str]] = field(default_factory=list)
    """For each asset: the file that names it, its element, and its name."""
    elements: int = 0


def read_mjcf(path: Path) -> mujoco.MjSpec:
    """Return the room or prop of an MJCF file.

    Raises FileNotFoundError, or ValueError if it is malformed, refers to a file outside its folder, or is too large;
    the message names both files.
    """
    path = Path(path)
    found = _Found(path.resolve().parent)
    _read(path, found, ())
    for file, kind, name in found.assets:
        folders = ["", *(folder for key, folder in found.dirs if key in ("assetdir", _FOLDERS.get(kind)))]
        for asset in _existing(found, file, kind, [Path(folder) / name for folder in folders]):
            check_file(asset, _MOST_ASSET)
            if asset.suffix.lower() in (".png", ".jpg", ".jpeg", ".bmp"):
                check_image(asset)
    try:
        return mujoco.MjSpec.from_file(str(path))
    except (ValueError, mujoco.FatalError) as error:
        raise ValueError(f"{path}: {' '.join(str(error).split())}") from None


def compile_mjcf(path: Path) -> mujoco.MjModel:
    """Return the model of an MJCF file. Raises the same errors as `read_mjcf`."""
    spec = read_mjcf(path)
    try:
        model = spec.compile()
    except (ValueError, mujoco.FatalError) as error:
        raise ValueError(f"{path}: {' '.join(str(error).split())}") from None
    solid = model.geom_type != mujoco.mjtGeom.mjGEOM_PLANE
    check_numbers(f"{path}: sizes of geoms, m", model.geom_size[solid], _FARTHEST)
    check_numbers(f"{path}: positions of geoms, m", model.geom_pos, _FARTHEST)
    check_numbers(f"{path}: positions of bodies, m", model.body_pos, _FARTHEST)
    return model


def _read(path: Path, found: _Found, above: tuple[Path, ...]) -> None:
    text = read_text(path, _MOST_TEXT)
    try:
        root = parse_xml(text, _MOST_DEPTH)
    except ValueError as error:
        raise ValueError(f"{path}: expected MJCF, {error}") from None
    if root.tag not in ("mujoco", "mujocoinclude"):
        raise ValueError(f"{path}: expected MJCF, <mujoco>, found <{root.tag:.40}>")
    try:
        found.elements += _count(root)
        if found.elements > _MOST_ELEMENTS:
            raise ValueError(f"expected at most {_MOST_ELEMENTS} elements, found {found.elements}")
        for element in root.iter():
            _check_element(element)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None
    for element in root.iter():
        _follow(path, element, found, (*above, path.resolve()))


def _count(element: Element) -> int:
    """Return the number of elements within an element. Elements in a `replicate` count once per repetition."""
    inside = sum(map(_count, element))
    times = 1.0
    if element.tag == "replicate":
        times = max(_numbers(element.get("count", "1")))
        if any(True for _ in element.iter("include")):
            raise ValueError("<replicate> repeats an <include>; write out what is repeated")
    return int(min(1 + max(times, 1) * inside, 1e18))


def _check_element(element: Element) -> None:
    """Raise ValueError for invalid numbers, and for sizes that make MuJoCo allocate too much memory."""
    tag, values = element.tag, element.attrib
    if tag in _UNSUPPORTED:
        raise ValueError(f"<{tag}>: rooms and props are read without plugins and models in models")
    for name, value in values.items():
        most = _GREATEST.get((tag, name), _GREATEST.get((None, name), _GREATEST.get((tag, None), _MOST_NUMBER)))
        if name not in _BITS and not all(abs(number) <= most for number in _numbers(value)):
            raise ValueError(f"<{tag} {name}={value!r:.60}>: expected numbers up to {most:g}")
    if tag in _PRODUCTS:
        names, most = _PRODUCTS[tag]
        size = prod(number for name in names for number in _numbers(values.get(name, "")) if number > 0)
        if size > most:
            raise ValueError(f"<{tag}>: expected {' x '.join(names)} of at most {most}, found {size:.4g}")


def _numbers(text: str) -> list[float]:
    """Return the numbers in an attribute. A unit of memory ("K", "M", ...) multiplies its number; words count as 0."""
    found = []
    for word in text.split():
        unit = _UNITS.get(word[-1].lower(), 1.0)
        try:
            found.append(float(word if unit == 1 else word[:-1]) * unit)
        except ValueError:
            found.append(0.0)
    return found or [0.0]


def _follow(path: Path, element: Element, found: _Found, above: tuple[Path, ...]) -> None:
    """Add the files that an element names to `found`, and read included files."""
    for name, value in element.attrib.items():
        if element.tag == "compiler" and name in ("assetdir", "meshdir", "texturedir"):
            found.dirs.append((name, value))
            _existing(found, path, element.tag, [Path(value)])
        elif name.startswith("file") and element.tag == "include":
            for file in _existing(found, path, element.tag, [Path(value)]):
                if file in above or len(above) > _MOST_INCLUDES:
                    raise ValueError(f"{path}: <include file={value!r:.80}> includes itself")
                _read(file, found, above)
        elif name.startswith("file"):
            found.assets.append((path, element.tag, value))


def _existing(found: _Found, path: Path, kind: str, names: list[Path]) -> list[Path]:
    """Return existing files among names, in the first file's folder or the naming one's; ValueError if they lead out of
    it."""
    places = []
    for name in names:
        for folder in (found.folder, path.resolve().parent):
            try:
                whole = (folder / name).resolve()
                found_there = whole.exists()
            except (OSError, ValueError, RuntimeError):
                whole, found_there = Path("/"), False
            if name.is_absolute() or not whole.is_relative_to(found.folder):
                raise ValueError(
                    f"{path}: <{kind}> names {str(name)!r:.120}, expected a file in {found.folder} or below it"
                )
            if found_there:
                places.append(whole)
    if not places:
        raise FileNotFoundError(f"{path}: <{kind}> names {str(names[-1])!r:.120}, found no such file")
    return list(dict.fromkeys(places))


# A room as a MuJoCo specification; missing parts are filled in

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
_LIGHTS = (((-0.18, 0.13, -1.0), 0.46, True), ((0.6, -0.5, -0.5), 0.20, False), ((-0.6, -0.6, -0.35), 0.16, False))


class Room(NamedTuple):
    """A room."""

    spec: mujoco.MjSpec  # Its specification; people, props and cameras are added to it
    # Descriptions of all additions and changes, one clause each; empty for the rooms of `scenes/`
    filled: tuple[str, ...]


def load_room(arena: str) -> Room:
    """Read a room of `scenes/`, or any MJCF file.

    A file that was not written as a room lacks some parts that a scene needs. Contacts with people, a floor at z = 0
    and lights are then added. Joints, keyframes and physics options are removed. Raises ValueError if there is no such
    room, or the file is not MJCF.
    """
    path = arena_file(arena)
    spec = read_mjcf(path)
    if arena in mjcf_names(room_folder()):
        return Room(spec, ())
    try:
        return Room(spec, tuple(_fill(spec)))
    except ValueError as error:
        raise ValueError(f"{path}: {' '.join(str(error).split())}") from None


def room_name(arena: str) -> str:
    """Return the name of a room of `scenes/`, or the absolute path of another file. Both are valid in any folder."""
    return arena if arena in mjcf_names(room_folder()) else str(Path(arena_file(arena)).resolve())


def _fill(spec: mujoco.MjSpec) -> list[str]:
    """Add the missing parts of a room, and return a description of each."""
    taken = _remove_joints(spec)
    usual = mujoco.MjSpec().option
    for name in dir(usual):
        if not name.startswith("_") and not callable(getattr(usual, name)):
            setattr(spec.option, name, getattr(usual, name))
    for geom in spec.geoms:
        if geom.contype or geom.conaffinity:
            geom.contype, geom.conaffinity = 0, _OBJECT_BITS
    return [*([f"left out {taken}: rooms are static"] if taken else []), *_fill_floor(spec), *_fill_lights(spec)]


def _fill_floor(spec: mujoco.MjSpec) -> list[str]:
    """Make sure that people stand on a solid floor with a material; return what was done."""
    done, floor = [], _floor_geoms(spec)
    if not floor:
        floor = [spec.worldbody.add_geom(
            name=_free_name(spec.geoms, FLOOR), type=mujoco.mjtGeom.mjGEOM_PLANE, size=[_HALF_SIDE, _HALF_SIDE, 0.1],
            conaffinity=_OBJECT_BITS, contype=0,
        )]  # fmt: skip
        size = f"{2 * _HALF_SIDE:g} m by {2 * _HALF_SIDE:g} m"
        done.append(f"added a floor at z = 0, {size}: the file has no surface there")
    for geom in floor:
        if not geom.conaffinity:
            geom.conaffinity = _OBJECT_BITS
            done.append(f"made {geom.name or 'the floor'!r} solid: people stand on it")
    bare = [geom for geom in floor if not geom.material]
    if bare and spec.material(FLOOR) is None:
        spec.add_material(name=FLOOR, texrepeat=[0.8, 0.8], texuniform=True, specular=0.08, shininess=0.15)
        for geom in bare:
            geom.material = FLOOR
        done.append(f"gave the floor a material named {FLOOR!r}, which scene.randomize covers")
    return done


def _fill_lights(spec: mujoco.MjSpec) -> list[str]:
    """Add lights to a room that has none, or none that shine; return what was done."""
    head = spec.visual.headlight
    lit = any(light.active and (np.any(light.diffuse) or np.any(light.ambient)) for light in spec.lights)
    shone = head.active and (np.any(head.diffuse) or np.any(head.ambient))
    if spec.lights and (lit or shone):
        return []
    more = " that shine" if spec.lights else ""
    for number, (direction, strength, shadow) in enumerate(_LIGHTS):
        spec.worldbody.add_light(
            name=_free_name(spec.lights, f"light{number}"), type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
            pos=[-4 * x for x in direction], dir=direction, diffuse=[strength] * 3, castshadow=shadow,
        )  # fmt: skip
    head.active, head.ambient, head.diffuse = 1, [0.4] * 3, [0.1] * 3
    return [f"added {len(_LIGHTS)} lights: the file has none{more}"]


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


def _floor_geoms(spec: mujoco.MjSpec) -> list[mujoco.MjsGeom]:
    """Return the geoms that people around the origin stand on; an empty list if most of the ground is missing."""
    model = spec.compile()
    data = at_rest(model)
    places = list(product((-_FLOOR_SEARCH_RADIUS, 0.0, _FLOOR_SEARCH_RADIUS), repeat=2))
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
