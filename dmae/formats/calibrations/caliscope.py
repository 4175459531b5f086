"""Calibration of Caliscope: TOML with one table per camera in `cameras`; in older projects, tables `cam_0`, `cam_1`
and so on."""

from pathlib import Path

import numpy as np
import tomlkit
from scipy.spatial.transform import Rotation

from dmae.data.cameras import CameraRig
from dmae.data.store import write_atomic
from dmae.files.structured import read_toml
from dmae.formats.calibrations.entries import CameraTable, ParsedCamera, make_rig, orthonormal, require
from dmae.formats.calibrations.registry import calibration_format

FILE = "camera_array.toml"
_IDS = ("cam_id", "port")


def _tables(content: dict) -> dict[str, dict]:
    """Return the tables of cameras, by name."""
    cameras = content.get("cameras")
    if isinstance(cameras, dict):
        return cameras
    return {
        name.removeprefix("cam_"): table
        for name, table in content.items()
        if isinstance(table, dict) and "matrix" in table and any(key in table for key in _IDS)
    }


def _matches(content: dict) -> bool:
    return any(isinstance(table, dict) and "matrix" in table for table in _tables(content).values())


def _camera(entry: CameraTable) -> ParsedCamera:
    fisheye = entry.values.get("fisheye", False)
    if not isinstance(fisheye, bool):
        raise entry.error("fisheye", "to be true or false", repr(fisheye))
    rotation = entry.numbers("rotation", 3, 9)
    return ParsedCamera(
        entry.camera,
        entry.intrinsics("matrix"),
        entry.numbers("distortions", *((4,) if fisheye else (4, 5, 8))),
        Rotation.from_rotvec(rotation).as_matrix() if rotation.size == 3 else entry.rotation("rotation"),
        entry.numbers("translation", 3),
        entry.size("size"),
        fisheye,
    )


def write_cameras(rig: CameraRig, path: Path) -> None:
    """Write cameras to a file, with rotations as matrices.

    The number of a camera is its name if that is a number, or else its index in the rig.

    Raises:
        ValueError: the format cannot store the distortion.
    """
    require("a Caliscope calibration", rig, coefficients=8, fisheye=True)
    R, t = orthonormal(rig)
    tables = {}
    for view, name in enumerate(rig.names):
        dist = np.pad(rig.dist[view], (0, 8 - rig.dist.shape[1]))
        count = 4 if rig.fisheye[view] else 8 if dist[5:].any() else 5
        tables[name] = {
            "cam_id": int(name) if name.isdecimal() else view,
            "rotation_count": 0,
            "size": rig.size[view].tolist(),
            "matrix": rig.K[view].tolist(),
            "distortions": dist[:count].tolist(),
            "rotation": R[view].tolist(),
            "translation": t[view].tolist(),
            "fisheye": bool(rig.fisheye[view]),
            "ignore": False,
        }
    write_atomic(path, tomlkit.dumps({"cameras": tables}))


@calibration_format(
    "caliscope", syntax="toml", matches=_matches, write=write_cameras, files=(FILE,), files_above=(FILE,)
)
def read_cameras(path: Path, size: tuple[int, int] | None = None) -> CameraRig:
    """TOML tables cameras.0 and on with matrix, distortions, rotation (Caliscope).

    Return the cameras of the file: cam_from_world, m. The file contains rotations as matrices or Rodrigues vectors.

    The name of a camera is the name of its table, a number. Cameras that the project ignores are left out.

    Raises:
        FileNotFoundError: the file does not exist.
        ValueError: the file is malformed; the message names camera and key.
    """
    entries = (CameraTable(path, name, table) for name, table in _tables(read_toml(path)).items())
    return make_rig(path, (_camera(entry) for entry in entries if entry.values.get("ignore") is not True), size)
