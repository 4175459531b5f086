"""Calibration of EasyMocap: `intri.yml` and `extri.yml`, in the YAML dialect of OpenCV's FileStorage."""

import re
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from dmae.data.cameras import CameraRig
from dmae.data.store import write_atomic
from dmae.files.contents import read_text
from dmae.files.structured import parse_yaml
from dmae.formats.calibrations.entries import CameraTable, ParsedCamera, make_rig, orthonormal, require
from dmae.formats.calibrations.registry import calibration_format

INTRINSICS, EXTRINSICS = "intri.yml", "extri.yml"
# EasyMocap writes six decimals; its earlier versions wrote three.
_ROTATION_TOLERANCE = 2e-3
_MOST_BYTES = 16 << 20


def _read_storage(path: Path) -> dict:
    """Return the top level of an OpenCV FileStorage: matrices as flat arrays, lists of texts, numbers.

    OpenCV's own reader is not used, because it corrupts memory if a file is cut short.
    """
    if not path.is_file():
        raise FileNotFoundError(f"{path}: no such file; EasyMocap keeps {INTRINSICS} and {EXTRINSICS} side by side")
    try:
        # Standard YAML has no colon in this line. It would also read the name of a camera `01` as a number.
        text = re.sub(r"^\s*%YAML.*", "", read_text(path, _MOST_BYTES))
        content = parse_yaml(text, texts=True)
    except ValueError as error:
        raise ValueError(f"{path}: expected YAML of OpenCV's FileStorage, {error}") from None
    if not isinstance(content, dict):
        raise ValueError(f"{path}: expected K_<camera>, T_<camera>, ... of OpenCV's FileStorage, found {content!r:.60}")
    return {key: _value(path, key, value) for key, value in content.items()}


def _value(path: Path, key: str, value):
    if not isinstance(value, dict):
        return _number(value)
    try:
        data = np.array(value["data"], np.float64)
        if data.ndim == 1 and data.size == int(value["rows"]) * int(value["cols"]):
            return data
    except (KeyError, ValueError, TypeError):
        pass
    raise ValueError(
        f"{path}: expected {key} to be a matrix of rows, cols and as many numbers of data, found {value!r:.90}"
    )


def _number(text):
    try:
        return float(text)
    except (TypeError, ValueError):
        return text


def _camera(folder: Path, name: str, intrinsics: dict, extrinsics: dict) -> ParsedCamera:
    inner = CameraTable(folder / INTRINSICS, name, intrinsics)
    outer = CameraTable(folder / EXTRINSICS, name, extrinsics)
    K, R, rotation, distortion = (f"{key}_{name}" for key in ("K", "R", "Rot", "dist"))
    if distortion not in intrinsics and f"D_{name}" in intrinsics:
        distortion = f"D_{name}"
    turned = outer.rodrigues(R) if R in extrinsics or rotation not in extrinsics else outer.rotation(rotation)
    if R in extrinsics and rotation in extrinsics:
        apart = np.abs(outer.numbers(rotation, 9).reshape(3, 3) - turned).max()
        if apart > _ROTATION_TOLERANCE:
            raise outer.error(
                rotation, f"to be the matrix of {R}, which is its Rodrigues vector", f"one that is off by {apart:.1e}"
            )
    height, width, size = f"H_{name}", f"W_{name}", None
    if height in intrinsics or width in intrinsics:
        size = inner.size(width, height)
    return ParsedCamera(
        name,
        inner.intrinsics(K),
        inner.numbers(distortion, 4, 5, 8),
        turned,
        outer.numbers(f"T_{name}", 3),
        size,
    )


def write_cameras(rig: CameraRig, path: Path) -> None:
    """Write `intri.yml` and `extri.yml` into a folder; rounded rotations become exact.

    This module formats the text itself, because YAML libraries cannot write the header and matrices of OpenCV's
    dialect.

    Raises:
        ValueError: the format cannot store a lens or the name of a camera.
    """
    require("an EasyMocap calibration", rig, coefficients=8)
    R, t = orthonormal(rig)
    intrinsics, extrinsics = [_names(rig)], [_names(rig)]
    for view, name in enumerate(rig.names):
        if not (name.isascii() and name.replace("_", "").replace("-", "").isalnum()):
            raise ValueError(f"camera {name!r}: an EasyMocap calibration takes names of letters, digits, - and _")
        width, height = rig.size[view]
        intrinsics += [
            _matrix(f"K_{name}", rig.K[view]),
            _matrix(f"dist_{name}", rig.dist[view, None, : 8 if rig.dist[view, 5:].any() else 5]),
            f"H_{name}: {height}",
            f"W_{name}: {width}",
        ]
        extrinsics += [
            _matrix(f"R_{name}", Rotation.from_matrix(R[view]).as_rotvec()[:, None]),
            _matrix(f"Rot_{name}", R[view]),
            _matrix(f"T_{name}", t[view][:, None]),
        ]
    for file, lines in ((INTRINSICS, intrinsics), (EXTRINSICS, extrinsics)):
        write_atomic(Path(path) / file, "\n".join(["%YAML:1.0", "---", *lines, ""]))


def _names(rig: CameraRig) -> str:
    return "\n".join(["names:", *(f'   - "{name}"' for name in rig.names)])


def _matrix(key: str, values: np.ndarray) -> str:
    rows, columns = values.shape
    data = ", ".join(map(repr, map(float, values.ravel())))
    return f"{key}: !!opencv-matrix\n   rows: {rows}\n   cols: {columns}\n   dt: d\n   data: [ {data} ]"


@calibration_format("easymocap", syntax="yaml", write=write_cameras, files=(INTRINSICS, f"*/{INTRINSICS}"))
def read_cameras(path: Path, size: tuple[int, int] | None = None) -> CameraRig:
    """intri.yml and extri.yml (EasyMocap).

    Return the cameras that `extri.yml` names: cam_from_world, in the unit of the files.

    Args:
        path: One of `intri.yml` and `extri.yml`, or the folder that contains both.
        size: Image width and height, px, if the files do not state them.

    Raises:
        FileNotFoundError: one of the files is missing.
        ValueError: the files are malformed or contradict each other; the message names camera and key.
    """
    folder = path if path.is_dir() else path.parent
    intrinsics, extrinsics = (_read_storage(folder / name) for name in (INTRINSICS, EXTRINSICS))
    # `intri.yml` often contains more cameras than the recording.
    names = extrinsics.get("names", intrinsics.get("names"))
    if not isinstance(names, list):
        raise ValueError(f"{folder / EXTRINSICS}: expected names to be a list of cameras, found {names!r:.60}")
    return make_rig(folder, (_camera(folder, str(name), intrinsics, extrinsics) for name in names), size)
