"""Props: MJCF files of primitives and the user's triangle meshes, and the floor space that they cover."""

import io
import json
import re
import struct
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import mujoco
import numpy as np
import trimesh

from dmae.files.contents import cached_until_changed, check_file, read_bytes
from dmae.files.structured import parse_json
from synth.rooms.config import MeshUp
from synth.rooms.rays import at_rest
from synth.rooms.room import compile_mjcf, prop_file, read_mjcf

_TALLEST = 2.2
"""Height above which objects do not restrict people, m."""


@cached_until_changed(32)
def footprints(path: Path) -> np.ndarray:
    """Return the (K, 3) `discs` of the obstacles in an MJCF file, m."""
    return discs(compile_mjcf(path))


def discs(model: mujoco.MjModel) -> np.ndarray:
    """Return (K, 3) x, y and radius of discs that cover the obstacles of a model, m.

    Each body counts as a rectangle along its own axes. A row of discs along the longer side covers it.
    """
    data = at_rest(model)
    found = [np.empty((0, 3))]
    obstacles = (model.geom_type != mujoco.mjtGeom.mjGEOM_PLANE) & (model.geom_contype | model.geom_conaffinity > 0)
    for body in range(model.nbody):
        geoms = np.flatnonzero((model.geom_bodyid == body) & obstacles)
        if body and len(geoms):
            found.append(_cover(model, data, body, geoms))
        else:
            found += [_cover(model, data, body, geoms[i : i + 1]) for i in range(len(geoms))]
    return np.concatenate(found)


def geom_corners(model: mujoco.MjModel, data: mujoco.MjData, geoms: np.ndarray) -> np.ndarray:
    """Return (G, 8, 3) corners of boxes around geoms (G,), m, world. The kinematics of `data` must be up to date."""
    corners = np.array(np.meshgrid(*[(-1, 1)] * 3)).reshape(3, -1).T
    boxes = model.geom_aabb[geoms]
    local = boxes[:, None, :3] + corners * boxes[:, None, 3:]
    return data.geom_xpos[geoms][:, None] + local @ data.geom_xmat[geoms].reshape(-1, 3, 3).transpose(0, 2, 1)


def _cover(model: mujoco.MjModel, data: mujoco.MjData, body: int, geoms: np.ndarray) -> np.ndarray:
    world = geom_corners(model, data, geoms)
    if world[..., 2].min() > _TALLEST:
        return np.empty((0, 3))
    axes = data.xmat[body].reshape(3, 3)[:2, :2]
    flat = world[..., :2].reshape(-1, 2) @ axes
    low, high = flat.min(0), flat.max(0)
    half = (high - low) / 2
    long, short = (0, 1) if half[0] >= half[1] else (1, 0)
    count = int(np.clip(np.ceil(half[long] / max(half[short], 0.05)), 1, 12))
    centres = np.tile((low + high) / 2, (count, 1))
    centres[:, long] = low[long] + (np.arange(count) + 0.5) * 2 * half[long] / count
    radius = np.hypot(half[short], half[long] / count)
    return np.column_stack([centres @ axes.T, np.full(count, radius)])


# Checks of mesh files before they are parsed: stated counts must fit the file size, and only files of the same folder
# are read.

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


# Meshes: find the files, read them, and refuse meshes that cannot be simulated

MESHES = (".obj", ".stl", ".ply", ".glb")
_SMALLEST, _LARGEST = 0.02, 5.0
"""Least and greatest length of the longest side of a prop, m."""
_MOST_FACES, _MOST_BYTES = 200_000, 200 * 2**20
_MOST_PARTS = 64
_FARTHEST = 1e6
"""Greatest coordinate in the file, in any unit."""


class MeshPart(NamedTuple):
    """A connected part of a prop: vertices (N, 3) m, faces (M, 3), and its RGB colour 0..1 if the file gives one."""

    vertices: np.ndarray
    faces: np.ndarray
    colour: tuple[float, float, float] | None


def find_meshes(path: str) -> list[str]:
    """Return the mesh files of `props.path`, sorted; FileNotFoundError, or ValueError if not a mesh, or none."""
    place = Path(path)
    if not place.exists():
        raise FileNotFoundError(f"props.path: there is no file or folder {path!r}")
    files = sorted(str(p) for p in (place.iterdir() if place.is_dir() else [place]) if p.suffix.lower() in MESHES)
    if not files:
        what = "a folder without meshes" if place.is_dir() else "no mesh"
        raise ValueError(f"props.path: {path!r} is {what}; expected files ending in {', '.join(MESHES)}")
    return files


@cached_until_changed(64)
def load_mesh(path: str, scale: float = 1.0, up: MeshUp = MeshUp.auto) -> tuple[MeshPart, ...]:
    """Return the connected parts of a prop from a mesh file: z up, on the floor, centred above the origin.

    Faces are turned outward. Props of more than 64 parts become one part. Raises ValueError, which says what to do, if
    the file cannot be read, has no triangles or an open surface, or its size does not suit a prop.
    """
    turn = np.eye(3)
    if up is MeshUp.y or (up is MeshUp.auto and Path(path).suffix.lower() == ".glb"):
        turn = np.array([(1, 0, 0), (0, 0, -1), (0, 1, 0)])
    # Faces without an area are left out.
    with np.errstate(divide="ignore", invalid="ignore"):
        meshes = _read(path)
        try:
            pieces: list = [(piece, _colour(mesh)) for mesh in meshes for piece in _pieces(mesh, path)]
        # trimesh raises errors of many types for meshes that it has read.
        except Exception as error:
            if path in str(error):
                raise
            raise ValueError(
                f"{path}: this mesh is broken: {type(error).__name__}: {error}; export it again"
            ) from error
    corners = np.concatenate([piece.vertices for piece, _ in pieces]) @ turn.T
    low, high = corners.min(0), corners.max(0)
    _check_size(path, (high - low) * scale, scale)
    origin = np.array([*(low + high)[:2] / 2, low[2]])
    if len(pieces) > _MOST_PARTS:
        pieces = [(trimesh.util.concatenate([piece for piece, _ in pieces]), pieces[0][1])]
    return tuple(MeshPart((piece.vertices @ turn.T - origin) * scale, piece.faces, colour) for piece, colour in pieces)


def _read(path: str) -> list[trimesh.Trimesh]:
    file = Path(path)
    if (size := check_file(file)) > _MOST_BYTES:
        raise ValueError(f"{path}: {size / 2**20:.0f} MiB are too large for a prop; simplify it to {_MOST_FACES} faces")
    data = read_bytes(file)
    try:
        # A file that states more elements than it has bytes would take far more memory.
        counts: list[float] = []
        if file.suffix.lower() == ".ply":
            counts = [float(count) for count in _PLY_ELEMENT.findall(data[:10_000].partition(b"end_header")[0])]
        elif file.suffix.lower() == ".glb":
            counts = _glb_counts(data)
        for count in counts:
            if not 0 <= count <= len(data):
                raise ValueError(f"it states {count:.4g} elements in {len(data)} bytes")
        with np.errstate(all="ignore"):
            scene = trimesh.load_scene(
                io.BytesIO(data), file_type=file.suffix.lower()[1:], resolver=Neighbours(file.parent)
            )
            # Each placement of a mesh counts.
            placed = [scene.geometry[scene.graph[node][1]] for node in scene.graph.nodes_geometry]
            if (faces := sum(len(getattr(mesh, "faces", ())) for mesh in placed)) > _MOST_FACES:
                raise ValueError(f"{faces} faces are too many, at most {_MOST_FACES}; simplify the mesh")
            found = scene.dump()
    # The readers of trimesh can raise errors of any type.
    except Exception as error:
        raise ValueError(f"{path}: this mesh is broken: {type(error).__name__}: {error}; export it again") from error
    meshes = [mesh for mesh in found if isinstance(mesh, trimesh.Trimesh) and len(mesh.faces)]
    if not meshes:
        raise ValueError(f"{path}: this mesh is empty: it holds no triangles; export surfaces, not points or curves")
    if (count := sum(len(mesh.faces) for mesh in meshes)) > _MOST_FACES:
        raise ValueError(f"{path}: {count} faces are too many for a prop, at most {_MOST_FACES}; simplify the mesh")
    return meshes


def _pieces(mesh: trimesh.Trimesh, path: str) -> list[trimesh.Trimesh]:
    """Return the connected parts of a mesh with merged corners. Each part is closed, and all faces point outward."""
    if not np.isfinite(mesh.vertices).all():
        raise ValueError(f"{path}: this mesh is broken: it has vertices that are not finite; export it again")
    if mesh.faces.min() < 0 or mesh.faces.max() >= len(mesh.vertices):
        raise ValueError(f"{path}: this mesh is broken: it has faces of vertices that are not there; export it again")
    if np.abs(mesh.vertices).max() > _FARTHEST:
        raise ValueError(f"{path}: this mesh is broken: it has vertices beyond {_FARTHEST:g}; export it again")
    mesh.merge_vertices(merge_tex=True, merge_norm=True)
    mesh.update_faces(mesh.nondegenerate_faces())
    mesh.remove_unreferenced_vertices()
    if not len(mesh.faces) or not mesh.is_watertight:
        joined = np.bincount(trimesh.grouping.unique_rows(mesh.edges_sorted)[1])
        raise ValueError(
            f"{path}: this mesh is open: {int((joined != 2).sum())} of its {len(joined)} edges do not join two faces; "
            "close its holes, give sheets a thickness, and export it again"
        )
    pieces = list(mesh.split(only_watertight=False))
    for piece in pieces:
        spread = np.linalg.svd(piece.vertices - piece.vertices.mean(0), compute_uv=False)
        if spread[2] < 1e-5 * spread[0]:
            raise ValueError(f"{path}: this mesh is flat: a piece of it encloses no volume; give it a thickness")
        trimesh.repair.fix_normals(piece)
    return pieces


def _check_size(path: str, size: np.ndarray, scale: float) -> None:
    longest = size.max()
    if _SMALLEST <= longest <= _LARGEST:
        return
    what = "huge" if longest > _LARGEST else "tiny"
    units = {1e-3: "millimetres", 1e-2: "centimetres", 0.0254: "inches"}
    likely = next((unit for unit in units if 0.1 <= longest * unit / scale <= 3.0), None)
    hint = f"props.scale={likely:g} if the file is in {units[likely]}" if likely else "another props.scale"
    raise ValueError(
        f"{path}: this mesh is {what}: {size[0]:.3g} x {size[1]:.3g} x {size[2]:.3g} m at props.scale={scale:g}, "
        f"where {_SMALLEST} to {_LARGEST:.0f} m are expected; choose {hint}"
    )


def _colour(mesh: trimesh.Trimesh) -> tuple[float, float, float] | None:
    visual: Any = mesh.visual
    if not visual.defined:
        return None
    colour = (getattr(visual, "material", None) or visual).main_color
    red, green, blue = (round(int(channel) / 255, 3) for channel in colour[:3])
    return red, green, blue


# Props of either kind


def prop_spec(kind: str, scale: float = 1.0, up: MeshUp = MeshUp.auto) -> mujoco.MjSpec:
    """Return the MuJoCo specification of one prop: a name in `scenes/props/`, or an MJCF or mesh file.

    A material "tint" of the prop takes any colour. The triangles of a mesh stop rays; the convex hull of each connected
    part stops people. Raises ValueError if there is no such prop, or its mesh cannot be simulated.
    """
    if Path(kind).suffix.lower() not in MESHES:
        return read_mjcf(prop_file(kind))
    prop = mujoco.MjSpec()
    prop.add_material(name="tint", rgba=[0.62, 0.60, 0.56, 1], specular=0.1, shininess=0.1)
    body = prop.worldbody.add_body(name=Path(kind).stem)
    for number, part in enumerate(load_mesh(kind, scale, up)):
        name = f"part{number}"
        prop.add_mesh(
            name=name,
            uservert=part.vertices.ravel(),
            userface=part.faces.ravel(),
            maxhullvert=64,
            inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL,
        )
        if part.colour:
            prop.add_material(name=name, rgba=[*part.colour, 1], specular=0.1, shininess=0.1)
        body.add_geom(
            type=mujoco.mjtGeom.mjGEOM_MESH,
            meshname=name,
            material=name if part.colour else "tint",
            # Contact bits of all objects: see synth/people/mjcf.py.
            contype=0,
            conaffinity=2**31 - 1,
        )
    return prop


class PlacedProp(NamedTuple):
    """A prop in a scene: kind as in `scenes/props/` or a file, position, m, and heading, rad."""

    kind: str
    at: tuple[float, float]
    yaw: float


@dataclass(frozen=True)
class PropSize:
    """The space that a prop takes."""

    discs: np.ndarray  # (K, 3) x, y and radius of discs that cover it on the floor, m
    size: np.ndarray  # (3,) size of its bounding box along its own axes, m
    reach: np.ndarray  # (3,) greatest x, y and z of the box, m, rounded to the micrometre

    @property
    def face(self) -> float:
        """The area of the largest upright face of the bounding box, m^2."""
        return float(self.size[:2].max() * self.size[2])


def _file(kind: str) -> Path:
    return Path(kind) if Path(kind).suffix.lower() in MESHES else prop_file(kind)


@cached_until_changed(64, _file)
def prop_size(kind: str, scale: float = 1.0, up: MeshUp = MeshUp.auto) -> PropSize:
    """Return the space that a prop takes. Raises the same errors as `prop_spec`."""
    model = prop_spec(kind, scale, up).compile()
    corners = geom_corners(model, at_rest(model), np.arange(model.ngeom)).reshape(-1, 3)
    return PropSize(discs(model), np.ptp(corners, axis=0), corners.max(0).round(6))
