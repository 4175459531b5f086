"""Calibration of the Shelf recording in the 4DAssociation release: JSON."""

import json
from pathlib import Path

import numpy as np

from dmae.data.cameras import CameraRig
from dmae.data.store import write_atomic
from dmae.files.structured import read_json
from dmae.formats.calibrations.entries import CameraTable, ParsedCamera, make_rig, require
from dmae.formats.calibrations.registry import calibration_format


def _camera(entry: CameraTable) -> ParsedCamera:
    pose = entry.numbers("RT", 12).reshape(3, 4)
    R = entry.rotation("RT", pose[:, :3])
    return ParsedCamera(entry.camera, entry.intrinsics("K"), np.zeros(5), R, pose[:, 3], entry.size("imgSize"))


def write_cameras(rig: CameraRig, path: Path) -> None:
    """Write cameras to a file.

    Raises:
        ValueError: the format cannot store a lens.
    """
    require("a 4DAssociation calibration", rig, coefficients=0)
    cameras = {
        name: {
            "K": rig.K[view].ravel().tolist(),
            "RT": rig.cam_from_world[view, :3].ravel().tolist(),
            "imgSize": rig.size[view].tolist(),
        }
        for view, name in enumerate(rig.names)
    }
    write_atomic(path, json.dumps(cameras, indent=1))


def _matches(content: object) -> bool:
    cameras = content.values() if isinstance(content, dict) else ()
    return any({"RT", "imgSize"} & set(camera) for camera in cameras if isinstance(camera, dict))


@calibration_format(
    "shelf", syntax="json", matches=_matches, write=write_cameras, files=("*alib*.json", "*alib*/*.json")
)
def read_cameras(path: Path, size: tuple[int, int] | None = None) -> CameraRig:
    """JSON cameras with K, RT, imgSize (4DAssociation).

    Return the cameras of the file: cam_from_world, m.

    Raises:
        FileNotFoundError: the file does not exist.
        ValueError: the file is malformed; the message names camera and key.
    """
    cameras = read_json(path)
    if not isinstance(cameras, dict) or not cameras:
        raise ValueError(f"{path}: expected an object of cameras, found {cameras!r:.60}")
    return make_rig(path, (_camera(CameraTable(path, name, values)) for name, values in cameras.items()), size)
