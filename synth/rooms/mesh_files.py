"""Checks of mesh files before they are parsed: stated counts must fit the file size, and only files of the same folder
are read."""

import json
import re
import struct
from collections.abc import Iterator, Mapping
from pathlib import Path

import trimesh

from dmae.files.contents import read_bytes
from dmae.files.structured import parse_json

_MOST_NEIGHBOUR = 16 << 20
"""Greatest size of a material or texture file of a mesh, bytes."""
_PLY_ELEMENT = re.compile(rb"^element\s+\S+\s+(\S+)", re.MULTILINE)
_GLB_HEAD = struct.Struct("<4sIIII")


class Neighbours(Mapping):
    """Files in the folder of a mesh, by name. Files of other folders cannot be reached."""

    def __init__(self, folder: Path):
        self.folder = folder.resolve()

    def __getitem__(self, name: str) -> bytes:
        path = (self.folder / str(name).strip()).resolve()
        if not path.is_relative_to(self.folder):
            raise FileNotFoundError(f"{name}: outside the folder of the mesh")
        try:
            return read_bytes(path, _MOST_NEIGHBOUR)
        except ValueError as error:
            raise FileNotFoundError(str(error)) from None

    def __iter__(self) -> Iterator[str]:
        return iter(sorted(path.name for path in self.folder.iterdir()))

    def __len__(self) -> int:
        return len(list(self.folder.iterdir()))


def check_counts(suffix: str, data: bytes) -> None:
    """Raise ValueError if a file states more elements than it has bytes; the message gives both numbers."""
    counts: list[float] = []
    if suffix == ".ply":
        counts = [float(count) for count in _PLY_ELEMENT.findall(data[:10_000].partition(b"end_header")[0])]
    elif suffix == ".glb":
        counts = _glb_counts(data)
    for count in counts:
        if not 0 <= count <= len(data):
            raise ValueError(f"it states {count:.4g} elements in {len(data)} bytes")


def _glb_counts(data: bytes) -> list[float]:
    """Return the numbers of elements that the accessors of a glTF file state. Their data must be in the same file."""
    magic, _, _, length, kind = _GLB_HEAD.unpack_from(data)
    if magic != b"glTF" or kind != 0x4E4F534A or length > len(data):
        raise ValueError("its header is not glTF's")
    tree = parse_json(data[_GLB_HEAD.size : _GLB_HEAD.size + length].decode())
    if not isinstance(tree, dict):
        raise ValueError("its JSON is no object")
    counts = []
    for accessor in tree.get("accessors", []):
        if "bufferView" not in accessor or "sparse" in accessor:
            raise ValueError("an accessor has no data of its own")
        counts.append(float(accessor["count"]))
    for image in [*tree.get("images", []), *tree.get("buffers", [])]:
        if "uri" in image:
            raise ValueError(f"it names {json.dumps(image['uri'])[:60]}, expected all data in the file")
    return counts


def check_repetition(scene: trimesh.Scene, most: int) -> None:
    """Raise ValueError if the placed meshes of a scene have more than `most` faces, counted once per placement."""
    placed = [scene.geometry[scene.graph[node][1]] for node in scene.graph.nodes_geometry]
    faces = sum(len(getattr(mesh, "faces", ())) for mesh in placed)
    if faces > most:
        raise ValueError(f"{faces} faces are too many, at most {most}; simplify the mesh")
