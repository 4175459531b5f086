"""Props: MJCF files of primitives, and the user's triangle meshes."""

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np

from synth.rooms.catalogue import prop_file
from synth.rooms.footprints import discs, geom_corners
from synth.rooms.meshes import MESHES, MeshUp, load_mesh
from synth.rooms.mjcf import read_mjcf


@dataclass(frozen=True)
class PropsConfig:
    """Your own meshes, used instead of `scene.prop_kinds`.

    Attributes:
        path: A mesh file (.obj, .stl, .ply, .glb) or a folder of them; empty for none.
        scale: Metres per unit of the files; 0.001 for files in millimetres.
        up: The axis of the files that points up.
    """

    path: str = ""
    scale: float = 1.0
    up: MeshUp = MeshUp.auto

    def __post_init__(self):
        if not 0 < self.scale < np.inf:
            raise ValueError(f"props.scale: expected metres per unit of the mesh files, more than 0, got {self.scale}")
        if not self.path and (self.scale != 1.0 or self.up is not MeshUp.auto):
            raise ValueError("props.scale and props.up say how meshes are read, but props.path names none")


def prop_spec(kind: str, scale: float = 1.0, up: MeshUp = MeshUp.auto) -> mujoco.MjSpec:
    """Return the MuJoCo specification of one prop: a name in `scenes/props/`, or an MJCF or mesh file.

    A material "tint" of the prop takes any colour. The triangles of a mesh stop rays; the convex hull of each connected
    part stops people.

    Raises:
        ValueError: there is no such prop, or its mesh cannot be simulated; the message names it.
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
    """The space that a prop takes.

    Attributes:
        discs: (K, 3) x, y and radius of discs that cover it on the floor, m.
        size: (3,) size of its bounding box along its own axes, m.
        reach: (3,) greatest x, y and z of the box, m, rounded to the micrometre.
    """

    discs: np.ndarray
    size: np.ndarray
    reach: np.ndarray

    @property
    def face(self) -> float:
        """The area of the largest upright face of the bounding box, m^2."""
        return float(self.size[:2].max() * self.size[2])


@lru_cache(maxsize=64)
def prop_size(kind: str, scale: float = 1.0, up: MeshUp = MeshUp.auto) -> PropSize:
    """Return the space that a prop takes. Raises the same errors as `prop_spec`."""
    model = prop_spec(kind, scale, up).compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    corners = geom_corners(model, data, np.arange(model.ngeom)).reshape(-1, 3)
    return PropSize(discs(model), np.ptp(corners, axis=0), corners.max(0).round(6))
