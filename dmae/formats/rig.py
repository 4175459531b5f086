"""Cameras listed in YAML, as a preset of rigs of `synth` lists them, and as people write them by hand."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from dmae.data.cameras import CameraRig
from dmae.files.structured import read_yaml
from dmae.formats.calibrations import CameraTable, ParsedCamera, calibration_format, make_rig

_KEYS = ("name", "size", "K", "dist", "cam_from_world", "fisheye", "focal", "position", "target")
_CHOICES = (("K", "focal"), ("cam_from_world", "position"), ("cam_from_world", "target"))
"""Keys of a camera, and pairs of keys of which it has one."""


@calibration_format("rig", syntax="yaml", matches=lambda keys: "cameras" in keys, files=("*alib*.yaml",))
def read_cameras(path: Path, size: tuple[int, int] | None = None) -> CameraRig:
    """YAML with a list of cameras, as a preset of rigs (synth).

    Return the cameras of the file; `size` is width and height, px, of cameras without one. Other keys of a preset are
    not read.
    """
    content = read_yaml(path)
    cameras = content.get("cameras") if isinstance(content, dict) else None
    if not isinstance(cameras, list):
        raise ValueError(f"{path}: expected cameras to be a list, found {cameras!r:.60}")
    return listed_cameras(cameras, path, size)


def listed_cameras(cameras: Sequence[dict], source: Path | str, size: tuple[int, int] | None = None) -> CameraRig:
    """Return the rig of cameras by `_KEYS`; keys that are absent or empty are not given.

    Raises:
        ValueError: numbers are missing or do not define a camera; the message names the source, the camera and the key.
    """
    tables = []
    for number, camera in enumerate(cameras):
        table = CameraTable(source, f"number {number}", camera)
        if unknown := [key for key in camera if key not in _KEYS]:
            raise table.error("no other keys than", ", ".join(_KEYS), ", ".join(map(str, unknown)))
        values = {key: _as_numbers(value) for key, value in camera.items() if key != "name" and value not in (None, [])}
        tables.append(CameraTable(source, str(camera.get("name", table.camera)), values))
    return make_rig(source, map(_camera, tables), size)


def _as_numbers(value):
    """Return a list with the numbers in its texts: YAML takes 1e-5 for a text."""
    if isinstance(value, list):
        return [_as_numbers(item) for item in value]
    try:
        return float(value) if isinstance(value, str) else value
    except ValueError:
        return value


def _camera(table: CameraTable) -> ParsedCamera:
    given = table.values
    for first, second in _CHOICES:
        if first in given and second in given:
            raise table.error("either", f"{first} or {second}", "both")
    size = table.size("size") if "size" in given else None
    if "focal" in given:
        (focal,) = table.numbers("focal", 1)
        table.check_focal("focal", focal)
        K = intrinsics(focal, table.size("size").tolist())
    else:
        K = table.intrinsics("K")
    if "position" in given or "target" in given:
        center, target = table.numbers("position", 3), table.numbers("target", 3)
        if np.allclose(center, target):
            raise table.error("target", "that is not the position", f"both at {center.tolist()}")
        R = look_at(center[None], target)[0]
        t = -R @ center
    else:
        # Three rows, or four, as a matrix or row by row.
        pose = table.numbers("cam_from_world", 12, 16).reshape(-1, 4)
        if not np.allclose(pose[3:], (0, 0, 0, 1)):
            raise table.error("cam_from_world", "to end with a row 0 0 0 1", pose[3].tolist())
        R, t = table.rotation("cam_from_world", pose[:, :3][:3]), pose[:3, 3]
    dist = table.numbers("dist", *range(4, 9)) if "dist" in given else np.zeros(5)
    fisheye = given.get("fisheye", False)
    if not isinstance(fisheye, bool):
        raise table.error("fisheye", "to be true or false", repr(fisheye))
    return ParsedCamera(table.camera, K, dist, R, t, size, fisheye)


def intrinsics(focal: float, size: Sequence[int]) -> np.ndarray:
    """Return (3, 3) K of a camera with its principal point in the middle of the image, px."""
    width, rows = size
    return np.array([[focal, 0, (width - 1) / 2], [0, focal, (rows - 1) / 2], [0, 0, 1]])


def look_at(centers: np.ndarray, target: np.ndarray) -> np.ndarray:
    """Return (V, 3, 3) rotations cam_from_world of upright cameras at centres (V, 3) that look at (3,) or (V, 3), m."""
    forward = target - centers
    forward /= np.linalg.norm(forward, axis=-1, keepdims=True)
    right = np.cross(forward, [0, 0, 1])
    # For cameras that look straight up or down, the world's x axis points to the right of the image.
    right[np.linalg.norm(right, axis=-1) < 1e-9] = (1, 0, 0)
    right /= np.linalg.norm(right, axis=-1, keepdims=True)
    return np.stack([right, np.cross(forward, right), forward], 1)
