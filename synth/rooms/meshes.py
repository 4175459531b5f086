"""The user's triangle meshes as props: find the files, read them, and refuse meshes that cannot be simulated."""

import io
from enum import Enum
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
import trimesh

from dmae.files.contents import check_file, read_bytes
from synth.rooms.mesh_files import Neighbours, check_counts, check_repetition

MESHES = (".obj", ".stl", ".ply", ".glb")
_SMALLEST, _LARGEST = 0.02, 5.0
"""Least and greatest length of the longest side of a prop, m."""
_MOST_FACES, _MOST_BYTES = 200_000, 200 * 2**20
_MOST_PARTS = 64
_FARTHEST = 1e6
"""Greatest coordinate in the file, in any unit."""


class MeshUp(Enum):
    """The axis of a mesh file that points up."""

    auto = "auto"
    """y in .glb files, as their format defines it; z in other files."""
    y = "y"
    z = "z"


class MeshPart(NamedTuple):
    """A connected part of a prop: vertices (N, 3) m, faces (M, 3), and its RGB colour 0..1 if the file gives one."""

    vertices: np.ndarray
    faces: np.ndarray
    colour: tuple[float, float, float] | None


def find_meshes(path: str) -> list[str]:
    """Return the mesh files of `props.path`, sorted.

    Raises:
        FileNotFoundError: there is no such file or folder.
        ValueError: the file is not a mesh, or the folder contains no mesh.
    """
    place = Path(path)
    if not place.exists():
        raise FileNotFoundError(f"props.path: there is no file or folder {path!r}")
    files = sorted(str(p) for p in (place.iterdir() if place.is_dir() else [place]) if p.suffix.lower() in MESHES)
    if not files:
        what = "a folder without meshes" if place.is_dir() else "no mesh"
        raise ValueError(f"props.path: {path!r} is {what}; expected files ending in {', '.join(MESHES)}")
    return files


@lru_cache(maxsize=64)
def load_mesh(path: str, scale: float = 1.0, up: MeshUp = MeshUp.auto) -> tuple[MeshPart, ...]:
    """Return the connected parts of a prop from a mesh file: z up, on the floor, centred above the origin.

    Faces are turned outward. Props of more than 64 parts become one part.

    Raises:
        ValueError: the file cannot be read, contains no triangles, or has an open surface, or its size does not suit a
            prop; the message names the file and says what to do.
    """
    turn = np.eye(3)
    if up is MeshUp.y or (up is MeshUp.auto and Path(path).suffix.lower() == ".glb"):
        turn = np.array([(1, 0, 0), (0, 0, -1), (0, 1, 0)])
    # Faces without an area are left out.
    with np.errstate(divide="ignore", invalid="ignore"):
        meshes = _read(path)
        try:
            pieces = [(piece, _colour(mesh)) for mesh in meshes for piece in _pieces(mesh, path)]
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
    """Return the meshes in a file, placed by its scene graph."""
    file = Path(path)
    if (size := check_file(file)) > _MOST_BYTES:
        raise ValueError(f"{path}: {size / 2**20:.0f} MiB are too large for a prop; simplify it to {_MOST_FACES} faces")
    data = read_bytes(file)
    try:
        check_counts(file.suffix.lower(), data)
        with np.errstate(all="ignore"):
            scene = trimesh.load_scene(
                io.BytesIO(data), file_type=file.suffix.lower()[1:], resolver=Neighbours(file.parent)
            )
            check_repetition(scene, _MOST_FACES)
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
    if not mesh.visual.defined:
        return None
    material = getattr(mesh.visual, "material", None)
    colour = (material or mesh.visual).main_color
    return tuple(round(int(channel) / 255, 3) for channel in colour[:3])
