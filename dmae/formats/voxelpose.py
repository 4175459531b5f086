"""Calibration of the Shelf and Campus recordings as VoxelPose publishes them: JSON."""

from pathlib import Path

import numpy as np

from dmae.data.cameras import CameraRig
from dmae.files.structured import read_json
from dmae.formats.calibrations import CameraTable, ParsedCamera, calibration_format, camera_tables, make_rig
from dmae.formats.config import Convention, LengthUnit


def _camera(entry: CameraTable) -> ParsedCamera:
    fx, fy, cx, cy = (entry.numbers(key, 1).item() for key in ("fx", "fy", "cx", "cy"))
    entry.check_focal("fx", fx)
    entry.check_focal("fy", fy)
    (k1, k2, k3), (p1, p2) = entry.numbers("k", 3), entry.numbers("p", 2)
    R = entry.rotation("R")
    return ParsedCamera(
        entry.camera,
        np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]]),
        np.array([k1, k2, p1, p2, k3]),
        R,
        -R @ entry.numbers("T", 3),
        None,
    )


def _matches(content: object) -> bool:
    cameras = content.values() if isinstance(content, dict) else ()
    keys = {key for camera in cameras if isinstance(camera, dict) for key in camera}
    return bool(keys & {"T", "fx", "fy"}) and not keys & {"RT", "imgSize"}


@calibration_format(
    "voxelpose",
    syntax="json",
    matches=_matches,
    convention=Convention(unit=LengthUnit.mm),
    files=("*alib*.json", "*alib*/*.json"),
)
def read_cameras(path: Path, size: tuple[int, int] | None = None) -> CameraRig:
    """JSON cameras with R, T, fx (VoxelPose).

    Return the cameras of the file: cam_from_world, mm. `T` is the centre of the camera: x = R (X - T).

    The files contain no image sizes (Shelf 1032 x 776 px, Campus 360 x 288 px).
    """
    return make_rig(path, map(_camera, camera_tables(path, read_json(path))), size)
