"""The available rooms and props: each is one MJCF file in `scenes/` or `scenes/props/`.

A room has its floor at z = 0 and people around the origin. It has a material "floor", a material "wall", and lights.
All custom elements are optional: a text "help" of one line; texts "floor" and "wall" that list the possible finishes
(`synth.rooms.decor`), with the default finish first; a numeric "props" with the least and greatest number of props for
`scene=<room>`. Materials with names that start with "tint" take any colour. The geoms of a room collide with people
(contype 0, all bits of conaffinity), except for decoration, which takes no space. Walls are planes, so that cameras can
look through them from outside.
"""

from pathlib import Path
from xml.etree import ElementTree

from dmae.data.resources import resource_folder
from dmae.registry import unknown


def arena_file(name: str) -> Path:
    """Return the MJCF file of a room of `scenes/`, or of a path.

    Raises:
        ValueError: there is no such room or file; the message lists the rooms.
    """
    return _find(name, _folder(), "arena")


def prop_file(name: str) -> Path:
    """Return the MJCF file of a prop of `scenes/props/`, or of a path. Raises the same errors as `arena_file`."""
    return _find(name, _folder() / "props", "prop")


def room_choices() -> dict[str, str]:
    """Return the line of help of each room, sorted by name."""
    return {name: _custom(name, "text", "help") or "" for name in _names(_folder())}


def room_presets() -> dict[str, dict]:
    """Return for each room the values that `scene=<room>` gives to the options `scene.*`."""
    presets = {}
    for name in _names(_folder()):
        props = _custom(name, "numeric", "props")
        presets[name] = {"arena": name} | ({"props": [int(count) for count in props.split()]} if props else {})
    return presets


def _folder() -> Path:
    return resource_folder("synth", "scenes")


def _names(folder: Path) -> list[str]:
    return sorted(path.stem for path in folder.glob("*.xml"))


def _find(name: str, folder: Path, what: str) -> Path:
    for path in (folder / f"{name}.xml", Path(name)):
        if path.is_file():
            return path
    if Path(name).suffix:
        raise FileNotFoundError(f"{name}: no such file; expected an MJCF file, or one of {', '.join(_names(folder))}")
    raise ValueError(f"{unknown(what, name, _names(folder))}, and the path of an MJCF file names another")


def _custom(room: str, kind: str, name: str) -> str | None:
    """Return the data of a custom element of a room; None if there is none."""
    element = ElementTree.parse(_folder() / f"{room}.xml").find(f"custom/{kind}[@name='{name}']")
    return None if element is None else element.get("data")
