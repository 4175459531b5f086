"""The rooms that there are, and your own meshes as props."""

from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from dmae.data.resources import resource_folder
from dmae.data.typed import Configuration
from synth.checks import check_range


def room_choices() -> dict[str, str]:
    """Return the line of help of each room, sorted by name."""
    return {name: _custom(name, "text", "help") or "" for name in mjcf_names(room_folder())}


def room_presets() -> dict[str, dict]:
    """Return for each room the values that `scene=<room>` gives to the options `scene.*`."""
    presets = {}
    for name in mjcf_names(room_folder()):
        props = _custom(name, "numeric", "props")
        presets[name] = {"arena": name} | ({"props": [int(count) for count in props.split()]} if props else {})
    return presets


def room_folder() -> Path:
    """Return the folder of the MJCF files of rooms."""
    return resource_folder("synth", "scenes")


def mjcf_names(folder: Path) -> list[str]:
    """Return the names of the MJCF files in a folder, sorted."""
    return sorted(path.stem for path in folder.glob("*.xml"))


def _custom(room: str, kind: str, name: str) -> str | None:
    """Return the data of a custom element of a room; None if there is none."""
    element = ElementTree.parse(room_folder() / f"{room}.xml").find(f"custom/{kind}[@name='{name}']")
    return None if element is None else element.get("data")


class MeshUp(Enum):
    """The axis of a mesh file that points up."""

    auto = "auto"
    """y in .glb files, as their format defines it; z in other files."""
    y = "y"
    z = "z"


@dataclass(frozen=True)
class PropsConfig(Configuration):
    """Your own meshes, used instead of `scene.prop_kinds`."""

    path: str = field(default="", metadata={"reads": "path"})
    """A mesh file (.obj, .stl, .ply, .glb) or a folder of them; empty for none."""
    scale: float = 1.0
    """Metres per unit of the files; 0.001 for files in millimetres."""
    up: MeshUp = MeshUp.auto
    """The axis of the files that points up."""

    def __post_init__(self):
        super().__post_init__()
        check_range("props", self, 0, np.inf, "scale", above=True, unit=" metres per unit of the mesh files")
        if not self.path and (self.scale != 1.0 or self.up is not MeshUp.auto):
            raise ValueError("props.scale and props.up say how meshes are read, but props.path names none")
