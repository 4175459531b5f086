"""Calibration of Pose2Sim and anipose: TOML with one table per camera."""

from pathlib import Path

import numpy as np
import tomlkit
from scipy.spatial.transform import Rotation

from dmae.data.cameras import CameraRig
from dmae.data.store import write_atomic
from dmae.files.structured import read_toml
from dmae.formats.calibrations.entries import CameraTable, ParsedCamera, make_rig, orthonormal, require
from dmae.formats.calibrations.registry import calibration_format

_METADATA = "metadata"


def _camera(entry: CameraTable) -> ParsedCamera:
    fisheye = entry.values.get("fisheye", False)
    if not isinstance(fisheye, bool):
        raise entry.error("fisheye", "to be true or false", repr(fisheye))
    return ParsedCamera(
        str(entry.values.get("name", entry.camera)),
        entry.intrinsics("matrix"),
        entry.numbers("distortions", *((4,) if fisheye else (4, 5, 8))),
        entry.rodrigues("rotation"),
        entry.numbers("translation", 3),
        entry.size("size") if "size" in entry.values else None,
        fisheye,
    )


def write_cameras(rig: CameraRig, path: Path) -> None:
    """Write cameras to a file. Rounded rotations in `cam_from_world` become exact.

    Raises:
        ValueError: the format cannot store the distortion.
    """
    require("a Pose2Sim calibration", rig, coefficients=8, fisheye=True)
    R, t = orthonormal(rig)
    rotation = Rotation.from_matrix(R).as_rotvec()
    tables = {}
    for view, name in enumerate(rig.names):
        # A camera can have any name, but the table `[metadata]` is not a camera.
        tables[f"camera_{name}" if name == _METADATA else name] = {
            "name": name,
            "size": rig.size[view].astype(float).tolist(),
            "matrix": rig.K[view].tolist(),
            "distortions": _coefficients(rig, view).tolist(),
            "rotation": rotation[view].tolist(),
            "translation": t[view].tolist(),
            "fisheye": bool(rig.fisheye[view]),
        }
    write_atomic(path, tomlkit.dumps(tables))


def _coefficients(rig: CameraRig, view: int) -> np.ndarray:
    """Return the distortion coefficients of a view: 4 if the others are zero, as Pose2Sim writes, or else 5 or 8."""
    dist = np.pad(rig.dist[view], (0, 8 - rig.dist.shape[1]))
    return dist[: 4 if not dist[4:].any() else 5 if not dist[5:].any() else 8]


def _matches(content: dict) -> bool:
    return any(isinstance(table, dict) and "matrix" in table for table in content.values())


@calibration_format(
    "pose2sim",
    syntax="toml",
    matches=_matches,
    write=write_cameras,
    files=("*alib*.toml", "*alib*/*.toml"),
    # In Pose2Sim, all trials of a session share one calibration.
    files_above=("*alib*/*.toml",),
)
def read_cameras(path: Path, size: tuple[int, int] | None = None) -> CameraRig:
    """TOML tables with matrix, distortions, rotation (Pose2Sim, anipose).

    Return the cameras of the file: cam_from_world, in the unit of the file. It contains rotations as Rodrigues vectors.

    A camera without `name` has the name of its table. Distortion is OpenCV's k1 k2 p1 p2 [k3 [k4 k5 k6]], or with
    `fisheye = true` k1 k2 k3 k4. `[metadata]` is not read.

    Raises:
        FileNotFoundError: the file does not exist.
        ValueError: the file is malformed; the message names camera and key.
    """
    tables = {name: table for name, table in read_toml(path).items() if name != _METADATA}
    return make_rig(path, (_camera(CameraTable(path, name, table)) for name, table in tables.items()), size)
