"""Calibration of CMU Panoptic Studio: JSON, up to 521 cameras."""

import json
import re
from pathlib import Path

from dmae.data.cameras import CameraRig
from dmae.data.store import write_atomic
from dmae.files.structured import read_json
from dmae.formats.calibrations.conventions import Convention, LengthUnit, UpDirection
from dmae.formats.calibrations.entries import CameraTable, ParsedCamera, make_rig, require
from dmae.formats.calibrations.registry import calibration_format

CONVENTION = Convention(unit=LengthUnit.cm, up=UpDirection.minus_y)


def _camera(path: Path, number: int, values: dict) -> ParsedCamera:
    name = values.get("name") if isinstance(values, dict) else None
    entry = CameraTable(path, f"number {number}" if name is None else str(name), values)
    if name is None:
        raise entry.error("name", "of the camera", f"no such key among {sorted(values)}")
    return ParsedCamera(
        entry.camera,
        entry.intrinsics("K"),
        entry.numbers("distCoef", 5),
        entry.rotation("R"),
        entry.numbers("t", 3),
        entry.size("resolution") if "resolution" in values else None,
    )


def write_cameras(rig: CameraRig, path: Path) -> None:
    """Write cameras to a file. The transforms in `cam_from_world` are not changed.

    A name such as 00_12 gives panel and node. Cameras with other names become nodes of panel 0.

    Raises:
        ValueError: the format cannot store a lens.
    """
    require("a Panoptic calibration", rig, coefficients=5)
    cameras = []
    for view, name in enumerate(rig.names):
        place = re.fullmatch(r"(\d\d)_(\d\d)", name)
        panel, node = map(int, place.groups()) if place else (0, view)
        cameras.append(
            {
                "name": name,
                "type": "hd",
                "resolution": rig.size[view].tolist(),
                "panel": panel,
                "node": node,
                "K": rig.K[view].tolist(),
                "distCoef": rig.dist[view, :5].tolist(),
                "R": rig.cam_from_world[view, :3, :3].tolist(),
                "t": rig.cam_from_world[view, :3, 3:].tolist(),
            }
        )
    write_atomic(path, json.dumps({"calibDataSource": "dmae", "cameras": cameras}, indent=1))


def _matches(content: object) -> bool:
    return isinstance(content, dict) and isinstance(content.get("cameras"), list)


@calibration_format(
    "panoptic",
    syntax="json",
    matches=_matches,
    write=write_cameras,
    convention=CONVENTION,
    files=("*alib*.json", "*alib*/*.json"),
)
def read_cameras(path: Path, size: tuple[int, int] | None = None) -> CameraRig:
    """JSON with a list of cameras (CMU Panoptic).

    Return the cameras of the file: cam_from_world, cm, y down.

    Raises:
        FileNotFoundError: the file does not exist.
        ValueError: the file is malformed; the message names camera and key.
    """
    content = read_json(path)
    cameras = content.get("cameras") if isinstance(content, dict) else None
    if not isinstance(cameras, list):
        raise ValueError(f"{path}: expected an object with a list of cameras, found {content!r:.60}")
    return make_rig(path, (_camera(path, number, values) for number, values in enumerate(cameras)), size)
