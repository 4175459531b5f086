"""Your own meshes as props."""

from dataclasses import dataclass
from enum import Enum

import numpy as np


class MeshUp(Enum):
    """The axis of a mesh file that points up."""

    auto = "auto"
    """y in .glb files, as their format defines it; z in other files."""
    y = "y"
    z = "z"


@dataclass(frozen=True)
class PropsConfig:
    """Your own meshes, used instead of `scene.prop_kinds`."""

    path: str = ""
    """A mesh file (.obj, .stl, .ply, .glb) or a folder of them; empty for none."""
    scale: float = 1.0
    """Metres per unit of the files; 0.001 for files in millimetres."""
    up: MeshUp = MeshUp.auto
    """The axis of the files that points up."""

    def __post_init__(self):
        if not 0 < self.scale < np.inf:
            raise ValueError(f"props.scale: expected metres per unit of the mesh files, more than 0, got {self.scale}")
        if not self.path and (self.scale != 1.0 or self.up is not MeshUp.auto):
            raise ValueError("props.scale and props.up say how meshes are read, but props.path names none")
