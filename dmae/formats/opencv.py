"""Results of OpenCV's calibration: files of `cv2.FileStorage` in YAML, XML or JSON, and the same values in plain JSON.

OpenCV prescribes no names, so cameras have any of the usual ones (`_NAMES`). A file holds one camera, called as the
file, and stands for the files of the other cameras beside it; or it holds a table for each camera.
"""

import re
from collections.abc import Iterator
from math import prod
from pathlib import Path
from xml.etree.ElementTree import Element

import cv2
import numpy as np

from dmae.data.cameras import CameraRig
from dmae.files.checks import numbers_of
from dmae.files.contents import read_text
from dmae.files.structured import parse_xml, parse_yaml, read_json
from dmae.formats.calibrations import CameraTable, ParsedCamera, calibration_format, make_rig
from dmae.formats.recordings import by_name, plain

_MOST_BYTES = 16 << 20
_SUFFIXES = (".yml", ".yaml", ".xml", ".json")
_NAMES = {
    "K": ("K", "camera_matrix", "cam_matrix", "intrinsic_matrix", "intrinsics", "intrinsic", "mtx"),
    "dist": ("dist", "distortion_coefficients", "distortion_coeffs", "dist_coeffs", "distortion", "distortions", "D"),
    "R": ("R", "rotation", "rotation_matrix", "rvec", "rotation_vector", "rot"),
    "t": ("t", "T", "translation", "tvec", "translation_vector"),
    "RT": ("RT", "extrinsics", "extrinsic", "extrinsic_matrix", "cam_from_world"),
    "size": ("size", "image_size", "img_size", "resolution"),
    "width": ("width", "image_width", "w", "W"),
    "height": ("height", "image_height", "h", "H"),
    "fisheye": ("fisheye",),
}
_ROUNDING = 2e-3
"""Largest difference between two notations of one value, as R and rvec."""
_FLAGS = {"true": True, "1": True, "1.0": True, "false": False, "0": False, "0.0": False}
_KEYS = {name if len(name) == 1 else plain(name): key for key, names in _NAMES.items() for name in names}


def _key(name) -> str | None:
    """Return our key of a name: case and punctuation of words do not matter, but k is a coefficient and K a matrix."""
    return _KEYS.get(str(name) if len(str(name)) == 1 else plain(str(name)))


def read_storage(path: Path) -> dict:
    """Read a file of `cv2.FileStorage`: flat arrays, lists of texts, numbers, tables of these.

    OpenCV's own reader crashes on files that are cut short. Raises FileNotFoundError, or ValueError with the path.
    """
    start = read_text(path, _MOST_BYTES).lstrip()
    if start.startswith("<"):
        content = _xml(path, start)
    elif start.startswith("{"):
        content = read_json(path)
    else:
        content = _yaml(path, start)
    if not isinstance(content, dict):
        raise ValueError(f"{path}: expected a table of values as in OpenCV's FileStorage, found {content!r:.60}")
    return {key: _value(path, key, value) for key, value in content.items()}


def _yaml(path: Path, text: str):
    try:
        # Standard YAML has no colon in this line. It would also read the name of a camera `01` as a number.
        return parse_yaml(re.sub(r"^\s*%YAML.*", "", text), texts=True)
    except ValueError as error:
        raise ValueError(f"{path}: expected YAML of OpenCV's FileStorage, {error}") from None


def _xml(path: Path, text: str) -> dict:
    try:
        return _table(parse_xml(text))
    except ValueError as error:
        raise ValueError(f"{path}: expected XML of OpenCV's FileStorage, {error}") from None


def _table(element: Element) -> dict:
    found = {child.tag: _element(child) for child in element}
    if len(found) < len(element):
        raise ValueError(f"an element twice in {element.tag}")
    return found


def _element(element: Element):
    if len(element) == 0:
        return (element.text or "").strip().strip('"')
    if all(child.tag == "_" for child in element):
        return [_element(child) for child in element]
    found = _table(element)
    if str(element.get("type_id")).endswith("matrix"):
        found |= {key: found[key].split() for key in ("sizes", "data") if isinstance(found.get(key), str)}
    return found


def _value(path: Path, key: str, value):
    if not isinstance(value, dict):
        return _number(value)
    if not {"data", "rows", "sizes"} & value.keys():
        return {name: _value(path, f"{key}.{name}", each) for name, each in value.items()}
    # A vector is a matrix of one column in OpenCV 4, and an array of one dimension in OpenCV 5.
    lengths = [value.get("rows"), value.get("cols")] if "rows" in value else value.get("sizes")
    data, shape = numbers_of(value.get("data")), numbers_of(lengths)
    if data.ndim == 1 and data.size == prod(shape.tolist()):
        return data
    raise ValueError(
        f"{path}: expected {key} to be a matrix of rows, cols and as many numbers of data, found {value!r:.90}"
    )


def _number(text):
    try:
        return float(text) if isinstance(text, str) else text
    except ValueError:
        return text


def _is_camera(values: object) -> bool:
    """Whether a table holds a camera: a camera matrix and its place, by any of their names."""
    keys = {_key(key) for key in values} if isinstance(values, dict) else set()
    return "K" in keys and bool({"R", "RT"} & keys)


def _matches(content: object) -> bool:
    if isinstance(content, list):
        # Keys of YAML, of all depths, or elements of XML. A list of `cameras` is a preset of rigs.
        keys = {_key(key) for key in content}
        return "K" in keys and "cameras" not in content and ("opencv_storage" in content or bool({"R", "RT"} & keys))
    if not isinstance(content, dict) or (tables := _tables(content)) is None:
        return False
    # Cameras of 4DAssociation have `K` and `RT`, and lenses without distortion.
    return not any("RT" in table and "dist" not in map(_key, table) for table in tables.values())


def _tables(content: dict) -> dict | None:
    """Return the tables of cameras by name, "" for a camera without a name; None if the file has no cameras."""
    if _is_camera(content):
        return {"": content}
    tables = {name: values for name, values in content.items() if isinstance(values, dict)}
    return tables if tables and all(map(_is_camera, tables.values())) else None


@calibration_format(
    "opencv",
    syntax="yaml xml json",
    matches=_matches,
    by_camera=True,
    files=(
        *(f"*{suffix}" for suffix in _SUFFIXES[:-1]),
        "camera*.json",
        *(f"{folder}/*{suffix}" for folder in ("*alib*", "camera*") for suffix in _SUFFIXES),
    ),
)
def read_cameras(path: Path, size: tuple[int, int] | None = None) -> CameraRig:
    """YAML, XML or JSON with camera_matrix or K, R or rvec, T, of one camera or a table for each (OpenCV).

    Return the cameras of the file, and if it holds only one, of all such files beside it: cam_from_world, in the unit
    of the file. `size` is width and height, px, of cameras without one.
    """
    return make_rig(path, [_camera(table) for table in _cameras(path)], size)


def _cameras(path: Path) -> Iterator[CameraTable]:
    tables = _read(path)
    if list(tables) != [""]:
        yield from (CameraTable(path, name, values) for name, values in tables.items())
        return
    for file in by_name(each for each in path.parent.iterdir() if each.suffix == path.suffix and each.is_file()):
        try:
            found = tables if file == path else _read(file)
        except ValueError:
            # Of something else, as a board or settings, unless it is a damaged file of a camera.
            if "K" in map(_key, re.findall(r"\w+", read_text(file, _MOST_BYTES))):
                raise
            continue
        if list(found) == [""]:
            yield CameraTable(file, _name(file), found[""])


def _read(path: Path) -> dict[str, dict]:
    content = read_storage(path)
    tables = _tables(content)
    if tables is None:
        names = ", ".join(f"{key} ({', '.join(_NAMES[key][1:4])})" for key in ("K", "R", "t"))
        raise ValueError(f"{path}: expected a camera, or a table for each: {names}; found {sorted(content)}")
    return {name: _by_key(path, values) for name, values in tables.items()}


def _by_key(path: Path, values: dict) -> dict:
    """Return the values of a camera by our keys. Two names of one key, as R and rvec, must agree."""
    found: dict = {}
    for name, value in values.items():
        key = _key(name) or str(name)
        here, before = (_compared(key, each) for each in (value, found.get(key)))
        if key in found and (here.shape != before.shape or not np.allclose(here, before, atol=_ROUNDING)):
            raise ValueError(f"{path}: {name} contradicts another {key} of the camera; leave one of them")
        found.setdefault(key, _numbers(value))
    return found


def _compared(key: str, value) -> np.ndarray:
    numbers = numbers_of(_numbers(value)).ravel()
    return cv2.Rodrigues(numbers)[0].ravel() if key == "R" and numbers.size == 3 else numbers


def _numbers(value):
    return [_numbers(each) for each in value] if isinstance(value, list) else _number(value)


def _name(file: Path) -> str:
    """Return the name of the camera of a file: main of calib_main.yml."""
    return re.sub(r"[\W_]*calib(ration)?[\W_]*", "", file.stem, flags=re.IGNORECASE) or file.stem


def _camera(table: CameraTable) -> ParsedCamera:
    given = table.values
    if "RT" in given:
        pose = table.numbers("RT", 12, 16).reshape(-1, 4)
        R, t = table.rotation("RT", pose[:3, :3]), pose[:3, 3]
    else:
        turn = table.numbers("R", 3, 9)
        R, t = table.rodrigues("R") if turn.size == 3 else table.rotation("R"), table.numbers("t", 3)
    keys = ("size",) if "size" in given else ("width", "height")
    size = table.size(*keys) if set(keys) & set(given) else None
    fisheye = _FLAGS.get(str(given.get("fisheye", False)).lower())
    if fisheye is None:
        raise table.error("fisheye", "to be true or false", repr(given["fisheye"]))
    dist = np.zeros(5)
    if "dist" in given:
        dist = table.numbers("dist", *((4,) if fisheye else (4, 5, 8, 12, 14)))
        # The rational model of OpenCV returns 14 coefficients, the last ones 0.
        if dist[8:].any():
            raise table.error("dist", "of up to 8 coefficients, without thin prisms and tilt", dist.tolist())
    return ParsedCamera(table.camera, table.intrinsics("K"), dist[:8], R, t, size, fisheye)
