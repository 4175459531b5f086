"""Calibrations of Pose2Sim and anipose: TOML, a table a camera."""

import json
import tomllib
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from dmae.cameras import CameraRig
from dmae.conventions import Convention
from dmae.formats.cameras import Camera, Entry, make_rig, orthonormal, require
from dmae.store import write_atomic

CONVENTION = Convention()
_METADATA = "metadata"


def read_cameras(path: Path, size: tuple[int, int] | None = None) -> CameraRig:
    """Cameras as the file writes them: world to camera, rotations as Rodrigues vectors.

    A camera is called by its `name`, or as its table where it has none. Distortion is OpenCV's k1 k2 p1 p2 [k3
    [k4 k5 k6]], or with `fisheye = true` k1 k2 k3 k4. `[metadata]` is not read.

    Raises:
        FileNotFoundError: no such file.
        ValueError: it is malformed; the message names camera and key.
    """
    tables = {name: table for name, table in read_toml(path).items() if name != _METADATA}
    return make_rig(path, (_camera(Entry(path, name, table)) for name, table in tables.items()), size)


def read_toml(path: Path) -> dict:
    """A TOML file; ValueError names file, line and column of what is malformed."""
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(f"{path}: no such file")
    try:
        return tomllib.loads(path.read_text())
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ValueError(f"{path}: expected TOML, {error}") from None


def _camera(entry: Entry) -> Camera:
    fisheye = entry.values.get("fisheye", False)
    if not isinstance(fisheye, bool):
        raise entry.error("fisheye", "to be true or false", repr(fisheye))
    return Camera(
        str(entry.values.get("name", entry.camera)),
        entry.intrinsics("matrix"),
        entry.numbers("distortions", *((4,) if fisheye else (4, 5, 8))),
        entry.rodrigues("rotation"),
        entry.numbers("translation", 3),
        entry.size("size") if "size" in entry.values else None,
        fisheye,
    )


def write_cameras(rig: CameraRig, path: Path) -> None:
    """Write cameras, their pose as it stands in `cam_from_world`; rounded rotations become exact.

    Raises:
        ValueError: distortion that the format cannot hold.
    """
    require("a Pose2Sim calibration", rig, coefficients=8, fisheye=True)
    R, t = orthonormal(rig)
    rotation = Rotation.from_matrix(R).as_rotvec()
    lines = []
    for view, name in enumerate(rig.names):
        # JSON's strings and lists of finite numbers are TOML's too.
        values = {
            "name": name,
            "size": rig.size[view].astype(float).tolist(),
            "matrix": rig.K[view].tolist(),
            "distortions": _coefficients(rig, view).tolist(),
            "rotation": rotation[view].tolist(),
            "translation": t[view].tolist(),
            "fisheye": bool(rig.fisheye[view]),
        }
        lines += [f"[{_key(name)}]", *(f"{key} = {json.dumps(value)}" for key, value in values.items()), ""]
    write_atomic(path, "\n".join(lines))


def _key(name: str) -> str:
    bare = name.isascii() and name.replace("-", "").replace("_", "").isalnum() and name != _METADATA
    return name if bare else json.dumps(name)


def _coefficients(rig: CameraRig, view: int) -> np.ndarray:
    """Four where no more are needed, which is all that Pose2Sim itself writes."""
    dist = np.pad(rig.dist[view], (0, 8 - rig.dist.shape[1]))
    return dist[: 4 if not dist[4:].any() else 5 if not dist[5:].any() else 8]
